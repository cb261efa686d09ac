import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexslew_plant.testbeds.orientation.attitude import AttitudeJoints, attitude_joints


def test_the_turn_between_is_that_of_another_library() -> None:
    rng = np.random.default_rng(1)
    a, b = 3.0 * rng.standard_normal((2, 500, 3))
    expected = Rotation.from_rotvec(a).inv() * Rotation.from_rotvec(b)
    error = AttitudeJoints(np.eye(3)).error(a, b)
    assert (expected.inv() * Rotation.from_rotvec(error)).magnitude().max() < 1e-12
    assert np.linalg.norm(error, axis=1).max() <= np.pi


@pytest.mark.parametrize("axis", range(3))
def test_about_one_axis_the_error_is_the_difference_to_the_bit(axis: int) -> None:
    rng = np.random.default_rng(axis)
    joints = AttitudeJoints(np.eye(3))
    measured, goal = np.zeros((2, 200, 3))
    measured[:, axis], goal[:, axis] = rng.uniform(-1.5, 1.5, (2, 200))
    assert (joints.error(measured, goal) == goal - measured).all()
    assert (joints.about(goal, measured) == measured).all()


def test_skew_and_redundant_axes_read_the_same_turn_and_other_joints_their_difference() -> None:
    rng = np.random.default_rng(3)
    axes = np.vstack((rng.standard_normal((4, 3)), np.zeros(3)))
    joints = attitude_joints(axes / np.maximum(np.linalg.norm(axes, axis=1), 1e-9)[:, None])
    assert joints is not None
    a, b = rng.standard_normal((2, 3))
    measured, goal = joints.axes @ a, joints.axes @ b
    measured[4], goal[4] = 0.3, 1.0
    error = joints.error(measured, goal)
    turn = (Rotation.from_rotvec(a).inv() * Rotation.from_rotvec(b)).as_rotvec()
    np.testing.assert_allclose(error[:4], joints.axes[:4] @ turn, atol=1e-12)
    assert error[4] == 0.7
    np.testing.assert_allclose(goal - joints.about(goal, measured), error, atol=1e-12)


def test_two_axes_do_not_tell_an_attitude_and_a_dead_sensor_stays_dead() -> None:
    assert attitude_joints(np.eye(3)[:2]) is None
    assert np.isnan(AttitudeJoints(np.eye(3)).error(np.full(3, np.nan), np.ones(3))).all()
