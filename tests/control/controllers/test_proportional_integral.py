from typing import Any

import numpy as np
import pytest
from tests.plants import plant as on_bench

from flexslew_control.controllers.lqr import ScaledWeights
from flexslew_control.controllers.proportional_integral import (
    GivenGains,
    ProportionalIntegral,
    build,
    design,
)
from flexslew_control.controllers.sampled_loop import integral_loop
from flexslew_lab.reproduce.pi import pi_rows
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.csa import CsaTestbed


def linearisation(pitch: Any, modes: int = 1) -> Any:
    model = CsaTestbed(modes=modes).model()
    return model.linearise(np.array([0.0, pitch] + [0.0] * modes))


@pytest.mark.slow
def test_gains_disturbance_rejection_and_anti_windup_match_the_public_table() -> None:
    wrong = [row for row in pi_rows() if not row["ok"]]
    assert not wrong


@pytest.mark.parametrize("pitch", [0.0, 0.5, 1.0])
def test_the_closed_loop_has_the_poles_of_the_augmented_regulator(pitch: float) -> None:
    linear = linearisation(pitch)
    gains = design(linear, ScaledWeights())
    loop = integral_loop(linear, gains.kp, gains.kd, gains.ki, None)
    poles = np.sort_complex(np.linalg.eigvals(loop).round(9))
    designed = np.sort_complex(gains.design_poles.round(9))
    for pole in poles:
        assert abs(designed - pole).min() < 1e-8
    for pole in designed:
        assert abs(poles - pole).min() < 1e-8


def test_a_hand_given_gain_that_does_not_stabilise_is_refused() -> None:
    good = design(linearisation(0.5), ScaledWeights())
    rows = {name: tuple(map(tuple, getattr(good, name).tolist())) for name in ("kp", "kd", "ki")}
    build(ProportionalIntegral(gains=GivenGains(**rows)), on_bench())
    rows["kp"] = tuple(map(tuple, (-good.kp).tolist()))
    with pytest.raises(BadInput, match="not stable: eigenvalue"):
        build(ProportionalIntegral(gains=GivenGains(**rows)), on_bench())


def test_gains_of_the_wrong_shape_are_refused() -> None:
    given = GivenGains(kp=((1.0,),), kd=((1.0,),), ki=((1.0,),))
    with pytest.raises(BadInput, match="kp: give 2 rows of 3"):
        build(ProportionalIntegral(gains=given), on_bench())


def test_an_uncontrollable_operating_point_is_refused() -> None:
    settings = ProportionalIntegral(operating_point={"hub_pitch": float(np.pi / 2)})
    with pytest.raises(BadInput, match="not controllable"):
        build(settings, on_bench())
