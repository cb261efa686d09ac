"""About any eigenaxis every drive keeps the reserve of a section free, at every tick."""

from typing import Any

import numpy as np
import pytest
from tests.present import present
from tests.representatives import representatives

from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import plan_of_trial

# of the share that may be used: a slew is not much slower than it must be. How the switches meet
# the phases of the modes changes the peaks by a fifth from one torque to the next.
REACHED = 0.7
SHIPPED = [0.6, -0.3, 0.74]


def used_share(goal: list[float], reserve: float) -> float:
    """Return the largest share of a drive's limit in a plan of the shipped trial [-]."""
    keys = [f"plan.reserve={reserve}", f"plan.goal={{to: {goal}}}"]
    trial, _ = read_trial("three_axes", keys)
    plan = present(plan_of_trial(trial, predict=False))
    limit = np.array(trial.testbed.effort_limit)
    shares = np.abs(plan.effort) / limit
    peak = np.array(plan.summary["peak_effort"])
    np.testing.assert_allclose(peak, np.abs(plan.effort).max(axis=0), rtol=1e-12)
    return float(shares.max())


def require_reserve(goal: list[float], reserve: float) -> None:
    used = used_share(goal, reserve)
    assert REACHED * (1.0 - reserve) <= used <= (1.0 - reserve) * (1.0 + 1e-8)


def directions(seed: int, count: int) -> Any:
    drawn = np.random.default_rng([53, seed]).standard_normal((count, 3))
    return (drawn / np.linalg.norm(drawn, axis=1)[:, None]).tolist()


@pytest.mark.slow
@pytest.mark.parametrize("reserve", [0.0, 0.2, 0.5])
def test_a_fastest_slew_of_the_shipped_trial_keeps_its_reserve(reserve: float) -> None:
    """With 0.2 the roll wheel needed 0.9996 of its limit, with 0.5 0.9426."""
    require_reserve(SHIPPED, reserve)


@pytest.mark.slow
@pytest.mark.parametrize(
    "goal", representatives(directions(1, 3), directions(1, 3)[0], single=True)
)
def test_a_fastest_slew_about_a_drawn_axis_keeps_its_reserve(goal: list[float]) -> None:
    require_reserve(goal, 0.3)


@pytest.mark.matrix
@pytest.mark.parametrize(
    ("goal", "reserve"),
    zip(directions(2, 4), [0.1, 0.3, 0.6, 0.8], strict=True),
)
def test_a_fastest_slew_keeps_any_reserve_about_any_axis(goal: list[float], reserve: float) -> None:
    require_reserve(goal, reserve)
