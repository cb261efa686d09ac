"""What no spacecraft may break: momentum, energy, the choice of the inertial frame."""

from dataclasses import replace

import numpy as np
import pytest
from tests.plant.testbeds.spacecraft.crafts import (
    attitude,
    energy,
    fly,
    mass_and_bias,
    momenta,
    random_craft,
    random_state,
)

from flexslew_plant.testbeds.spacecraft.assembly.craft import (
    Appendage,
    PrescribedRotation,
    Spacecraft,
)
from flexslew_plant.testbeds.spacecraft.assembly.packing import packed
from flexslew_plant.testbeds.spacecraft.equations import layout as at

SEEDS = [(seed, seed % 5) for seed in range(5)]  # with 0 to 4 appendages


def still(craft: Spacecraft) -> np.ndarray:
    return np.zeros(len(craft.drives))


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "appendages"), SEEDS)
def test_without_forces_momentum_and_energy_stay(seed: int, appendages: int) -> None:
    craft = random_craft(seed, appendages)
    p, x = packed(craft), random_state(craft, seed)
    linear, angular = momenta(craft, p, 0.0, x)
    before = energy(craft, p, x)
    after = fly(p, 0.0, x, still(craft), craft.sizes[1], 0.02, 5000)  # 100 s
    linear_after, angular_after = momenta(craft, p, 100.0, after)
    assert np.linalg.norm(linear_after - linear) < 1e-12 * np.linalg.norm(linear)
    arm = np.linalg.norm(angular) + np.linalg.norm(after[:3]) * np.linalg.norm(linear)
    assert np.linalg.norm(angular_after - angular) < 1e-12 * arm
    assert abs(energy(craft, p, after) / before - 1.0) < 1e-9
    assert abs(np.linalg.norm(after[3:7]) - 1.0) < 1e-9


@pytest.mark.parametrize(("seed", "appendages"), SEEDS)
def test_the_motion_does_not_depend_on_the_inertial_frame(seed: int, appendages: int) -> None:
    craft = random_craft(seed, appendages, hinges=(0, 1, 2))
    p, x = packed(craft), random_state(craft, seed)
    rng = np.random.default_rng(100 + seed)
    effort = rng.standard_normal(len(craft.drives))
    turn, shift = rng.standard_normal(4), rng.standard_normal(3)
    turn /= np.linalg.norm(turn)
    other = x.copy()
    other[:3], other[3:7] = shift + attitude(turn) @ x[:3], product(turn, x[3:7])
    nv = craft.sizes[1]
    after = fly(p, 0.0, x, effort, nv, 0.01, 300)
    other_after = fly(p, 0.0, other, effort, nv, 0.01, 300)
    np.testing.assert_allclose(other_after[7:], after[7:], rtol=0, atol=1e-10 * abs(after).max())
    expected = shift + attitude(turn) @ after[:3]
    np.testing.assert_allclose(other_after[:3], expected, atol=1e-9 * abs(expected).max())
    np.testing.assert_allclose(
        attitude(other_after[3:7]), attitude(turn) @ attitude(after[3:7]), atol=1e-9
    )


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the product of two quaternions x y z w."""
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.append(vector, a[3] * b[3] - a[:3] @ b[:3])


@pytest.mark.parametrize("profile", [at.SMOOTH, at.BANG_BANG, at.TABLE])
def test_a_prescribed_hinge_keeps_the_momentum_of_a_driven_one(profile: int) -> None:
    craft = random_craft(11, 1, hinges=(at.DRIVEN,))
    driven = craft.appendages[0]
    table = np.array([[0.0, 0, 0, 0], [0.4, 0.3, 1.0, 1.5], [1.0, 1.0, 0, 0]])
    turn = PrescribedRotation(0.5, 2.0, 1.2, driven.axis, profile, table)
    drives = tuple(d for d in craft.drives if d.what != at.HINGE)
    moved = replace(driven, hinge=at.PRESCRIBED, spring=0.0, manoeuvres=(turn,))
    craft = replace(craft, appendages=(moved,), drives=drives)
    p, x = packed(craft), random_state(craft, 3)
    # a bang-bang turn jumps at its ends and in its middle, at 1.5 s: look between the jumps
    for begin, end in ((0.6, 1.4), (1.6, 2.4)):
        after = fly(p, begin, x, still(craft), craft.sizes[1], (end - begin) / 400, 400)
        before = whole_momentum(craft, driven, turn, begin, x)
        for one, other in zip(whole_momentum(craft, driven, turn, end, after), before, strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-9 * abs(other).max())


def whole_momentum(
    craft: Spacecraft, driven: Appendage, turn: PrescribedRotation, t: float, x: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the momenta with the hinge's prescribed angle and rate put in as a joint's."""
    h = 1e-5
    s = np.clip((np.array([t, t - h, t + h]) - turn.begin) / turn.duration, 0.0, 1.0)
    share = [progress(turn, value) for value in s]
    rate = (share[2] - share[1]) / (2.0 * h)
    twin = replace(craft, appendages=(replace(driven, spring=0.0),), drives=())
    nq = craft.sizes[0]
    state = np.concatenate((x[:7], [turn.angle * share[0]], x[7:nq], x[nq : nq + 6]))
    state = np.concatenate((state, [turn.angle * rate], x[nq + 6 :]))
    return momenta(twin, packed(twin), t, state)


def progress(turn: PrescribedRotation, s: float) -> float:
    """Return the share of the turn that is done, from the profiles' closed forms."""
    if turn.profile == at.SMOOTH:
        return float(s - np.sin(2 * np.pi * s) / (2 * np.pi))
    if turn.profile == at.BANG_BANG:
        return 2 * s * s if s < 0.5 else 1 - 2 * (1 - s) ** 2
    from scipy.interpolate import BPoly

    rows = turn.table
    return float(BPoly.from_derivatives(rows[:, 0], rows[:, 1:])(s))


def test_a_wheel_takes_the_momentum_that_the_platform_loses() -> None:
    craft = random_craft(2, 2, hinges=(at.FIXED,))
    p, x = packed(craft), random_state(craft, 2)
    effort = np.array([-0.05 if d.what == at.WHEEL else 0.0 for d in craft.drives])
    _, before = momenta(craft, p, 0.0, x)
    after = fly(p, 0.0, x, effort, craft.sizes[1], 0.01, 500)
    _, angular = momenta(craft, p, 5.0, after)
    np.testing.assert_allclose(angular, before, atol=1e-11 * abs(before).max())
    assert after[7] > 5.0  # the wheel has turned


@pytest.mark.parametrize("motion", [at.FREE, at.HELD, at.PIVOT])
@pytest.mark.parametrize("seed", range(5))
def test_the_mass_matrix_is_symmetric_and_positive_definite(seed: int, motion: int) -> None:
    craft = random_craft(seed, seed % 5, motion, (0, 1, 2))
    p, x = packed(craft), random_state(craft, seed)
    mass, _ = mass_and_bias(p, 0.7, x, craft.sizes[1])
    np.testing.assert_allclose(mass, mass.T, atol=1e-12 * abs(mass).max())
    assert np.linalg.eigvalsh(mass).min() > 0.0
