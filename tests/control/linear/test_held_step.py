"""The compiled zero-order hold is that of zero_order_hold, whose norm and sizes are any."""

import numpy as np
import pytest

from flexslew_control.linear.held_step import exponential_step
from flexslew_control.linear.zero_order_hold import zero_order_hold


@pytest.mark.parametrize("size", [0.0, 1e-6, 0.1, 0.7, 0.8, 3.0, 20.0])
@pytest.mark.parametrize(("k", "m"), [(1, 1), (2, 0), (12, 3), (37, 4)])
def test_the_compiled_hold_is_that_of_every_design(k: int, m: int, size: float) -> None:
    rng = np.random.default_rng([k, m])
    a, b = rng.standard_normal((k, k)), rng.standard_normal((k, m))
    a *= size / np.linalg.norm(a, 1)
    period = 0.3
    found = np.hstack((a * period, b * period))
    exponential_step(found)
    f, g = zero_order_hold(a, b, period)
    # rounding, as often as it is squared; exp of the norm bounds the largest entry
    for part, expected in ((found[:, :k], f), (found[:, k:], g)):
        largest = abs(expected).max(initial=1e-300)
        np.testing.assert_allclose(part, expected, rtol=0.0, atol=1e-14 * (1.0 + size) * largest)


def test_two_holds_are_one_of_twice_the_time() -> None:
    rng = np.random.default_rng(1)
    both = rng.standard_normal((6, 8)) / 6.0
    one, twice = both.copy(), 2.0 * both
    exponential_step(one)
    exponential_step(twice)
    f, g = one[:, :6], one[:, 6:]
    np.testing.assert_allclose(twice, np.hstack((f @ f, f @ g + g)), rtol=1e-13, atol=1e-14)
