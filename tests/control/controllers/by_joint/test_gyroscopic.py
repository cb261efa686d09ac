"""PD and PID with the gyroscopic torque: a craft turns about its eigenaxis; it is w x J w."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexslew_control.controllers import build_controller
from flexslew_control.controllers.by_joint.gyroscopic import gyroscopic
from flexslew_control.law import PlantDescription
from flexslew_control.plan import Plan
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.hardware.sensors import exact_readings
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds import default_testbed, read_testbed

PERIOD, NAMES = 0.02, ("roll", "pitch", "yaw")
INERTIA = np.array([10.0, 14.0, 20.0])  # [kg m^2]
CRAFT = read_testbed(
    {
        "kind": "spacecraft",
        "platform": {"inertia": dict(zip(("xx", "yy", "zz"), INERTIA, strict=True))},
        "appendages": {},
        "actuators": {
            name: {"kind": "torque", "direction": axis.tolist(), "limit": 1e3}
            for name, axis in zip(NAMES, np.eye(3), strict=True)
        },
    },
    "here",
)


def off_the_axis(goal: Vector, with_it: bool, law: str) -> float:
    """Return how far a step of the reference strays from its eigenaxis [rad]."""
    model = CRAFT.model()
    keys = {"kp": (0.3 * INERTIA).tolist(), "kd": (0.8 * INERTIA).tolist(), "gyroscopic": with_it}
    if law == "collocated_pid":
        keys["ki"] = (0.03 * INERTIA).tolist()
    plant = PlantDescription(CRAFT, PERIOD, np.full(3, 1e3))
    it = build_controller("it", law, keys, plant, "here")
    still, none = np.zeros((2, 3)), np.zeros((2, 0))
    plan = Plan("none", NAMES, 0.0, PERIOD, still + goal, still, still[:1], none, PERIOD)
    assert it.adopt(plan) is None
    x, effort, rows = np.concatenate((model.rest({}), np.zeros(6))), np.zeros(3), []
    for k in range(3000 if "ki" in keys else 1500):
        seen = exact_readings(model, x, effort, k * PERIOD)
        answer = it.observe(Measurement(k, 0, k * PERIOD, "it", *seen, effort))
        assert answer is not None
        effort = answer.command.effort
        x = model.advance(x, effort, PERIOD)
        rows.append(x[3:7])
    turned = Rotation.from_quat(np.array(rows)).as_rotvec()
    axis = goal / np.linalg.norm(goal)
    assert np.linalg.norm(turned[-1] - goal) < 1e-3
    return float(np.linalg.norm(turned - np.outer(turned @ axis, axis), axis=1).max())


@pytest.mark.parametrize(("law", "seed"), [("pd_feedforward", 0), ("collocated_pid", 1)])
def test_with_it_a_law_turns_a_craft_about_the_eigenaxis(law: str, seed: int) -> None:
    axis = np.random.default_rng(seed).standard_normal(3)
    goal = 2.5 * axis / np.linalg.norm(axis)
    without, strays = (off_the_axis(goal, with_it, law) for with_it in (False, True))
    assert strays < 0.05 * without  # what is left is that of the hold
    assert without > 1e-3


def test_it_is_the_gyroscopic_torque() -> None:
    w = np.array([0.3, -0.5, 0.7])
    found = gyroscopic(CRAFT, "gyroscopic").efforts(w)
    np.testing.assert_allclose(found, np.cross(w, INERTIA * w), atol=1e-12)


def test_a_testbed_of_joints_has_none() -> None:
    with pytest.raises(BadInput, match="do not turn it in three axes"):
        gyroscopic(default_testbed(), "gyroscopic")
