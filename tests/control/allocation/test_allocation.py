"""Allocation against linear programs and pseudo-inverses, over random sets of drives."""

import numpy as np
import pytest
from scipy.optimize import linprog

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
        pushes = jets.pushes(torque)
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
        pushes = jets.pushes(torque)
        given = levers @ pushes
        assert pushes.max() == pytest.approx(0.5)
        np.testing.assert_allclose(
            given / np.linalg.norm(given), torque / np.linalg.norm(torque), atol=1e-9
        )
    assert not jets.pushes(np.zeros(3)).any()


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


def test_wheels_in_a_plane_are_refused() -> None:
    axes = np.array([[1.0, 0.0, 0.6, 0.8], [0.0, 1.0, 0.8, -0.6], [0.0, 0.0, 0.0, 0.0]])
    with pytest.raises(BadInput, match="lie in a plane"):
        WheelSet(axes, np.ones(4), np.ones(4), 0.0, np.zeros(4))
