from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.present import present

from flexslew_control.controllers import build_controller
from flexslew_control.controllers.host import Build, ControllerHost, merged
from flexslew_control.law import PlantDescription
from flexslew_control.planners import make_plan
from flexslew_control.planners.reference import ReferenceOnly
from flexslew_control.plans.plan_file import plan_hash
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement
from flexslew_plant.own_code import ANY_CODE
from flexslew_plant.testbeds.csa import CsaTestbed
from flexslew_plant.testbeds.oscillators.floating_oscillator import FloatingOscillatorTestbed

ARRAYS = ("joint_position", "joint_velocity", "tip_deflection", "root_curvature", "applied_effort")
EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
CSA = PlantDescription(CsaTestbed(modes=1), 0.01, np.array([150.0, 150.0]), ANY_CODE)
OSCILLATOR = PlantDescription(FloatingOscillatorTestbed(), 0.01, np.array([1.0]))


def standing(
    law: str = "pd_feedforward", plant: PlantDescription = CSA, **values: Any
) -> ControllerHost:
    host = ControllerHost("mine", values)
    host.notify(builder(law, plant), 2)
    return host


def builder(law: str, plant: PlantDescription) -> Build:
    return lambda values: build_controller("mine", law, values, plant, "test")


def question(
    tick: int, epoch: int = 0, joints: int = 2, position: float = 0.1, applied: float = 0.0
) -> Measurement:
    place = np.full(joints, position)
    return Measurement(
        tick, epoch, tick * 0.01, "mine", place, 0.0 * place, np.zeros(2), np.zeros(2),
        np.full(joints, applied),
    )  # fmt: skip


def effort(host: ControllerHost, tick: int, **more: Any) -> Vector:
    answer = host.observe(question(tick, **more))
    assert answer is not None
    return answer.command.effort


def test_before_a_testbed_is_announced_it_is_not_ready_and_says_nothing() -> None:
    host = ControllerHost("mine", {})
    assert str(host.reason) == "no testbed announced yet"
    assert host.observe(question(0)) is None
    assert not host.tune({"kp": [1.0, 1.0]}).ok


def test_settings_that_fit_no_testbed_at_all_are_bad_input() -> None:
    with pytest.raises(BadInput, match="kp"):
        standing(kp=[1.0, 2.0, 3.0])


def test_before_another_testbed_it_adapts_or_is_not_ready_with_the_reason() -> None:
    host = standing(kp=[400.0, 500.0])
    host.notify(builder("pd_feedforward", OSCILLATOR), 2)
    assert str(host.reason).startswith("it does not fit this testbed: ")
    assert host.observe(question(0, joints=1)) is None
    host.notify(builder("pd_feedforward", CSA), 2)
    assert host.reason is None
    free = standing(kp=[400.0])
    free.notify(builder("pd_feedforward", OSCILLATOR), 2)
    assert free.reason is None
    assert free.observe(question(0)) is None  # of the testbed before
    assert effort(free, 0, joints=1).shape == (1,)


def test_a_tuned_law_takes_over_at_its_tick_without_a_step() -> None:
    host = standing(kp=[400.0, 400.0], kd=[0.0, 0.0], handover_time=0.05)
    host.observe(question(0, position=0.0))  # where it holds
    before = effort(host, 1)
    np.testing.assert_allclose(before, -40.0)
    done = host.tune({"kp": [800.0, 800.0]}, tick=5, who="ann")
    assert (done.ok, done.tick) == (True, 5)
    found = [effort(host, tick, applied=-40.0)[0] for tick in range(2, 12)]
    np.testing.assert_allclose(found[:3], -40.0)
    np.testing.assert_allclose(found[3:9], [-40.0, -48.0, -56.0, -64.0, -72.0, -80.0])
    (event,) = host.events
    assert (event.tick, event.kind, event.data["who"]) == (5, "tuned", "ann")
    assert event.data["before"]["kp"] == [400.0, 400.0]
    assert host.values["kp"] == [800.0, 800.0]


@pytest.mark.parametrize("changes", [{}, {"kp": [-1.0]}, {"kq": [1.0]}])
def test_a_change_that_cannot_be_made_is_refused_in_words_and_changes_nothing(
    changes: dict[str, Any],
) -> None:
    host = standing()
    host.observe(question(0))
    refused = host.tune(changes)
    assert not refused.ok
    assert refused.message
    assert host.values == {}
    host.observe(question(1))
    assert not host.events


def test_an_estimator_of_the_same_size_keeps_what_it_knows() -> None:
    host = standing("lqr")
    for tick in range(20):
        host.observe(question(tick, position=0.1))
    assert host.controller is not None
    known = host.controller._estimate
    assert host.tune({"handover_time": 0.5}).ok
    host.observe(question(20, position=0.1))
    later = host.controller._estimate
    assert np.diag(later.covariance).max() <= 1.1 * np.diag(known.covariance).max()
    np.testing.assert_allclose(later.position, known.position, atol=1e-4)


@pytest.mark.parametrize("known", [True, False])
def test_what_was_to_be_tuned_at_the_next_tick_is_tuned_after_a_reset(known: bool) -> None:
    host, other = standing(), standing(kp=[500.0, 500.0], kd=[70.0, 70.0])
    for tick in range(5):
        effort(host, tick)
        effort(other, tick)
    assert host.tune({"kp": [500.0, 500.0]}).tick == 5
    assert host.tune({"kd": [70.0, 70.0]}).tick == 5
    assert host.tune({"kp": [1.0, 1.0]}, tick=9).ok  # forgotten
    if known:  # the bench's state came before its question
        host.begin_epoch(1)
    for tick in range(12):
        there = effort(other, tick, epoch=1, position=0.01 * tick)
        np.testing.assert_array_equal(effort(host, tick, epoch=1, position=0.01 * tick), there)
    assert [(e.kind, e.epoch, e.tick) for e in host.events if e.kind == "tuned"] == [
        ("tuned", 1, 0),
        ("tuned", 1, 0),
    ]


def test_a_plant_that_comes_back_flies_the_plan_of_tick_0_and_none_of_the_flight_before() -> None:
    host, first = standing(), make_plan(ReferenceOnly(start=0.0), CSA)
    assert host.adopt(first) is None
    host.observe(question(0))
    host.observe(question(1))
    assert host.adopt(replace(first, start=1.0, position=first.position + 0.001), True) is None
    host.notify(builder("pd_feedforward", CSA), 2)
    assert (host.plan, host.plan_hash) == (first, plan_hash(first))
    without = standing()
    without.observe(question(0, position=first.position[0].max()))
    without.observe(question(1))
    assert without.adopt(replace(first, start=1.0), True) is None
    without.notify(builder("pd_feedforward", OSCILLATOR), 2)
    without.notify(builder("pd_feedforward", CSA), 2)
    assert (without.plan, without.plan_hash, without.reason) == (None, "", None)


def test_a_tuning_for_a_time_that_never_comes_is_refused_as_a_switch_is() -> None:
    host = standing()
    for tick in range(6):
        host.observe(question(tick))
    kp = {"kp": [500.0, 500.0]}
    assert str(host.tune(kp, tick=4).refused) == "0.04 s is past: the bench is at 0.05 s"
    assert str(host.tune(kp, tick=-1).refused) == "that time is past: the bench is at 0.05 s"
    assert [host.tune(kp, tick=at).tick for at in (0, 5, 6, 900)] == [6, 6, 6, 900]
    host.run_ends = 100
    late = host.tune(kp, tick=100)
    assert str(late.refused) == "tick 100 is too late: the run ends at tick 100"
    assert host.tune(kp, tick=99).ok
    assert host.tune(kp).ok


@pytest.mark.parametrize("later", [0, 20])
def test_a_reset_while_a_design_is_made_leaves_it_for_tick_0_or_refuses_it(later: int) -> None:
    host = standing()
    for tick in range(10):
        host.observe(question(tick))

    def beside(make: Any) -> Any:
        made = make()
        host.observe(question(0, epoch=1))
        return made

    done = host.tune({"kp": [500.0, 500.0]}, tick=later, executor=beside)
    assert done.ok is not bool(later)
    if later:
        assert str(done.refused) == "the bench was reset meanwhile"
    else:
        assert done.tick == 1
    for tick in range(1, 30):
        host.observe(question(tick, epoch=1))
    told = [(e.epoch, e.tick) for e in host.events if e.kind == "tuned"]
    assert told == ([] if later else [(1, 1)])


def test_a_reset_forgets_what_was_to_be_tuned() -> None:
    host = standing()
    host.observe(question(0))
    host.tune({"kp": [500.0, 500.0]}, tick=10)
    for tick in range(20):
        host.observe(question(tick, epoch=1))
    assert not host.events


@pytest.mark.parametrize("kp", [float("nan"), float("inf"), object()])
def test_a_law_of_ones_own_is_not_tuned_to_what_no_log_can_hold(kp: Any) -> None:
    host = standing(f"{EXAMPLES / 'my_law.py'}:MyLaw")
    refused = host.tune({"kp": kp})
    assert not refused.ok
    assert refused.message.startswith("kp: not plain data or not a finite number")
    assert host.tune({"kp": 1.0}).ok


@pytest.mark.parametrize("field", ARRAYS)
@pytest.mark.parametrize("size", [0, 1, 3])
def test_a_question_of_another_size_is_not_heard(field: str, size: int) -> None:
    host = standing("output_feedback")
    wrong: dict[str, Any] = {field: np.zeros(size)}
    assert host.observe(question(0)._replace(**wrong)) is None
    assert host.controller is not None
    assert host.controller.last_tick == -1
    assert effort(host, 0).size == 2


def test_a_plan_is_taken_from_the_next_question_on() -> None:
    plan, *others = (make_plan(ReferenceOnly(start=at), CSA) for at in (6.0, 5.0, 5.5, 5.7))
    host = ControllerHost("mine", {})
    assert (host.plan_count, host.plan_from) == (0, (0, 0))
    host.adopt(plan)  # kept for the testbed to come
    host.notify(builder("pd_feedforward", CSA), 2)
    assert (host.plan_count, host.plan_hash, host.plan_from) == (1, plan_hash(plan), (0, 0))
    asked = -1
    for (epoch, tick), each in zip(((0, 0), (0, 41), (1, 3)), others, strict=True):
        for number in range(0 if epoch else asked + 1, tick + 1):
            host.observe(question(number, epoch))
        asked = tick
        assert host.adopt(each) is None
        assert host.plan_from == (epoch, tick + 1)
    late = make_plan(ReferenceOnly(start=0.02), CSA)
    assert "the bench is at 0.03 s" in str(
        host.adopt(late)
    )  # refused, so the other one is followed
    taken = 5  # the reset took that of tick 0 again
    assert (host.plan_count, host.plan_hash, host.plan_from) == (taken, plan_hash(each), (1, 4))
    host.notify(builder("pd_feedforward", CSA), 2)  # another plant, in its first epoch
    assert (host.plan_count, host.plan_hash, host.plan_from) == (taken, plan_hash(late), (0, 0))


@pytest.mark.parametrize("received", [-1, 0, 3])
def test_a_plan_of_a_flight_that_is_over_is_not_flown_after_the_reset(received: int) -> None:
    """DDS may deliver the latched plans after the reset, before or after the first questions.

    Args:
        received: tick of the newest question by then; -1: none has come.
    """
    first = make_plan(ReferenceOnly(goal={"base_yaw": 0.1}, start=0.0, duration=1.0), CSA)
    goal = first.position[-1]
    of_flight = replace(first, start=2.0, position=goal + 0.001 * (first.position + 1.0))
    host = standing()
    for tick in range(received + 1):
        host.observe(question(tick, 1))
    assert host.adopt(first, False, 0) is None
    refusal = host.adopt(of_flight, True, 0)
    assert (refusal is None) == (received < 0), refusal  # before, the reset is not known
    assert refusal is None or "before a reset; the bench is in epoch 1" in str(refusal)
    host.observe(question(received + 1, 1))
    assert host.adopt(first, False, 1) is None
    assert host.plan is first
    assert host.controller is not None
    np.testing.assert_array_equal(host.controller.reference(400).position, goal)
    assert host.adopt(of_flight, True, 1) is None
    assert host.controller.reference(400).position[0] > goal[0]


def test_a_plan_of_the_flight_after_a_reset_may_come_before_any_question_of_it() -> None:
    first = make_plan(ReferenceOnly(goal={"base_yaw": 0.1}, start=0.0), CSA)
    host = standing()
    host.observe(question(0))
    assert host.adopt(replace(first, start=1.0), True, 2) is None
    assert host.epoch == 2
    host.observe(question(0, 2))
    assert [start.start for start, _ in present(host.controller).plan_sequence.plans] == [1.0]


def test_a_plan_that_is_told_again_is_no_other_plan() -> None:
    plan = make_plan(ReferenceOnly(start=0.0), CSA)
    host = standing()
    for epoch in (0, 1):
        assert host.adopt(plan) is None
        for tick in range(3):
            host.observe(question(tick, epoch))
        assert host.adopt(plan) is None  # whose start is over
        assert host.reason is None
        assert (host.plan_count, host.plan_from) == (1, (0, 0))


def test_nested_settings_are_merged() -> None:
    old = {"filter": {"tip_sigma": 1.0, "rate_sigma": 2.0}, "kp": [1.0]}
    assert merged(old, {"filter": {"rate_sigma": 3.0}}) == {
        "filter": {"tip_sigma": 1.0, "rate_sigma": 3.0}, "kp": [1.0],
    }  # fmt: skip


def test_questions_are_answered_while_a_design_is_made() -> None:
    host = standing()
    answered: list[Any] = []
    effort(host, 0)

    def beside(make: Any) -> Any:
        answered.extend(host.observe(question(tick)) for tick in range(1, 8))
        return make()

    done = host.tune({"kp": [100.0, 100.0]}, tick=3, executor=beside)
    assert all(answer is not None for answer in answered)
    assert (done.tick, done.message) == (8, "kp: [100.0, 100.0] from tick 8 on")
    assert not host.events
    effort(host, 8)
    assert [event.tick for event in host.events] == [8]


def test_a_tuning_for_an_earlier_tick_than_one_that_waits_leaves_both_in_force() -> None:
    host = standing()
    effort(host, 0)
    assert host.tune({"kd": [50.0, 50.0]}, tick=4).tick == 4
    assert host.tune({"kp": [100.0, 100.0]}, tick=2).tick == 2
    seen = []
    for tick in range(1, 6):
        effort(host, tick)
        seen.append((host.values.get("kp"), host.values.get("kd")))
    soft, slow = [100.0, 100.0], [50.0, 50.0]
    assert seen == [(None, None), (soft, None), (soft, None), (soft, slow), (soft, slow)]
    assert [event.tick for event in host.events] == [2, 4]
