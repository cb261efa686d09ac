"""Allocation against linear programs and pseudo-inverses, over random sets of drives."""

import numpy as np
import pytest
from scipy.optimize import linprog

from flexslew_control.allocation.gyro_set import GyroSet
from flexslew_control.allocation.thruster_set import ThrusterSet
from flexslew_control.allocation.wheel_set import WheelSet
from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput


def spanning(rng: np.random.Generator, count: int) -> Matrix:
    """Return levers of thrusters that give any torque, shape (3, count)."""
    while True:
        levers = rng.standard_normal((3, count))
        if linprog(np.ones(count), A_eq=levers, b_eq=np.zeros(3), bounds=(1.0, None)).status == 0:
            return levers


@pytest.mark.parametrize("seed", range(8))
def test_thrusters_give_the_torque_with_the_least_propellant(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(4, 13))
    levers, limit = spanning(rng, count), rng.uniform(1.0, 3.0, count)
    jets = ThrusterSet.of(levers, limit, ("a",))
    for _ in range(20):
        torque = rng.standard_normal(3) * 10.0 ** rng.uniform(-4.0, -0.5)
        pushes = jets.efforts(torque)
        assert (pushes >= 0.0).all()
        best = linprog(np.ones(count), A_eq=levers, b_eq=torque, bounds=(0.0, None))
        assert best.x is not None
        if (best.x <= limit).all():
            np.testing.assert_allclose(levers @ pushes, torque, rtol=1e-9, atol=1e-15)
            assert pushes.sum() == pytest.approx(best.fun, rel=1e-7)


def test_beyond_the_limits_the_direction_stays() -> None:
    rng = np.random.default_rng(3)
    levers, limit = spanning(rng, 8), np.full(8, 0.5)
    jets = ThrusterSet.of(levers, limit, ("a",))
    for torque in 100.0 * rng.standard_normal((20, 3)):
        pushes = jets.efforts(torque)
        given = levers @ pushes
        assert pushes.max() == pytest.approx(0.5)
        np.testing.assert_allclose(
            given / np.linalg.norm(given), torque / np.linalg.norm(torque), atol=1e-9
        )
    assert not jets.efforts(np.zeros(3)).any()


@pytest.mark.parametrize("seed", range(20))
def test_thrusters_that_lack_a_torque_are_refused_just_then(seed: int) -> None:
    rng = np.random.default_rng(seed)
    levers = rng.standard_normal((3, 5))
    whole = linprog(np.zeros(5), A_eq=levers, b_eq=np.zeros(3), bounds=(1.0, None)).status == 0
    if whole:
        ThrusterSet.of(levers, np.ones(5), ("a",))
    else:
        with pytest.raises(BadInput, match="can be given; add thrusters"):
            ThrusterSet.of(levers, np.ones(5), ("a", "b"))


def wheel_set(rng: np.random.Generator, count: int, gain: float = 0.5) -> WheelSet:
    axes = rng.standard_normal((3, count))
    axes /= np.linalg.norm(axes, axis=0)
    bias = 0.1 * rng.standard_normal(count)
    return WheelSet(axes, np.full(count, 0.4), rng.uniform(0.01, 0.05, count), gain, bias)


@pytest.mark.parametrize("count", [3, 4, 5, 8])
def test_wheels_give_the_torque_whatever_their_null_motion(count: int) -> None:
    rng = np.random.default_rng(count)
    wheels = wheel_set(rng, count)
    for _ in range(50):
        torque, speeds = 0.15 * rng.standard_normal(3), 300.0 * rng.standard_normal(count)
        plain = np.linalg.pinv(wheels.torque) @ torque
        efforts = wheels.efforts(torque, speeds)
        assert abs(efforts).max() <= 0.4 * (1.0 + 1e-12)
        if abs(plain).max() <= 0.4:
            np.testing.assert_allclose(wheels.torque @ efforts, torque, atol=1e-12)
            np.testing.assert_allclose(wheels.efforts(torque, None), plain, atol=1e-14)
    assert (
        np.linalg.norm(np.cross(wheels.torque @ wheels.efforts(9.0 * torque, None), torque)) < 1e-9
    )


@pytest.mark.parametrize("count", [4, 6])
def test_null_motion_ends_at_the_bias_with_the_stored_momentum_as_it_was(count: int) -> None:
    """I s' = -u on a craft that nothing turns."""
    rng = np.random.default_rng(count)
    wheels = wheel_set(rng, count)
    speeds = 20.0 * rng.standard_normal(count)
    stored = wheels.stored(speeds)
    for _ in range(4000):
        speeds = speeds - 0.05 * wheels.efforts(np.zeros(3), speeds) / wheels.inertia
    inverse = np.linalg.pinv(wheels.torque)
    expected = inverse @ stored + (np.eye(count) - inverse @ wheels.torque) @ wheels.bias
    np.testing.assert_allclose(wheels.inertia * speeds, expected, atol=1e-9)
    np.testing.assert_allclose(wheels.stored(speeds), stored, atol=1e-12)


def pyramid(robustness: float, dither: float, gain: float = 0.0) -> GyroSet:
    """Return four gyros on the faces of a pyramid, 54.74 deg steep."""
    turn = 0.5 * np.pi * np.arange(4)
    c, s, none = np.cos(turn), np.sin(turn), np.zeros(4)
    steep = np.arctan(np.sqrt(2.0))
    axes = np.array([np.sin(steep) * c, np.sin(steep) * s, np.cos(steep) + none]).T
    rotors = np.array([-s, c, none]).T
    both = np.stack((axes, rotors), axis=1)
    return GyroSet(both, np.full(4, 2.0), np.ones(4), robustness, dither, 3.0, gain, np.zeros(4))


def test_away_from_singularities_gyros_give_the_torque_whatever_their_null_motion() -> None:
    rng = np.random.default_rng(5)
    gyros = pyramid(0.0, 0.0, 0.3)
    for _ in range(100):
        torque, angles = 0.3 * rng.standard_normal(3), rng.uniform(-0.5, 0.5, 4)
        efforts = gyros.efforts(torque, angles, 0.0)
        np.testing.assert_allclose(gyros.torque_matrix(angles) @ efforts, torque, atol=1e-12)
    huge = gyros.efforts(90.0 * torque, angles, 0.0)
    assert abs(huge).max() <= 2.0 * (1.0 + 1e-12)
    given = gyros.torque_matrix(angles) @ huge
    assert np.linalg.norm(np.cross(given, torque)) < 1e-9 * np.linalg.norm(torque)


@pytest.mark.parametrize(("dither", "passes"), [(0.0, False), (0.2, True)])
def test_a_torque_along_x_passes_the_inner_singularity_of_the_pyramid_with_a_dither_alone(
    dither: float, passes: bool
) -> None:
    """From rest it leads to gimbals at (-90, 0, 90, 0) deg, with 1.15 of 3.15 h along x stored.

    There the regularised inverse without a dither answers with no rate at all (Wie, Bailey and
    Heiberg 2001).
    """
    gyros, angles, step = pyramid(0.1, dither), np.zeros(4), 0.02
    asked = np.array([-0.3, 0.0, 0.0])  # on the platform, so the gyros store along +x
    for k in range(1500):
        angles = angles - step * gyros.efforts(asked, angles, k * step)  # d' = -u / h, h = 1
    axes, rotors = gyros.gimbals[:, 0], gyros.gimbals[:, 1]
    across = np.cross(axes, rotors)
    stored = np.cos(angles)[:, None] * rotors + np.sin(angles)[:, None] * across
    along = float(stored.sum(axis=0)[0])
    assert (along > 2.8) == passes
    assert (along < 1.2) != passes


def test_null_motion_brings_gimbals_back_without_a_torque() -> None:
    gyros, angles = pyramid(0.1, 0.2, 0.5), np.array([0.4, -0.4, 0.4, -0.4])  # stores nothing
    given = np.zeros(3)
    for k in range(2000):
        effort = gyros.efforts(np.zeros(3), angles, 0.02 * k)
        given = np.maximum(given, abs(gyros.torque_matrix(angles) @ effort))
        angles = angles - 0.02 * effort
    assert given.max() < 1e-12
    assert abs(angles).max() < 1e-3


def test_gyros_whose_torques_lie_in_a_plane_are_refused() -> None:
    flat = np.stack((np.tile([0.0, 0.0, 1.0], (3, 1)), np.eye(3)[[0, 1, 0]]), axis=1)
    with pytest.raises(BadInput, match="lie in a plane; turn a rotor"):
        GyroSet(flat, np.ones(3), np.ones(3), 0.1, 0.2, 3.0, 0.0, np.zeros(3))


def test_wheels_in_a_plane_are_refused() -> None:
    axes = np.array([[1.0, 0.0, 0.6, 0.8], [0.0, 1.0, 0.8, -0.6], [0.0, 0.0, 0.0, 0.0]])
    with pytest.raises(BadInput, match="lie in a plane"):
        WheelSet(axes, np.ones(4), np.ones(4), 0.0, np.zeros(4))
