"""A time-optimal slew leaves the reserve of every drive to the feedback."""

import numpy as np
import pytest
from tests.present import present

from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import plan_of_trial

REACHED = 0.97  # of the share that may be used: the slew is no slower than it must be [-]


@pytest.mark.parametrize("reserve", [0.0, 0.2, 0.5])
def test_no_drive_is_asked_for_the_reserve_about_any_axis(reserve: float) -> None:
    rng = np.random.default_rng([53, round(10 * reserve)])
    to = rng.standard_normal(3)
    for goal in ([0.6, -0.3, 0.74], (to / np.linalg.norm(to)).tolist()):
        trial, _ = read_trial(
            "three_axes", [f"plan.reserve={reserve}", f"plan.goal={{to: {goal}}}"]
        )
        plan = present(plan_of_trial(trial, predict=False))
        limit = np.array(trial.testbed.effort_limit)
        used = (np.abs(plan.effort).max(axis=0) / limit).max()
        assert REACHED * (1.0 - reserve) <= used <= (1.0 - reserve) * (1.0 + 1e-6)
