"""A plan that is adopted in flight begins where the reference is: no jump, no burst of effort."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.wire_bench import WireBench

from flexslew_control.controllers import CONTROLLERS
from flexslew_control.plan import Plan
from flexslew_control.planners import make_plan, plan_settings
from flexslew_control.plans.course import LARGEST_JUMP
from flexslew_control.plans.planned_course import PlanHistory, PlanResponses
from flexslew_lab.trial.trial import Trial
from flexslew_plant.testbeds import default_testbed

LAST = 4.0  # of a manoeuvre [s]; its hold before and after is what counts
# a rigid slew of .03 rad in 4 s asks for 2,000 kg m^2 * .011 rad/s^2 = 23 N m; the limit is 150
FARTHEST = 0.03  # of a goal from the last one [rad]
NEEDS_GAINS = {"planned_gains"}  # a plan that has them: it follows no other one


def planned(bench: WireBench, course: PlanHistory, start: float, goal: Any, **more: Any) -> Plan:
    """Return a plan as the planner makes it: from where the reference is at its start."""
    values = {
        "method": "reference_only",
        "goal": goal,
        "start": start,
        "duration": LAST,
        "initial": course.rest_at(start, bench.bench.time) or None,
    }
    plan = make_plan(plan_settings(values | more, "test"), bench.plant)
    # of the joints alone: this method's nominal deflections end in a jump to straight appendages
    return replace(plan, state=np.zeros((len(plan.position), 0)))


def adopted(bench: WireBench, course: PlanHistory, plan: Any) -> None:
    assert course.objection(plan, bench.bench.time) is None
    for host in bench.hosts.values():
        assert host.adopt(plan) is None
    course.add(plan, bench.bench.time)


@pytest.mark.first(4)
@pytest.mark.parametrize("law", [law for law in CONTROLLERS if law not in NEEDS_GAINS])
def test_random_plans_at_random_moments_never_saturate_a_motor(law: str) -> None:
    rng = np.random.default_rng([27, *law.encode()])
    names = tuple(default_testbed().typical_goal)
    for _ in range(2):
        bench = WireBench(Trial(controllers={law: {}}, active=law, duration=60.0))
        limit = np.array(bench.plant.effort_limit)
        course = PlanHistory(bench.plant)
        goal = dict(zip(names, rng.uniform(-FARTHEST, FARTHEST, len(names)), strict=True))
        adopted(bench, course, planned(bench, course, 0.0, goal))
        starts: list[int] = []
        for _ in range(2):
            moment = bench.bench.tick + int(rng.integers(10, 300))
            if starts:  # the plan before is over then
                moment = max(moment, starts[-1] + round(LAST / 0.01) - 50)
            bench.fly(moment)
            over = (starts[-1] if starts else 0) + round(LAST / 0.01)
            start = max(over, moment + int(rng.integers(2, 100)))
            goal = {n: goal[n] + float(rng.uniform(-FARTHEST, FARTHEST)) for n in names}
            adopted(bench, course, planned(bench, course, start * 0.01, goal))
            starts.append(start)
        bench.fly(starts[-1] + round(LAST / 0.01) + 50)
        host = next(iter(bench.hosts.values()))
        assert host.controller is not None
        references = [host.controller.reference(k).position for k in range(bench.bench.tick)]
        steps = np.abs(np.diff(references, axis=0)).max()
        assert steps < 1e-3, "the references are slews, not jumps"
        efforts = np.array([truth.applied_effort for truth in bench.truth_log])
        assert np.abs(efforts).max() < 0.9 * limit.min(), (law, np.abs(efforts).max(axis=0))
        assert bench.bench.saturated_ticks == 0


@pytest.mark.parametrize("law", ["pd_feedforward", "lqr"])
def test_a_jump_is_refused_by_planner_and_controller_and_who_refuses_is_not_ready(law: str) -> None:
    bench = WireBench(Trial(controllers={law: {}}, active=law, duration=60.0))
    course = PlanHistory(bench.plant)
    names = tuple(default_testbed().typical_goal)
    adopted(bench, course, planned(bench, course, 0.0, {names[0]: FARTHEST}))
    bench.fly(600)
    wrong = planned(bench, course, 8.0, {names[0]: 0.0}, initial={names[0]: 0.0})
    objection = course.objection(wrong, bench.bench.time)
    assert "stands at 0.03, the plan begins with 0" in str(objection)
    host = bench.hosts[law]
    refusal = host.adopt(wrong)
    assert refusal is not None
    assert "plan begins with 0" in str(refusal)
    assert host.reason == refusal
    assert host.plan_refused("x", refusal).data["reason"] == str(refusal)
    moving = planned(bench, course, 8.0, {names[0]: 0.0})
    adopted(bench, course, moving)
    assert host.reason is None
    early = planned(bench, course, 10.0, {names[0]: FARTHEST})  # that one ends at 12 s
    assert "moves at" in str(course.objection(early, bench.bench.time))
    late = planned(bench, course, 5.0, {names[0]: 0.0})
    assert str(course.objection(late, bench.bench.time)).startswith("the plan starts at 5 s")


@pytest.mark.parametrize("now", [0.0, 3.0])
def test_a_plan_that_ends_in_motion_must_last_until_the_run_ends(now: float) -> None:
    bench = WireBench(Trial(controllers={"lqr": {}}, active="lqr", duration=60.0))
    course = PlanHistory(bench.plant)
    bench.fly(round(now / 0.01))
    first, *_ = default_testbed().typical_goal
    rests = planned(bench, course, now + 1.0, {first: FARTHEST})
    turns = replace(rests, velocity=rests.velocity + 2.0 * LARGEST_JUMP * np.eye(2)[0])
    turns = replace(turns, velocity=np.vstack((rests.velocity[:1], turns.velocity[1:])))
    over = turns.first_tick + turns.ticks
    assert over == round((now + 1.0 + LAST) / 0.01)
    words = str(course.objection(turns, now, over + 1))
    assert words.startswith(f"{first} still moves when the plan is over, at {now + 5.0:g} s")
    assert f"the run ends at {(over + 1) * 0.01:g} s" in words
    for last_tick in (over, over - 10, 0):  # as long as the run, or nobody knows
        assert course.objection(turns, now, last_tick) is None
    assert course.objection(rests, now, over + 1000) is None


def test_after_a_reset_a_new_plan_is_flown_from_tick_0_and_else_the_first_one_again() -> None:
    names = tuple(default_testbed().typical_goal)
    for new in (False, True):
        bench = WireBench(Trial(controllers={"lqr": {}}, active="lqr", duration=60.0))
        course, host = PlanHistory(bench.plant), bench.hosts["lqr"]
        first = planned(bench, course, 0.0, {names[0]: FARTHEST})
        adopted(bench, course, first)
        bench.fly(450)
        second = planned(bench, course, 5.0, {names[0]: 2 * FARTHEST})
        adopted(bench, course, second)
        bench.fly(600)
        bench.session.reset()
        host.begin_epoch(1)  # which the state of the bench has told
        course.begin_epoch(1)
        assert host.plan is first
        third = planned(bench, course, 0.0, {names[1]: FARTHEST})
        if new:
            adopted(bench, course, third)
        assert bench.session.start().ok
        bench._waiting.clear()
        bench.fly(450)
        assert host.reason is None
        assert host.controller is not None
        end = host.controller.reference(450).position
        expected = third if new else first
        np.testing.assert_array_equal(end, expected.position[-1])
        assert host.plan_from == (1, 0)
        assert np.abs(bench.bench.truth().position[:2] - end).max() < 0.02


def test_the_planner_says_who_took_a_plan_and_who_did_not() -> None:
    class Status:
        def __init__(self, controller: str, plan_hash: str) -> None:
            self.controller, self.plan_hash = controller, plan_hash

    answers = PlanResponses()
    assert answers.of("new").message.startswith("no controller is on the graph")
    for name in ("a", "b", "c", "d"):
        answers.status(Status(name, "old"))
    assert answers.of("new").inactive == ("a", "b", "c", "d")
    answers.status(Status("a", "new"))
    answers.refusal("b", "new", "it starts too early")
    answers.refusal("c", "old", "another plan")
    found = answers.of("new", removed=["d"])
    assert (found.taken, found.inactive) == (("a",), ("c",))
    assert found.message == ("taken by a; refused by b: it starts too early; no answer from c")


def test_a_planner_that_was_given_a_place_begins_there() -> None:
    bench = WireBench(Trial(controllers={"pd_feedforward": {}}, duration=60.0))
    course = PlanHistory(bench.plant)
    assert course.rest_at(0.0, 0.0) == {}
    assert {*course.rest_at(5.0, 1.0).values()} == {0.0}
    names = tuple(default_testbed().typical_goal)
    plan = planned(bench, course, 0.0, dict.fromkeys(names, FARTHEST))
    course.add(plan, 0.0)
    assert course.rest_at(9.0, 1.0) == dict.fromkeys(names, pytest.approx(FARTHEST))
    course.add(replace(plan, start=20.0), 1.0)
    course.begin_epoch(1)
    assert course.rest_at(30.0, 1.0) == dict.fromkeys(names, pytest.approx(FARTHEST))
    assert LARGEST_JUMP < FARTHEST


def followed(bench: WireBench) -> set[str]:
    return {host.plan_hash for host in bench.hosts.values()}


def test_what_was_asked_for_in_a_flight_that_is_over_is_not_flown() -> None:
    """It begins where the reference was to be then: at tick 0 that would be a step."""
    bench = WireBench(Trial(controllers={"lqr": {}}, active="lqr", duration=60.0))
    course, names = PlanHistory(bench.plant), tuple(default_testbed().typical_goal)
    at_rest = course.flight(bench.bench.time)
    adopted(bench, course, planned(bench, course, 0.0, {names[0]: FARTHEST}))
    bench.fly(450)
    flight = course.flight(bench.bench.time)
    late = planned(bench, course, 30.0, {names[0]: 0.0})
    assert late.position[0].max() == pytest.approx(FARTHEST)
    assert course.objection(late, bench.bench.time, flight=flight) is None
    bench.session.reset()
    course.begin_epoch(1)
    refused = course.objection(late, bench.bench.time, flight=flight)
    assert "the bench was reset" in str(refused)
    still = planned(bench, course, 0.0, {names[0]: FARTHEST})
    assert course.objection(still, 0.0, flight=at_rest) is None
    assert course.objection(still, 0.0, flight=course.flight(0.0)) is None


def test_a_plan_that_all_refuse_leaves_the_one_before_it() -> None:
    bench = WireBench(Trial(controllers={"lqr": {}}, active="lqr", duration=60.0))
    course, names = PlanHistory(bench.plant), tuple(default_testbed().typical_goal)
    first = planned(bench, course, 0.0, {names[0]: FARTHEST})
    adopted(bench, course, first)
    bench.fly(450)
    late = planned(bench, course, 4.4, {names[0]: 0.0})  # the planner believes to be in time
    assert course.objection(late, 4.3) is None
    assert bench.hosts["lqr"].adopt(late, True) is not None
    course.add(late, 4.3)
    assert course.rest_at(20.0, 4.6)[names[0]] == 0.0
    course.remove(first)  # which is not the newest one
    assert course.plan is late
    course.remove(late)
    assert course.plan is first
    adopted(bench, course, planned(bench, course, 20.0, {names[0]: 0.0}))
    assert bench.hosts["lqr"].reason is None
    course.begin_epoch(1)
    course.remove(first)
    assert course.plan is first


def test_a_planner_that_came_in_flight_lets_the_controllers_judge_how_far_a_plan_jumps() -> None:
    bench = WireBench(Trial(controllers={"lqr": {}}, active="lqr", duration=60.0))
    before, names = PlanHistory(bench.plant), tuple(default_testbed().typical_goal)
    adopted(bench, before, planned(bench, before, 0.0, {names[0]: FARTHEST}))
    bench.fly(450)
    new = PlanHistory(bench.plant)
    given = {names[0]: FARTHEST}
    there = planned(bench, new, 8.0, {names[0]: 0.0}, initial=given)
    assert "stands at 0" in str(new.objection(there, 4.5))
    assert new.objection(there, 4.5, active_hash_set=followed(bench)) is None
    assert bench.hosts["lqr"].adopt(there, True) is None
    new.add(there, 4.5)
    here = planned(bench, new, 20.0, {names[0]: 0.0}, initial=given)
    assert "stands at 0" in str(new.objection(here, 4.5, active_hash_set=followed(bench)))


def test_one_that_is_told_the_plan_of_tick_0_again_flies_on() -> None:
    """By a planner that was started again: it would be too late for any other plan."""
    bench = WireBench(Trial(controllers={"lqr": {}}, active="lqr", duration=60.0))
    course, names = PlanHistory(bench.plant), tuple(default_testbed().typical_goal)
    host = bench.hosts["lqr"]
    first = planned(bench, course, 0.0, {names[0]: FARTHEST})
    adopted(bench, course, first)
    bench.fly(450)
    assert host.adopt(first) is None
    later = planned(bench, course, 5.0, {names[0]: 0.0})
    assert host.adopt(later, True) is None
    bench.fly(700)
    taken = host.plan_count
    assert host.adopt(first) is None
    assert host.reason is None
    assert (host.plan, host.plan_count) == (later, taken)
    assert host.adopt(planned(bench, course, 0.0, {names[1]: FARTHEST})) is not None


def test_a_plan_that_is_published_again_is_not_refused_by_what_was_said_before() -> None:
    answers = PlanResponses()
    answers.status(SimpleNamespace(controller="a", plan_hash="old"))
    answers.refusal("a", "new", "it starts too early")
    assert answers.of("new").refused
    answers.expect("new")
    assert answers.of("new").inactive == ("a",)
    answers.status(SimpleNamespace(controller="a", plan_hash="new"))
    assert answers.of("new").taken == ("a",)
    assert answers.active_hash_set == {"new"}


def test_one_that_refused_a_plan_is_told_again_what_it_follows_and_nothing_changes() -> None:
    """As a planner does whose newest plan all controllers have refused."""
    bench = WireBench(Trial(controllers={"lqr": {}}, active="lqr", duration=60.0))
    course, names = PlanHistory(bench.plant), tuple(default_testbed().typical_goal)
    host = bench.hosts["lqr"]
    first = planned(bench, course, 0.0, {names[0]: FARTHEST})
    adopted(bench, course, first)
    bench.fly(450)
    flown = [(first, False)]
    for start, goal in ((5.0, 0.0), (12.0, FARTHEST)):
        later = planned(bench, course, start, {names[0]: goal})
        assert host.adopt(later, True) is None
        course.add(later, bench.bench.time)
        flown.append((later, True))
    bench.fly(1300)  # the last one has begun
    late = replace(flown[-1][0], start=12.5)
    course.add(late, 12.4)
    assert host.adopt(late, True) is not None
    why, taken = host.reason, host.plan_count
    course.remove(late)
    assert [(p, flight) for p, flight in course.plans] == flown
    assert host.controller is not None
    before = [host.controller.reference(tick).position.tolist() for tick in (400, 800, 1500)]
    for plan, of_flight in course.plans:
        assert host.adopt(plan, of_flight) is None
    assert (host.reason, host.plan_count) == (why, taken)
    assert [host.controller.reference(t).position.tolist() for t in (400, 800, 1500)] == before
    assert host.controller.plan is flown[-1][0]
