"""Goals that nobody flies: a plan or one line, never a traceback."""

import pytest
from tests.representatives import representatives

from flexslew_control.planners import PLANNERS
from flexslew_lab.trial.trial import parse_trial, plan_of_trial
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.yaml_data import yaml_text

TRIAL = "duration: 40.0\nplan: {{method: {name}, goal: {{base_yaw: {goal!r}, hub_pitch: 0.0}}}}\n"


@pytest.mark.parametrize("goal", representatives([1e-300, -1e-100, 1e3 + 1, 1e300], 1e-300, 1e300))
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


def test_modes_far_too_fast_for_the_period_are_no_plan_of_numbers_that_are_none() -> None:
    arm = {
        "hinge": {"kind": "driven", "axis": [1.0, 0.0, 0.0], "damper": 1.8, "limit": 5.0},
        "shape": {
            "kind": "beam",
            "length": 5.7,
            "linear_density": 0.36,
            "bending_stiffness": 2.4e6,
            "modes": 3,
        },
        "body": {"mass": 1.0, "inertia": {"xx": 0.5, "yy": 0.5, "zz": 0.5}},
        "damping": {"ratio": 0.001},
    }
    testbed = {
        "kind": "spacecraft",
        "platform": {"motion": "held"},
        "appendages": {"arm": arm},
        "actuators": {},
    }
    plan = {"method": "minimax_feedforward", "goal": {"arm_hinge": 0.001}, "duration": 10.0}
    plan |= {"pieces": 12, "max_steps": 2}
    gains = {"pd_feedforward": {"kp": [3.0], "kd": [8.0]}}
    trial = {"period": 0.02, "duration": 60.0, "testbed": testbed, "plan": plan}
    text = yaml_text({**trial, "controllers": gains, "active": "pd_feedforward"})
    with pytest.raises(PlanFailed, match=r"not finite: modes are too fast for a period of 0\.02 s"):
        plan_of_trial(parse_trial(text, "test"))
