"""What a flight is measured against: the goal, how far it is, and whether the plan ends at rest."""

import numpy as np
import pytest

from flexslew_lab.metrics.from_bag import manoeuvre_of
from flexslew_lab.metrics.joint_errors import goal_errors


def path(left: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a smooth turn by 0.5 rad in 10 s whose last rate is a share of its largest."""
    s = np.linspace(0.0, 1.0, 501)
    rate = 0.75 / 10.0 * (4.0 * s * (1.0 - s))
    rate[-1] = left * rate.max()
    return (0.5 * s**2 * (3.0 - 2.0 * s))[:, None], rate[:, None]


@pytest.mark.parametrize("left", [0.0, 1e-9, 1.5e-6, 2e-5])
def test_what_switch_times_between_ticks_leave_is_a_rest(left: float) -> None:
    """A slew in the least time of a craft with two modes ended at 1.1e-6 of its largest rate."""
    manoeuvre = manoeuvre_of(*path(left), 0.0, 10.0)
    assert manoeuvre.rate is None
    missed = goal_errors(manoeuvre, None, np.array([-0.5]), np.array([1e-4]), np.array([1e-4]))
    assert missed == pytest.approx(2e-4)  # of the way, not of a rate that is none


def test_a_plan_that_goes_on_is_measured_by_its_rate() -> None:
    manoeuvre = manoeuvre_of(*path(1e-3), 0.0, 10.0)
    np.testing.assert_array_equal(manoeuvre.rate, path(1e-3)[1][-1])
