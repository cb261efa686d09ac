"""Measures of a closed loop agree with definitions, and their gradients with differences."""

import numpy as np
import pytest

from flexslew_lab.tuning.closed_loop import ClosedLoop, PerformancePlant
from flexslew_lab.tuning.norms import Norm, damping, decay, h_infinity, h_two, stability
from flexslew_plant.arrays import Matrix

pytest.importorskip("ctrlsys")
NORMS = (stability, decay, damping, h_infinity, h_two)


def plant(period: float, seed: int = 3) -> PerformancePlant:
    """Return a random stable plant of four states with two signals of each kind."""
    rng = np.random.default_rng(seed)
    a = rng.standard_normal((4, 4))
    a = a - (np.linalg.eigvals(a).real.max() + 0.5) * np.eye(4)
    if period:
        a = np.eye(4) + period * a
    b, c = rng.standard_normal((4, 4)), rng.standard_normal((4, 4))
    d = np.zeros((4, 4))
    d[2:, 2:] = 0.1 * rng.standard_normal((2, 2))
    if period:
        d[:2, :2] = rng.standard_normal((2, 2))
    return PerformancePlant(a, b, c, d, 2, 2, period)


@pytest.mark.parametrize("period", [0.0, 0.05])
@pytest.mark.parametrize("norm", NORMS, ids=lambda norm: norm.__name__)
def test_gradients_in_the_controller_agree_with_differences(norm: Norm, period: float) -> None:
    one, k = plant(period), 0.05 * np.arange(4.0).reshape(2, 2)
    loop = one.closed(k)
    found = loop.gradient(norm(loop).gradient)
    step, numeric = 1e-6, np.zeros((2, 2))
    for i in np.ndindex(2, 2):
        unit = np.zeros((2, 2))
        unit[i] = step
        ends = [norm(one.closed(k + sign * unit)).value for sign in (1.0, -1.0)]
        numeric[i] = (ends[0] - ends[1]) / (2.0 * step)
    assert found == pytest.approx(numeric, rel=1e-4, abs=1e-6 * abs(numeric).max())


def test_the_loop_is_that_of_its_equations() -> None:
    one, k = plant(0.0), np.array([[0.3, -0.1], [0.2, 0.4]])
    a, b, c, d = one.closed(k).parts
    w, s = np.array([0.7, -0.4]), 0.3 + 1.1j
    resolvent = np.linalg.inv(s * np.eye(4) - one.a)
    p = one.c @ resolvent @ one.b + one.d
    y = np.linalg.solve(np.eye(2) - p[2:, 2:] @ k, p[2:, :2] @ w)
    z = p[:2, :2] @ w + p[:2, 2:] @ k @ y
    assert (c @ np.linalg.inv(s * np.eye(4) - a) @ b + d) @ w == pytest.approx(z)


def test_a_gain_around_a_controller_is_that_controller_changed() -> None:
    one, k = plant(0.05), np.array([[0.3, -0.1], [0.2, 0.4]])
    left, right = np.array([[1.0], [0.5]]), np.array([[0.2, -0.3]])
    inner = one.around(k, left, right)
    direct = one.closed(k + left @ np.array([[0.4]]) @ right)
    assert inner.closed(np.array([[0.4]])).matrix == pytest.approx(direct.matrix)


def test_the_peak_of_a_resonance_is_its_closed_form() -> None:
    """1 / (s^2 + 2 z s + 1) has its peak 1 / (2 z sqrt(1 - z^2)) at sqrt(1 - 2 z^2)."""
    z = 0.02
    matrix = np.array([[0.0, 1.0, 0.0], [-1.0, -2.0 * z, 1.0], [1.0, 0.0, 0.0]])
    found = h_infinity(loop_of(matrix, 2))
    assert found.value == pytest.approx(0.5 / (z * np.sqrt(1.0 - z**2)), rel=1e-6)
    assert found.frequency == pytest.approx(np.sqrt(1.0 - 2.0 * z**2), rel=1e-4)


def test_h_two_is_the_energy_of_the_pulse_response() -> None:
    one = plant(0.05)
    a, b, c, d = (loop := one.closed(np.zeros((2, 2)))).parts
    energy, state = float(np.sum(d * d)), b
    for _ in range(3000):
        energy += float(np.sum((c @ state) ** 2))
        state = a @ state
    assert h_two(loop).value ** 2 == pytest.approx(energy)


@pytest.mark.parametrize("norm", [decay, damping, h_infinity, h_two])
@pytest.mark.parametrize("period", [0.0, 0.05])
def test_a_loop_that_is_not_stable_has_no_norm(norm: Norm, period: float) -> None:
    a = 1.01 if period else 0.1
    matrix = np.array([[a, 1.0], [1.0, 0.0]])
    assert norm(loop_of(matrix, 1, period)).value == np.inf
    assert stability(loop_of(matrix, 1, period)).value > 0.0


def loop_of(matrix: Matrix, states: int, period: float = 0.0) -> ClosedLoop:
    return ClosedLoop(matrix, states, period, np.eye(len(matrix)), np.eye(matrix.shape[1]))
