"""The observer of small motions against a second derivation of what it does in a tick."""

from typing import Any

import numpy as np
import pytest
from tests.plants import plant

from flexslew_control.estimators.small_motion_observer import (
    ObserverSettings,
    SmallMotionObserver,
    observer,
)
from flexslew_control.linear.small_motion import design_motion
from flexslew_lab.trial.sources import read_trial
from flexslew_plant.arrays import EMPTY, Vector
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds import default_testbed

PERIOD = 0.01


def observer_of(testbed: Any) -> SmallMotionObserver:
    bench = plant(PERIOD, testbed.effort_limit, testbed)
    found = observer(design_motion(bench, None), ObserverSettings(), PERIOD)
    assert isinstance(found, SmallMotionObserver)
    return found


def reading(tick: int, position: Vector, rate: Vector, effort: Vector) -> Measurement:
    return Measurement(tick, 0, tick * PERIOD, "", position, rate, EMPTY, EMPTY, effort)


@pytest.mark.parametrize("kind", ["free", "held"])
def test_an_innovation_moves_the_state_along_its_motions_and_a_turn_is_told_in_full(
    kind: str,
) -> None:
    """Against the same in matrices: q + N(q) L e, and N(rest)^+ (q - rest)."""
    testbed = read_trial("antenna_1")[0].testbed if kind == "free" else default_testbed()
    estimator, rng = observer_of(testbed), np.random.default_rng(3)
    model, rest = estimator.motion.model, estimator.motion.rest
    n, m, first = model.coordinates, model.joints, model.positions
    small = np.linalg.pinv(model.position_rates(rest))
    x = np.concatenate((rest, np.zeros(n)))
    effort = np.zeros(m)
    for tick in range(4):
        position, rate = 0.1 * rng.standard_normal((2, m))
        measured = reading(tick, position, rate, effort)
        if tick == 0:
            estimator.reset(measured)
        else:
            x = model.advance(x, effort, PERIOD, t=(tick - 1) * PERIOD)
        estimate = estimator.update(measured)
        there, turning = model.joint_state(x)
        innovation = np.concatenate((position - there, rate - turning))
        step, q = estimator.gain @ innovation, x[:first]
        x = np.concatenate((q + model.position_rates(q) @ step[:n], x[first:] + step[n:]))
        if kind == "free":
            x[3:7] /= np.linalg.norm(x[3:7])
        np.testing.assert_allclose(estimate.innovation, innovation, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(estimate.position, small @ (x[:first] - rest), atol=1e-10)
        np.testing.assert_allclose(estimate.velocity, x[first:], rtol=1e-10, atol=1e-10)
        effort = rng.standard_normal(m)
