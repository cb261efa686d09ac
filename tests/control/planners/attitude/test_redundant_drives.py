"""More drives than axes: joints that nobody names follow those that somebody does."""

from typing import Any

import numpy as np
import pytest

import flexslew as fs
from flexslew_lab.trial.trial import plan_of_trial
from flexslew_plant.testbeds import initial_positions

GYROS = "control_moment_gyros"  # four in a pyramid


def given(initial: dict[str, float], goal: Any = None) -> fs.Trial:
    plan = goal and {"method": "reference_only", "goal": goal, "duration": 40.0}
    return fs.trial(GYROS, {"plan": plan, "testbed.initial": initial})


@pytest.mark.parametrize("initial", [{"one": 0.3}, {"two": -0.2, "four": 0.1}])
def test_the_bench_begins_where_the_named_joints_are_asked_to_be(initial: dict[str, float]) -> None:
    trial = given(initial)
    names = trial.testbed.model().joint_names
    read = dict(zip(names, fs.bench(trial).question.joint_position.tolist(), strict=True))
    assert read == pytest.approx(initial_positions(trial.testbed), abs=1e-12)
    assert {name: read[name] for name in initial} == pytest.approx(initial, abs=1e-12)


@pytest.mark.parametrize("goal", [{"one": 0.4}, {"one": 0.3, "three": -0.1}])
@pytest.mark.parametrize("initial", [{}, {"two": 0.2}])
def test_a_plan_ends_where_its_goal_asks_the_named_joints_to_be(
    initial: dict[str, float], goal: dict[str, float]
) -> None:
    trial = given(initial, goal)
    plan = plan_of_trial(trial, predict=False)
    assert plan is not None
    attitude = trial.testbed.model().attitude
    assert attitude is not None
    for position in plan.position[[0, -1]]:  # one attitude has them all
        turn = attitude.rotation_vector_of(position)
        np.testing.assert_allclose(attitude.axes @ turn, position, atol=1e-12)
    end = dict(zip(plan.joint_names, plan.position[-1].tolist(), strict=True))
    assert {name: end[name] for name in goal} == pytest.approx(goal, abs=1e-12)
    begin = dict(zip(plan.joint_names, plan.position[0].tolist(), strict=True))
    assert begin == pytest.approx(initial_positions(trial.testbed), abs=1e-12)


def test_what_no_attitude_has_is_refused_with_the_nearest() -> None:
    wrong = {"one": 0.3, "two": 0.1, "three": 0.1, "four": 0.5}
    with pytest.raises(fs.BadInput, match=r"^plan\.goal: .* the nearest has 0\.35, 0\.05, 0\.15"):
        plan_of_trial(given({}, wrong), predict=False)
    with pytest.raises(fs.BadInput, match=r"^initial: .* no attitude has these joints there"):
        fs.bench(given(wrong))
