"""Margins of PD gains; `reproduce csa` has those of the paper, see test_reproduce_csa."""

import numpy as np
import pytest

from flexslew_lab.reproduce.pd_margins import margin_table, stability_margin
from flexslew_plant.testbeds.csa import CsaTestbed

MODEL = CsaTestbed(variant="printed", modes=1).model()


def test_table_holds_the_margins() -> None:
    kp, kd, pitches = np.array([300.0, 460.0]), np.array([500.0, 920.0, 2000.0]), np.array([0.0, 1])
    table = margin_table(MODEL, kp, kd, pitches)
    for i, p in enumerate(kp):
        for j, d in enumerate(kd):
            worst = min(stability_margin(MODEL, p, d, pitch) for pitch in pitches)
            assert table[i, j] == pytest.approx(worst, abs=1e-12)


def test_an_undamped_loop_has_no_margin() -> None:
    assert stability_margin(MODEL, 460.0, 0.0, 0.3) == pytest.approx(0.0, abs=1e-12)
