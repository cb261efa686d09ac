import re
from functools import cache
from typing import Any

import numpy as np
import pytest
from tests.plants import plant
from tests.present import present
from tests.representatives import representatives

from flexslew_control.planners import PLANNERS, make_plan, other_method, plan_settings
from flexslew_control.planners.feedforward.optimized_feedforward import OptimizedFeedforward
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.own_code import ANY_CODE
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import read_testbed

YAW = {"base_yaw": 1.0}
BOTH = {"base_yaw": 1.0, "hub_pitch": 0.5}
SLEWS = [name for name, entry in PLANNERS.items() if entry.slews]
GOALS = {method: YAW if method == "time_optimal" else BOTH for method in SLEWS}
UNLIMITED = {name for name in SLEWS if not PLANNERS[name].feedforward}


def planned(method: Any, period: float = 0.05, limit: Any = (150.0, 150.0), **more: Any) -> Any:
    values = {"method": method, "goal": GOALS[method], **PLANNERS[method].example, **more}
    return make_plan(plan_settings(values, "trial.yaml"), plant(period, limit))


@cache
def example(method: str) -> Any:
    """Return the plan of a method that starts at 2 s."""
    return planned(method, start=2.0)


@pytest.mark.parametrize("method", SLEWS)
def test_every_planner_keeps_the_contract(method: Any) -> None:
    plan = example(method)
    assert plan.method == method == plan.request["method"]
    assert plan.joint_names == ("base_yaw", "hub_pitch")
    assert (plan.start, plan.period) == (2.0, 0.05)
    assert plan.position.shape == plan.velocity.shape == (plan.ticks + 1, 2)
    assert plan.effort.shape == (plan.ticks, 2)
    assert len(plan.state) == plan.ticks + 1
    assert plan.state.shape[1] in (0, 6)
    assert 0.0 <= plan.ticks * plan.period - plan.duration < plan.period
    assert plan.summary["duration"] == plan.duration
    for array in (plan.position, plan.velocity, plan.effort, plan.state):
        assert array.dtype == np.float64
        assert np.isfinite(array).all()
    assert np.abs(plan.effort).max(initial=0.0) <= 150.0 + 1e-9


@pytest.mark.parametrize("method", SLEWS)
def test_every_plan_ends_at_rest_at_the_goal(method: Any) -> None:
    plan = example(method)
    goal = [GOALS[method].get(name, 0.0) for name in plan.joint_names]
    np.testing.assert_allclose(plan.position[-1], goal, atol=1e-6)
    np.testing.assert_allclose(plan.velocity[-1], 0.0, atol=1e-6)
    after = plan.reference(10**6)
    np.testing.assert_allclose(after.position, goal, atol=1e-6)
    assert not after.velocity.any()
    assert not after.effort.any()


@pytest.mark.parametrize("method", SLEWS)
def test_every_plan_can_be_asked_for_again(method: Any) -> None:
    plan = example(method)
    again = make_plan(plan_settings(plan.request, "trial.yaml"), plant(0.05, (150.0, 150.0)))
    np.testing.assert_array_equal(again.position, plan.position)
    np.testing.assert_array_equal(again.effort, plan.effort)


@pytest.mark.parametrize("method", SLEWS)
@pytest.mark.parametrize(
    ("more", "word"),
    [
        ({"start": -1.0}, "start"),
        ({"start": float("nan")}, "start"),
        ({"goal": {"base_yaw": "east"}}, "base_yaw"),
        ({"golf": 1}, "golf"),
    ],
)
def test_every_planner_refuses_a_bad_section_in_one_line(method: Any, more: Any, word: str) -> None:
    with pytest.raises(BadInput, match=word) as caught:
        planned(method, **more)
    assert str(caught.value).startswith("trial.yaml")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("method", SLEWS)
def test_every_planner_refuses_a_start_between_ticks(method: Any) -> None:
    with pytest.raises(BadInput, match=r"start: 0\.013") as caught:
        planned(method, start=0.013)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "method",
    representatives(
        sorted(set(SLEWS) - UNLIMITED), *sorted(set(SLEWS) - UNLIMITED - {"minimax_feedforward"})
    ),
)
def test_every_planner_refuses_more_effort_than_the_drives_have(method: Any) -> None:
    more = {"amplitude": 100.0} if method == "time_optimal" else {}
    with pytest.raises((BadInput, PlanFailed), match=r"limit") as caught:
        planned(method, limit=(1.0, 1.0), **more)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("method", ["optimized_feedforward", "robust_feedforward", "input_shaping"])
def test_too_short_a_duration_is_refused_with_one_that_does(method: str) -> None:
    with pytest.raises(PlanFailed, match=r"is enough; a rigid body takes 13\.72 s") as caught:
        planned(method, duration=8.0)
    enough = float(
        present(re.search(r"a duration of ([\d.]+) s \(now 8 s\)", str(caught.value)))[1]
    )
    assert 13.72 < enough < 25.0
    assert planned(method, duration=enough).request["duration"] == enough
    with pytest.raises(PlanFailed, match=r"no duration up to .* is enough; use a higher effort"):
        planned(method, limit=(0.1, 0.1))


@pytest.mark.parametrize("given", SLEWS)
@pytest.mark.parametrize("requested", SLEWS)
def test_every_method_can_be_asked_for_the_manoeuvre_of_another(given: Any, requested: Any) -> None:
    goal = {"base_yaw": 0.7, "hub_pitch": 0.0}
    settings = plan_settings({"method": given, "goal": goal, "start": 3.0}, "trial.yaml")
    other = other_method(settings, requested, "trial.yaml")
    assert other.method == requested
    assert other.start == 3.0
    assert plain(other)["goal"] == goal


def test_a_goal_that_leaves_out_a_joint_leaves_it_where_it_is() -> None:
    model = {"kind": "csa", "modes": 1, "variant": "printed", "initial": {"base_yaw": 0.2}}
    given = {"method": "time_optimal", "goal": {"base_yaw": 1.0}, "model": model}
    settings = plan_settings(given, "trial.yaml")
    other = other_method(settings, "optimized_feedforward", "trial.yaml", functions=12)
    assert isinstance(other, OptimizedFeedforward)
    assert other.functions == 12
    plan = make_plan(other, plant(0.05))
    assert plan.request["model"]["variant"] == "printed"
    assert plan.request["initial"] == {"base_yaw": 0.2, "hub_pitch": 0.0}
    assert plan.request["goal"] == {"base_yaw": 1.0, "hub_pitch": 0.0}


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({}, "{} is not allowed: the key method is missing"),
        ({"method": "wishing"}, "wishing is not a planner; allowed: attitude_profile, "),
        ({"method": "no.where.Shaper"}, "no.where.Shaper cannot be loaded: "),
        ({"method": "pathlib.Path"}, "pathlib.Path has no plan(slew, progress)"),
    ],
)
def test_a_section_without_a_planner_is_refused_in_one_line(values: Any, words: str) -> None:
    with pytest.raises(BadInput) as caught:
        plan_settings(values, "trial.yaml", ANY_CODE)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


OWN = """
from flexslew_control.plan import Plan
from flexslew_control.planners.reference import NoPlan, plan_none
from flexslew_plant.settings import section

@section
class Step:
    method: str
    goal: dict[str, float]
    start: float = 0.0
    late: float = 1.0  # [s]

    def plan(self, slew, progress):
        return plan_none(NoPlan(goal=self.goal, start=self.start + self.late), slew, progress)
"""


def test_a_planner_of_ones_own_plans_from_its_file(tmp_path: Any) -> None:
    (tmp_path / "step.py").write_text(OWN)
    values = {"method": f"{tmp_path}/step.py:Step", "goal": BOTH, "start": 2.0}
    plan = make_plan(plan_settings(values, "trial.yaml", ANY_CODE), plant(0.05))
    assert plan.start == 3.0
    assert plan.request == {**values, "late": 1.0}
    with pytest.raises(BadInput, match=r"latte: unknown key; did you mean late\?") as caught:
        plan_settings({**values, "latte": 2.0}, "trial.yaml", ANY_CODE)
    assert "\n" not in str(caught.value)


def test_turns_of_appendages_are_no_slew() -> None:
    slew = plan_settings({"method": "none"}, "trial.yaml")
    with pytest.raises(
        BadInput, match="'retargeting' is not allowed: it does not plan what none do"
    ):
        other_method(slew, "retargeting", "trial.yaml")
    turn = plan_settings({"method": "retargeting"}, "trial.yaml")
    with pytest.raises(BadInput, match="'none' is not allowed: it does not plan what retargeting"):
        other_method(turn, "none", "trial.yaml")


def test_a_manoeuvre_that_a_method_does_not_know_is_refused_in_one_line() -> None:
    settings = plan_settings({"method": "none"}, "trial.yaml")
    with pytest.raises(
        BadInput, match=r"trial\.yaml: method: 'wishing' is not allowed: attitude_profile"
    ):
        other_method(settings, "wishing", "trial.yaml")
    hub = plan_settings({"method": "time_optimal", "goal": {"hub": 1.0}}, "trial.yaml")
    with pytest.raises(
        BadInput, match="goal: hub is not a joint of the testbed; did you mean hub_pitch"
    ):
        make_plan(other_method(hub, "input_shaping", "trial.yaml"), plant())


def test_a_craft_without_the_usual_joint_asks_for_a_goal() -> None:
    drives = {
        name: {"kind": "torque", "direction": axis, "limit": 1.0}
        for name, axis in zip("abc", np.eye(3).tolist(), strict=True)
    }
    craft = read_testbed({"kind": "spacecraft", "actuators": drives}, "here")
    with pytest.raises(BadInput, match="goal: missing; give one to some of the joints a, b, c"):
        make_plan(plan_settings({"method": "none"}, "t"), plant(0.05, (1.0,) * 3, craft))
