"""What is left of a linear system without the states that nothing moves or sees."""

from typing import Any

import control
import numpy as np
import pytest
from scipy.linalg import block_diag, expm

import flexslew as fs
from flexslew_plant.arrays import Matrix

POINTS = 1j * np.logspace(-2.0, 1.5, 30) * (1.0 + 0.02j)  # beside the poles on the axis


def moved(rng: np.random.Generator, modes: int, rigid: bool, damped: float) -> Matrix:
    """Return modes of distinct frequencies and a rigid motion."""
    w = np.geomspace(0.3, 20.0, modes) * rng.uniform(0.9, 1.1, modes)
    blocks = [np.array([[0.0, 1.0], [-(f**2), -2.0 * damped * f]]) for f in w]
    return np.asarray(block_diag(*blocks, *([[[0.0, 1.0], [0.0, 0.0]]] if rigid else [])))


def system(seed: int, sampled: bool) -> tuple[Any, Any]:
    """Return a minimal system, and the same with states that nothing moves or sees, mixed."""
    rng = np.random.default_rng(seed)
    rigid = bool(rng.integers(2))
    a = moved(rng, int(rng.integers(1, 4)), rigid, rng.choice([0.0, 0.01]))
    n, m, outputs = len(a), 2, 2
    b = np.zeros((n, m))
    b[1::2] = rng.normal(size=(n // 2, m))
    c = np.zeros((outputs, n))
    c[:, ::2] = rng.normal(size=(outputs, n // 2))
    unmoved, unseen = moved(rng, 2, not rigid, 0.0), moved(rng, 1, not rigid, 0.02)
    k, u = len(unmoved), len(unseen)
    big_a = block_diag(a, unmoved, unseen)
    big_a[n + k :, :n] = rng.normal(size=(u, n))  # what is seen moves it
    big_a[:n, n : n + k] = rng.normal(size=(n, k))  # what nothing moves drives what is seen
    big_b = np.vstack((b, np.zeros((k, m)), rng.normal(size=(u, m))))
    big_c = np.hstack((c, rng.normal(size=(outputs, k)), np.zeros((outputs, u))))
    turn = np.linalg.qr(rng.normal(size=(n + k + u,) * 2))[0] * 10.0 ** rng.uniform(-2, 2)
    back = np.linalg.inv(turn)
    whole = back @ big_a @ turn, back @ big_b, big_c @ turn
    found = []
    for one in ((a, b, c), whole):
        if sampled:
            size = len(one[0])
            both = expm(0.05 * np.block([[one[0], one[1]], [np.zeros((m, size + m))]]))
            one = both[:size, :size], both[:size, size:], one[2]
        found.append(control.ss(*one, 0.0, 0.05 if sampled else 0.0))
    return found[0], found[1]


@pytest.mark.parametrize("sampled", [False, True])
@pytest.mark.parametrize("seed", range(12))
def test_of_a_mixed_system_the_minimal_one_is_left(seed: int, sampled: bool) -> None:
    least, whole = system(seed, sampled)
    found = fs.minimal(whole, 1e-6)  # states that are mixed leave more than rounding
    assert found.nstates == least.nstates
    assert (found.input_labels, found.dt) == (whole.input_labels, whole.dt)
    points = np.exp(0.05 * POINTS) if sampled else POINTS
    expected, left = least(points), found(points)
    assert (abs(left - expected).max((0, 1)) < 1e-5 * abs(expected).max((0, 1))).all()


@pytest.mark.parametrize("name", ["m1", "own_spacecraft", "three_axes"])
def test_a_plant_of_the_bench_has_a_regulator_for_what_is_left_of_it(name: str) -> None:
    plant = fs.linear_model(name, sampled=True)
    heard = [label for label in plant.output_labels if label.startswith(("position", "rate"))]
    found = fs.minimal(plant[heard, :])
    gain, _, poles = control.dlqr(found.A, found.B, found.C.T @ found.C, np.eye(found.ninputs))
    assert abs(poles).max() < 1.0
    assert gain.shape == (found.ninputs, found.nstates)
    z = np.exp(plant.dt * POINTS)
    whole = plant[heard, :](z)
    assert abs(found(z) - whole).max() < 1e-6 * abs(whole).max()


def test_nothing_is_left_of_what_nothing_moves() -> None:
    found = fs.minimal(control.ss(-np.eye(2), np.zeros((2, 1)), np.ones((1, 2)), 3.0))
    assert found.nstates == 0
    assert found.D == 3.0


def test_a_transfer_function_may_have_common_factors() -> None:
    found = fs.minimal(control.tf([1.0, 2.0], [1.0, 3.0, 2.0]))
    np.testing.assert_allclose(found.poles(), [-1.0])


@pytest.mark.parametrize("where", range(4))
def test_a_system_with_nan_is_refused(where: int) -> None:
    parts = [np.array([[np.nan if k == where else 1.0]]) for k in range(4)]
    with pytest.raises(fs.BadInput, match="not finite"):
        fs.minimal(control.ss(*parts))
