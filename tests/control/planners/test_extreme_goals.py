"""Goals that nobody flies: a plan or one line, never a traceback."""

import pytest

from flexslew_control.planners import PLANNERS
from flexslew_lab.trial.trial import parse_trial, plan_of_trial
from flexslew_plant.errors import BadInput, PlanFailed

TRIAL = "duration: 40.0\nplan: {{method: {name}, goal: {{base_yaw: {goal!r}, hub_pitch: 0.0}}}}\n"


@pytest.mark.parametrize("goal", [1e-300, -1e-100, 1e3 + 1, 1e300])
@pytest.mark.parametrize("name", [name for name, entry in PLANNERS.items() if entry.slews])
def test_a_goal_is_planned_or_refused_in_one_line(name: str, goal: float) -> None:
    trial = parse_trial(TRIAL.format(name=name, goal=goal), "test")
    try:
        plan = plan_of_trial(trial)
    except (BadInput, PlanFailed) as error:
        assert abs(goal) > 1e3 or "its numbers are out of range" in str(error)  # noqa: PT017
    else:
        assert plan is not None
        assert abs(goal) < 1.0
