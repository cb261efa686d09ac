import numpy as np
import pytest

from flexslew_lab.reproduce.pd_margins import (
    best_gains,
    guaranteed_margin,
    margin_table,
    stability_margin,
)
from flexslew_plant.testbeds.csa import CsaTestbed

MODEL = CsaTestbed(variant="printed", modes=1).model()


@pytest.mark.parametrize(
    ("pitch", "margin"), [(0.0, 0.0331672), (0.5, 0.0360931), (1.0, 0.0458938), (1.25, 0.0333525)]
)
def test_margin_at_the_gains_of_the_paper(pitch: float, margin: float) -> None:
    assert stability_margin(MODEL, 460.0, 920.0, pitch) == pytest.approx(margin, abs=1e-6)


@pytest.mark.parametrize(("modes", "margin"), [(2, 0.002759), (3, 0.000403)])
def test_more_modes_leave_little_margin(modes: int, margin: float) -> None:
    model = CsaTestbed(variant="printed", modes=modes).model()
    assert stability_margin(model, 460.0, 920.0, 0.5) == pytest.approx(margin, abs=1e-6)


def test_largest_margin_of_figure_3() -> None:
    best = best_gains(MODEL, 0.5)
    assert best.margin == pytest.approx(0.143080, rel=1e-4)
    assert best.kp == pytest.approx(471.04, rel=1e-4)
    assert best.kd == pytest.approx(2355.2, rel=1e-4)


def test_largest_guaranteed_margin_of_figure_4() -> None:
    best = best_gains(MODEL)
    assert best.margin == pytest.approx(0.034074, rel=0.01)
    assert (best.kp, best.kd) == pytest.approx((442.1, 920.0), rel=0.01)
    assert guaranteed_margin(MODEL, 460.0, 920.0) <= best.margin


def test_table_holds_the_margins() -> None:
    kp, kd, pitches = np.array([300.0, 460.0]), np.array([500.0, 920.0, 2000.0]), np.array([0.0, 1])
    table = margin_table(MODEL, kp, kd, pitches)
    for i, p in enumerate(kp):
        for j, d in enumerate(kd):
            worst = min(stability_margin(MODEL, p, d, pitch) for pitch in pitches)
            assert table[i, j] == pytest.approx(worst, abs=1e-12)


def test_an_undamped_loop_has_no_margin() -> None:
    assert stability_margin(MODEL, 460.0, 0.0, 0.3) == pytest.approx(0.0, abs=1e-12)
