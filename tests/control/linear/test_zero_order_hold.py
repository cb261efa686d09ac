"""The hold, the regulator and the stationary filter are those of python-control."""

import control
import numpy as np
import pytest

from flexslew_control.controllers.lqr import regulator
from flexslew_control.estimators.kalman import continuous_gain, discrete_model
from flexslew_control.linear.zero_order_hold import zero_order_hold


@pytest.fixture
def system(case: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(case)
    k, m = rng.integers(1, 7), rng.integers(1, 4)
    return rng.standard_normal((k, k)), rng.standard_normal((k, m))


@pytest.mark.parametrize("case", range(5))
def test_designs_are_those_of_python_control(system: tuple[np.ndarray, np.ndarray]) -> None:
    a, b = system
    k, m = b.shape
    held = control.ss(a, b, np.eye(k), 0).sample(0.1, "zoh")
    f, g = zero_order_hold(a, b, 0.1)
    np.testing.assert_allclose(f, held.A, atol=1e-12)
    np.testing.assert_allclose(g, held.B, atol=1e-12)
    gain, p, _ = control.lqr(a, b, np.eye(k), 2.0 * np.eye(m))
    for ours, theirs in zip(regulator(a, b, np.eye(k), 2.0 * np.eye(m)), (gain, p), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-7, atol=1e-7)
    gain, p, _ = control.lqe(a, np.eye(k), b.T, np.eye(k), 2.0 * np.eye(m))
    for ours, theirs in zip(
        continuous_gain(a, b.T, np.eye(k), 2.0 * np.eye(m)), (gain, p), strict=True
    ):
        np.testing.assert_allclose(ours, theirs, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("case", range(5))
def test_the_noise_of_a_tick_is_the_sum_of_its_moments(
    system: tuple[np.ndarray, np.ndarray],
) -> None:
    """Q of a tick is that of its two halves: Q(2 h) = Q(h) + F(h) Q(h) F(h)^T."""
    a, b = system
    *_, whole = discrete_model(a, b, np.eye(len(a)), 0.1)
    f, _, half = discrete_model(a, b, np.eye(len(a)), 0.05)
    np.testing.assert_allclose(whole, half + f @ half @ f.T, atol=1e-12)
