"""The closed forms against Newton's method from many random starts."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import root
from tests.representatives import representatives, seeds

from flexslew_control.planners.time_optimal.linear.linear_multistart import linear_slews
from flexslew_control.planners.time_optimal.linear.linear_switching import (
    five_switches,
    three_switches,
)


def five_switch_equations(z: Any, a: Any) -> list[Any]:
    t, t1, t2 = z
    return [
        t**2 / 2 - t2**2 + t1**2 - a / 2,
        1 - 2 * np.cos(t1) + 2 * np.cos(t2) - np.cos(t),
        (2 * t1 * np.sin(t1) - 2 * t2 * np.sin(t2) + t * np.sin(t)) / t,
    ]


WAYS = (10.0 ** np.random.default_rng(1).uniform(-3.0, 3.5, 8)).tolist()  # lengths of slews


def ringing(durations: Any, damping: Any) -> tuple[Any, Any, Any, Any]:
    """Return the end of a mode of frequency 1 and of its derivative by the frequency, and the way.

    The mode starts at rest and is pushed by +-1; computed from the exact step response.
    """
    edges = np.cumsum(durations[::-1])[::-1]
    tau = np.append(edges, 0.0)
    jumps = np.array([1.0, *(2.0 * (-1.0) ** k for k in range(1, len(durations))), 0.0])
    jumps[-1] = -jumps.sum()
    poles = np.roots([1.0, 2.0 * damping, 1.0])
    modes = [jumps @ np.exp(pole * tau) for pole in poles]
    slopes = [jumps @ (tau * np.exp(pole * tau)) for pole in poles]
    return np.abs(modes).max(), np.abs(slopes).max(), jumps @ tau, jumps @ tau**2 / 2.0


@pytest.mark.parametrize("a", representatives(WAYS, *WAYS[:2]))
def test_no_antisymmetric_five_switch_slew_is_shorter(a: Any) -> None:
    rng = np.random.default_rng(2)
    found = five_switches(a)
    assert (np.diff(found[:, 0]) >= 0.0).all()
    for z in found:
        assert np.abs(five_switch_equations(z, a)).max() < 1e-9
    shortest = found[0, 0]
    for _ in range(150):
        t = rng.uniform(np.sqrt(a), shortest)
        t2 = rng.uniform(0.0, t)
        guess = root(five_switch_equations, (t, rng.uniform(0.0, t2), t2), (a,), tol=1e-12)
        t, t1, t2 = guess.x
        if guess.success and 1e-9 < t1 < t2 - 1e-9 < t - 2e-9:
            assert t >= shortest - 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("switches", [3, 5])
@pytest.mark.parametrize("seed", seeds(5))
def test_slews_of_the_damped_mode_end_at_rest_and_none_is_found_shorter_elsewhere(
    switches: int, seed: Any
) -> None:
    rng = np.random.default_rng(seed)
    a, damping = 10.0 ** rng.uniform(-2.0, 2.5), rng.uniform(0.0, 0.3)
    slews = linear_slews(a, damping, switches, 1.0)
    assert (slews > 0.0).all()
    for durations in slews:
        rest, slope, rate, way = ringing(durations, damping)
        assert rest < 1e-9
        assert rate == pytest.approx(0.0, abs=1e-9)
        assert way == pytest.approx(a, rel=1e-9)
        assert switches == 3 or slope < 1e-8
    assert slews[0].sum() == pytest.approx(linear_slews(a, damping, switches)[0].sum(), abs=1e-9)


def test_an_undamped_slew_needs_no_asymmetry_with_three_switches() -> None:
    for a in 10.0 ** np.random.default_rng(3).uniform(-2.0, 3.0, 10):
        t, t1 = three_switches(a)
        best = linear_slews(a, 0.0, 3)[0]
        assert best == pytest.approx([t - t1, t1, t1, t - t1], abs=1e-6)


def test_an_overdamped_mode_has_its_slews_too() -> None:
    rest, slope, rate, way = ringing(linear_slews(3.0, 1.2, 5)[0], 1.2)
    assert max(rest, slope, abs(rate)) < 1e-8
    assert way == pytest.approx(3.0)
