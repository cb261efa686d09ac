"""A closed loop in three axes: stable at any attitude, the same from any inertial frame."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexslew_control.controllers import build_controller
from flexslew_control.controllers.by_joint.pd_feedforward import PdFeedforward
from flexslew_control.controllers.controller import Controller
from flexslew_control.law import MeasuredJoints, PlantDescription
from flexslew_control.plan import Plan
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.hardware.sensors import exact_readings
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds import read_testbed

PERIOD, NAMES = 0.1, ("roll", "pitch", "yaw")
INERTIA = np.array([10.0, 14.0, 18.0])  # [kg m^2]
RATE = 0.5  # of the closed loop [rad/s]
KP, KD = RATE**2 * INERTIA, 2.0 * 0.7 * RATE * INERTIA
CRAFT = read_testbed(
    {
        "kind": "spacecraft",
        "platform": {"mass": 50.0, "inertia": dict(zip(("xx", "yy", "zz"), INERTIA, strict=True))},
        "appendages": {},
        "actuators": {
            name: {"kind": "torque", "direction": axis.tolist(), "limit": 1e3}
            for name, axis in zip(NAMES, np.eye(3), strict=True)
        },
    },
    "here",
)
MODEL = CRAFT.model()


def held_at(goal: Vector) -> Plan:
    """Return a plan that asks for one attitude, a rotation vector, and nothing else."""
    still = np.zeros((2, 3))
    effort, state = np.zeros((1, 3)), np.zeros((2, 0))
    return Plan("reference_only", NAMES, 0.0, PERIOD, still + goal, still, effort, state, PERIOD)


def law(name: str = "pd_feedforward", **gains: Any) -> Controller:
    plant = PlantDescription(CRAFT, PERIOD, np.full(3, 1e3))
    gains = gains or {"kp": KP.tolist(), "kd": KD.tolist()}
    return build_controller("it", name, gains, plant, "here")


def flown(it: Controller, start: Rotation, goal: Vector, ticks: int, push: Vector) -> Matrix:
    """Return states and efforts at the ticks; the push is that of the first second [N m]."""
    assert it.adopt(held_at(goal)) is None
    x = np.zeros(MODEL.positions + MODEL.coordinates)
    x[3:7] = start.as_quat()
    effort, nothing, rows = np.zeros(3), np.zeros(0), []
    for k in range(ticks):
        seen = exact_readings(MODEL, x, effort, k * PERIOD)
        it_says = it.observe(Measurement(k, 0, k * PERIOD, "it", *seen, effort))
        assert it_says is not None
        effort = it_says.command.effort
        rows.append(np.concatenate((x, effort, nothing)))
        x = MODEL.advance(x, effort + (push if k * PERIOD < 1.0 else 0.0), PERIOD)
    return np.array(rows)


def away(rows: Matrix, goal: Vector) -> Vector:
    """Return the angle to the goal at each tick [rad]."""
    to_goal = Rotation.from_rotvec(goal).inv() * Rotation.from_quat(rows[:, 3:7])
    return np.asarray(to_goal.magnitude())


@pytest.mark.parametrize("rotation", [True, False])
def test_a_push_dies_out_far_from_the_identity_where_the_error_is_a_rotation(
    rotation: bool,
) -> None:
    goal, push = np.array([2.4, 0.0, 0.0]), np.array([0.0, 0.2, 0.0])
    it = law()
    if not rotation:  # differences of rotation vectors, beside body rates: a circulatory stiffness
        it = Controller("it", MeasuredJoints(), PdFeedforward(KP, KD), NAMES, PERIOD)
    off = away(flown(it, Rotation.from_rotvec(goal), goal, 4000, push), goal)
    assert off[:50].max() > 1e-3
    if rotation:
        assert off[-1000:].max() < 1e-9
    else:
        assert off[-1000:].max() > 10.0 * off[:50].max()


@pytest.mark.first(8)
@pytest.mark.parametrize(
    ("name", "gains"),
    [
        ("pd_feedforward", {}),
        (
            "collocated_pid",
            {"kp": KP.tolist(), "ki": (0.05 * KP).tolist(), "kd": KD.tolist()},
        ),
        ("lqr", {"weights": {"time": 2.0}, "filter": {"disturbance_walk": 0.1}}),
        ("proportional_integral", {"weights": {"time": 4.0}, "filter": {"disturbance_walk": 0.1}}),
        ("output_feedback", {"weight_frequency": 0.5, "reaching_rate": 1.0}),
        ("model_predictive", {"weights": {"time": 2.0}, "filter": {"disturbance_walk": 0.1}}),
        ("linear", {"system": {"d": np.hstack((np.diag(KP), np.diag(KD))).tolist()}}),
    ],
)
@pytest.mark.parametrize("seed", range(3))
def test_the_loop_does_not_depend_on_the_inertial_frame(name: str, gains: Any, seed: int) -> None:
    rng = np.random.default_rng(seed)
    start, goal, frame = Rotation.random(3, rng)
    push = 0.2 * rng.standard_normal(3)
    one = flown(law(name, **gains), start, goal.as_rotvec(), 300, push)
    seen = frame * goal
    turned = seen.as_rotvec() * (1.0 + 2.0 * np.pi / seen.magnitude())  # a whole turn more
    two = flown(law(name, **gains), frame * start, turned, 300, push)
    np.testing.assert_allclose(two[:, 7:], one[:, 7:], atol=1e-9)
    path = frame * Rotation.from_quat(one[:, 3:7])
    assert (path.inv() * Rotation.from_quat(two[:, 3:7])).magnitude().max() < 1e-9


@pytest.mark.parametrize("seed", range(8))
def test_it_goes_from_any_attitude_to_any_other_the_shorter_way(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start, goal = Rotation.random(2, rng)
    to = goal.as_rotvec() * rng.choice([1.0, 1.0 + 2.0 * np.pi / goal.magnitude()])
    off = away(flown(law(), start, to, 600, np.zeros(3)), to)
    assert off[-1] < 1e-6
    assert off.max() < off[0] + 1e-9  # never away from the goal: no unwinding
