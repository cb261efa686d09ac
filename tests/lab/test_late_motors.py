"""Plans count with the lag and the delay of the motors: what they promise is flown on the bench."""

from typing import Any

import numpy as np
import pytest
from tests.representatives import seeds

from flexslew_lab.notebook import fly, trial
from flexslew_lab.trial.trial import plan_of_trial

OSCILLATOR = {"kind": "floating_oscillator"}
CSA = {"kind": "csa", "modes": 1, "effort_limit": [150.0, 150.0]}
QUICK: dict[str, Any] = {"pieces": 12, "ensemble": {"draw": "corners"}, "max_steps": 8}


def keys(testbed: dict[str, Any], period: float, lag: float, ticks: float, **plan: Any) -> Any:
    one = testbed["kind"] == "floating_oscillator"
    gains = {"kp": [0.5], "kd": [1.0]} if one else {"kp": [460.0, 460.0], "kd": [920.0, 920.0]}
    return {
        "name": "late",
        "period": period,
        "duration": plan["duration"] + 20.0,
        "testbed": testbed,
        "actuator": {"lag": lag},
        "schedule": [{"at": 0.0, "fault": {"kind": "command_delay", "ticks": ticks}}],
        "allow_faults": True,
        "plan": {"method": "minimax_feedforward", **plan},
        "controllers": {"pd_feedforward": gains},
        "active": "pd_feedforward",
    }


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(4))
def test_a_linear_bench_with_late_motors_keeps_the_promise_on_members_and_between(
    seed: int,
) -> None:
    rng = np.random.default_rng([30, seed])
    lag, ticks = float(rng.uniform(0.05, 0.4)), round(float(rng.uniform(0.5, 8.0)), 1)
    duration = round(float(rng.uniform(6.0, 9.0)), 2)
    goal = {"mass": float(rng.uniform(0.5, 1.0))}
    values = keys(OSCILLATOR, 0.02, lag, ticks, duration=duration, goal=goal)
    plan = plan_of_trial(trial(values))
    assert plan is not None
    assert "actuator" not in plan.summary["believes"]
    left = []
    for error in (-0.2, -0.13, 0.0, 0.07, 0.2):
        there = {"testbed.parameters.stiffness": 1.0 + error}
        flight = fly(trial(values, there, plan=plan))
        left.append(float(np.abs(flight["tip"][flight.time >= duration]).max()))
    assert 0.9 < max(left) / plan.summary["worst_residual"] < 1.1


@pytest.mark.slow
def test_a_bench_that_is_not_linear_keeps_it_too() -> None:
    goal = {"base_yaw": 0.4, "hub_pitch": -0.3}
    values = keys(CSA, 0.05, 0.3, 3.0, duration=22.0, goal=goal, **QUICK)
    plan = plan_of_trial(trial(values))
    assert plan is not None
    left = []
    for error in (-0.2, 0.0, 0.2):
        there = {"testbed.parameters.bending_stiffness": 1500.0 * (1.0 + error)}
        flight = fly(trial(values, there, plan=plan))
        left.append(float(np.abs(flight["tip"][flight.time >= 22.0]).max()))
    assert 0.9 < max(left) / plan.summary["worst_residual"] < 1.1


def test_a_planner_that_believes_in_prompt_motors_says_so() -> None:
    asked = {"method": "robust_feedforward", "goal": {"mass": 1.0}, "duration": 10.0}
    values = {**keys(OSCILLATOR, 0.02, 0.2, 3.0, duration=10.0), "plan": asked}
    plan = plan_of_trial(trial(values))
    assert plan is not None
    told = "actuator.lag 0.0 instead of 0.2, command delay [ticks] 0 instead of [3.0]"
    assert told in plan.summary["believes"]
