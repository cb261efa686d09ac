"""Goals as attitudes: every way leads to the same one, the least turn, from any start."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexslew_control.law import PlantDescription
from flexslew_control.planners import make_plan, plan_settings
from flexslew_control.planners.attitude.attitude_goal import joint_goal
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import read_testbed

NAMES = ("roll", "pitch", "yaw")
CRAFT = PlantDescription(
    read_testbed({"kind": "spacecraft", "appendages": {}}, "here"), 0.1, np.full(3, 100.0)
)


def asked(goal: Any, start: Vector | None = None) -> Vector:
    """Return the rotation vector that a goal asks for [rad]."""
    settings: Any = plan_settings({"method": "none", "goal": goal}, "here")
    first = None if start is None else dict(zip(NAMES, start.tolist(), strict=True))
    found = joint_goal(settings.goal, CRAFT, first)
    return np.array([found[name] for name in NAMES])


def apart(a: Vector, b: Rotation) -> float:
    return float((Rotation.from_rotvec(a).inv() * b).magnitude())


@pytest.mark.parametrize("seed", range(5))
def test_each_way_to_say_an_attitude_gives_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    goal = Rotation.random(1, rng)[0]
    axis, angle = goal.as_rotvec() / goal.magnitude(), float(goal.magnitude())
    order: Any = str(rng.choice(["zyx", "xyz", "zxz", "yxy"]))
    for way in (
        {"quaternion": (float(rng.uniform(-3.0, -1.0)) * goal.as_quat()).tolist()},
        {"axis": (2.0 * axis).tolist(), "angle": angle - 2.0 * np.pi},
        {"euler": goal.as_euler(order.upper()).tolist(), "order": order},
    ):
        assert apart(asked(way), goal) < 1e-12
        start = 3.0 * rng.standard_normal(3)
        after = Rotation.from_rotvec(start) * goal
        assert apart(asked({**way, "relative": True}, start), after) < 1e-12


@pytest.mark.parametrize("seed", range(5))
def test_a_boresight_turns_to_its_target_by_the_angle_between_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start, to, look = Rotation.random(1, rng)[0], rng.standard_normal(3), rng.standard_normal(3)
    goal = Rotation.from_rotvec(
        asked({"to": to.tolist(), "boresight": look.tolist()}, start.as_rotvec())
    )
    look, to = look / np.linalg.norm(look), to / np.linalg.norm(to)
    np.testing.assert_allclose(goal.apply(look), to, atol=1e-12)
    between = float(np.arccos(start.apply(look) @ to))
    assert (start.inv() * goal).magnitude() == pytest.approx(between, abs=1e-9)


@pytest.mark.parametrize("look", [*np.eye(3).tolist(), [1.0, -2.0, 0.5]])
def test_a_boresight_turns_right_round(look: list[float]) -> None:
    goal = Rotation.from_rotvec(asked({"to": [-x for x in look], "boresight": look}))
    np.testing.assert_allclose(goal.apply(look), [-x for x in look], atol=1e-12)


def test_a_goal_is_the_rotation_vector_next_to_the_start() -> None:
    start = np.array([3.0, 0.0, 0.0])
    np.testing.assert_allclose(
        asked({"axis": [1.0, 0.0, 0.0], "angle": "-180 deg"}, start), [np.pi, 0.0, 0.0]
    )
    np.testing.assert_allclose(
        asked({"quaternion": [0.0, 0.0, 0.0, 1.0]}, 2.0 * start), [2.0 * np.pi, 0.0, 0.0]
    )


@pytest.mark.parametrize(
    ("goal", "words"),
    [
        ({"quaternion": [0.0, 0.0, 0.0, 0.0]}, "must not be zero"),
        ({"axis": [1.0, 0.0, 0.0]}, "give one of"),
        ({"euler": [0.1, 0.2, 0.3]}, "give one of"),
        ({"angle": 1.0, "to": [0.0, 0.0, 1.0]}, "give one of"),
        ({"euler": [0.1, 0.2, 0.3], "order": "xxz"}, "order"),
        ({"to": [0.0, 0.0, 1.0], "roll": 1.0}, "unknown key"),
    ],
)
def test_half_a_goal_or_two_are_refused(goal: Any, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        plan_settings({"method": "time_optimal", "goal": goal}, "here")


def test_joints_that_read_no_attitude_have_no_attitude_to_go_to() -> None:
    held = {"kind": "spacecraft", "appendages": {}, "platform": {"motion": "pivot"}}
    plant = PlantDescription(read_testbed(held, "here"), 0.1, np.full(3, 100.0))
    settings = plan_settings({"method": "none", "goal": {"to": [1.0, 0.0, 0.0]}}, "here")
    with pytest.raises(BadInput, match="do not read an attitude"):
        make_plan(settings, plant)
