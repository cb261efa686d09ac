"""Model predictive control of a craft that turns in three axes: its limits, and what it refuses."""

from itertools import product
from typing import Any

import numpy as np
import pytest
from tests.control.controllers.test_linear_three_axes import PERIOD, TORQUES, M, craft
from tests.representatives import representatives

from flexslew_control.controllers import build_controller
from flexslew_control.law import PlantDescription
from flexslew_control.plan import Plan
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.hardware.sensors import exact_readings
from flexslew_plant.measurement import Measurement

LIMIT, RATE = 0.5, 0.3  # [N m], [N m/s]
TICKS = 1250


def held_at(goal: Vector) -> Plan:
    """Return a plan that asks for one attitude at once, a rotation vector."""
    still, effort, state = np.zeros((2, M)), np.zeros((1, M)), np.zeros((2, 0))
    names = tuple(TORQUES)
    return Plan("reference_only", names, 0.0, PERIOD, still + goal, still, effort, state, PERIOD)


def flown(kind: str, goal: Vector, settings: dict[str, Any]) -> tuple[Matrix, Matrix, Any]:
    """Return what the joints read, the efforts commanded, and the controller."""
    bench = craft(kind)
    model, plant = bench.model(), PlantDescription(bench, PERIOD, np.full(M, LIMIT))
    values = {"weights": {"time": 3.0}, **settings}
    it = build_controller("it", "model_predictive", values, plant, "here")
    assert it.adopt(held_at(goal)) is None
    x, effort = np.concatenate((model.rest({}), np.zeros(model.coordinates))), np.zeros(M)
    read, efforts = np.empty((TICKS, M)), np.empty((TICKS, M))
    for k in range(TICKS):
        seen = exact_readings(model, x, effort, k * PERIOD)
        answer = it.observe(Measurement(k, 0, k * PERIOD, "it", *seen, effort))
        assert answer is not None
        effort = answer.command.effort
        read[k], efforts[k] = seen[0], effort
        x = model.advance(x, effort, PERIOD)
    return read, efforts, it


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "axes"),
    representatives(product(["wheels", "torques", "rigid"], [1, 3]), ("wheels", 3)),
)
def test_efforts_their_rates_and_joints_keep_their_limits_over_random_goals(
    kind: str, axes: int
) -> None:
    """The largest turn is stopped at 0.7 of itself by joint_range; the others reach the goal."""
    rng = np.random.default_rng(axes)
    goal = np.zeros(M)
    goal[rng.permutation(M)[:axes]] = rng.uniform(0.2, 0.45, axes) * rng.choice([-1, 1], axes)
    k = int(np.abs(goal).argmax())
    stop = 0.7 * abs(goal[k])
    joint = {list(TORQUES)[k]: (-stop, stop)}
    read, efforts, it = flown(kind, goal, {"effort_rate": RATE, "joint_range": joint})
    assert np.abs(efforts).max() <= LIMIT
    steps = np.diff(efforts, axis=0, prepend=np.zeros((1, M)))
    assert np.abs(steps).max() <= RATE * PERIOD * (1.0 + 1e-6)  # the solver's tolerance
    # a step of the horizon has its end alone within the limit
    assert np.abs(read[:, k]).max() <= stop + 1e-3
    assert read[-1, k] == pytest.approx(np.sign(goal[k]) * stop, abs=1e-3)
    free = [j for j in range(M) if j != k]
    np.testing.assert_allclose(read[-1, free], goal[free], atol=0.01)  # pulled by the held one
    assert {event.kind for event in it.events} <= {"softened"}  # the goal itself is outside


@pytest.mark.slow
def test_without_limits_a_goal_is_reached() -> None:
    goal = np.array([0.9, -1.4, 0.6])
    read, _, it = flown("rigid", goal, {})
    assert np.abs(read[-1] - goal).max() < 5e-3  # what the slowest pole leaves after 25 s
    assert not it.events


def test_tips_have_no_limit_about_a_plan_that_does_not_tell_them() -> None:
    bench = PlantDescription(craft("wheels"), PERIOD, np.full(M, LIMIT))
    with pytest.raises(BadInput, match=r"here: tip_limit: 0\.01 is not allowed: .*leave it"):
        build_controller("mpc", "model_predictive", {"tip_limit": 0.01}, bench, "here")
