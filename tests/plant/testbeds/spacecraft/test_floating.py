"""A free platform told by its pose, rates and wrench: against its equations of motion."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.contract import CanFloat, Floating

RIGID: dict[str, Any] = {
    "kind": "spacecraft",
    "platform": {"mass": 50.0, "inertia": {"xx": 30.0, "yy": 40.0, "zz": 25.0, "xy": 2.0}},
}


def floating(testbed: Any) -> Floating:
    assert isinstance(testbed, CanFloat)
    found = testbed.floating()
    assert found is not None
    return found


def at_random(testbed: Any, seed: int) -> Vector:
    model, generator = testbed.model(), np.random.default_rng(seed)
    x: Vector = generator.normal(0.0, 0.1, model.positions + model.coordinates)
    x[3:7] /= np.linalg.norm(x[3:7])
    return x


@pytest.mark.parametrize("seed", range(5))
def test_force_and_torque_are_those_that_a_rigid_body_accelerates_by(seed: int) -> None:
    pushes = {
        "push": {"kind": "force", "direction": [1, 2, 0], "place": [0.1, 0.3, -0.2], "limit": 9.0},
        "turn": {"kind": "torque", "direction": [0, 0, 1], "limit": 9.0},
    }
    testbed = read_testbed({**RIGID, "actuators": pushes}, "test")
    model, x = testbed.model(), at_random(testbed, seed)
    effort = np.random.default_rng(seed).normal(0.0, 3.0, 2)
    force, torque = floating(testbed).wrench(x, effort, 0.0)
    along = np.array([1.0, 2.0, 0.0]) / np.sqrt(5.0)
    np.testing.assert_allclose(force, effort[0] * along, atol=1e-12)
    arm = np.cross([0.1, 0.3, -0.2], force)
    np.testing.assert_allclose(torque, arm + np.array([0.0, 0.0, effort[1]]), atol=1e-12)
    moved = model.derivative(x, effort) - model.derivative(x, np.zeros(2))
    inertia = np.array([[30.0, 2.0, 0.0], [2.0, 40.0, 0.0], [0.0, 0.0, 25.0]])
    np.testing.assert_allclose(50.0 * moved[7:10], force, atol=1e-9)
    np.testing.assert_allclose(inertia @ moved[10:13], torque, atol=1e-9)


def test_what_spins_a_wheel_up_turns_the_platform_the_other_way() -> None:
    wheel = {"axis": [0.0, 0.6, 0.8], "inertia": 0.5, "limit": 2.0}
    testbed = read_testbed({**RIGID, "actuators": {}, "wheels": {"w": wheel}}, "test")
    model, x = testbed.model(), at_random(testbed, 1)
    force, torque = floating(testbed).wrench(x, np.array([1.5]), 0.0)
    assert not force.any()
    np.testing.assert_allclose(torque, [0.0, 0.9, 1.2], atol=1e-12)
    still = np.zeros_like(x)
    still[6] = 1.0
    rates = model.derivative(still, np.array([1.5]))[model.positions + 3 : model.positions + 6]
    inertia = np.array([[30.0, 2.0, 0.0], [2.0, 40.0, 0.0], [0.0, 0.0, 25.0]])
    axis = np.array([0.0, 0.6, 0.8])
    without = inertia - 0.5 * np.outer(axis, axis)  # the wheel does not turn along about its axis
    np.testing.assert_allclose(without @ rates, torque, atol=1e-9)


def test_pose_and_rates_are_of_the_frame_that_is_drawn_and_of_its_motion() -> None:
    testbed = read_testbed(RIGID, "test")
    model, x = testbed.model(), at_random(testbed, 3)
    place, attitude, velocity, rate = floating(testbed).motion(x)
    (frame,) = testbed.scene().frames_at(x[: model.positions], 0.0)
    np.testing.assert_array_equal(place, frame.translation)
    np.testing.assert_array_equal(attitude, frame.rotation)
    slope = model.derivative(x, np.zeros(model.efforts))
    moved = Rotation.from_quat(attitude).apply(velocity)
    np.testing.assert_allclose(slope[:3], moved, atol=1e-12)
    vector, scalar = attitude[:3], attitude[3]
    np.testing.assert_allclose(
        slope[3:6], 0.5 * (scalar * rate + np.cross(vector, rate)), atol=1e-12
    )
    assert slope[6] == pytest.approx(-0.5 * vector @ rate, abs=1e-12)


@pytest.mark.parametrize("motion", ["held", "pivot"])
def test_a_platform_that_is_carried_does_not_float(motion: str) -> None:
    carried = {**RIGID, "platform": {**RIGID["platform"], "motion": motion}}
    turn = {"yaw": {"kind": "torque", "direction": [0, 0, 1], "limit": 9.0}}
    boom = {"shape": {"kind": "beam", "length": 4.0, "linear_density": 0.5,
                      "bending_stiffness": 50.0, "modes": 1}}  # fmt: skip
    testbed = read_testbed({**carried, "actuators": turn, "appendages": {"boom": boom}}, "test")
    assert isinstance(testbed, CanFloat)
    assert testbed.floating() is None
