from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.present import present

from flexslew_control.controllers.by_joint.pd_feedforward import PdFeedforward
from flexslew_control.controllers.controller import Activation, Controller
from flexslew_control.law import Law, MeasuredJoints
from flexslew_control.plan import Plan
from flexslew_plant.events import EstimateStarted
from flexslew_plant.measurement import Measurement

JOINTS, PERIOD = ("base_yaw", "hub_pitch"), 0.01
RAMP = np.linspace(0.0, 1.0, 101)[:, None] * np.array([1.0, 0.5])
PLAN = Plan(
    method="reference_only",
    joint_names=JOINTS,
    start=0.5,
    period=PERIOD,
    position=RAMP,
    velocity=np.ones((101, 2)),
    effort=np.full((100, 2), 3.0),
    state=np.zeros((101, 0)),
    duration=1.0,
)


class Counting(MeasuredJoints):
    """Keeps the keys of what it saw."""

    def __init__(self) -> None:
        self.seen: list[Any] = []
        self.resets: list[Any] = []

    def reset(self, measurement: Any) -> None:
        self.resets.append((measurement.epoch, measurement.tick))

    def update(self, measurement: Any) -> Any:
        self.seen.append((measurement.epoch, measurement.tick))
        return super().update(measurement)


class Integrating:
    """A law with a free state: it takes over without a step by itself."""

    def __init__(self) -> None:
        self.terms: dict[str, Any] = {}
        self.updates, self._s = 0, np.zeros(2)

    def reset(self, measurement: Any, estimate: Any, reference: Any, effort: Any) -> None:
        self._s = effort.copy()

    def update(self, measurement: Any, estimate: Any, reference: Any) -> Any:
        self.updates += 1
        return self._s


def controller(
    law: Law | None = None,
    handover_time: float = 1.0,
    requires_plan: bool = False,
    estimator: Counting | None = None,
) -> Controller:
    law = law or PdFeedforward(np.full(2, 460.0), np.full(2, 920.0))
    estimator = estimator or Counting()
    return Controller("a", estimator, law, JOINTS, PERIOD, Activation(handover_time, requires_plan))


def question(
    tick: Any, who: str = "a", epoch: int = 0, applied: Any = (0.0, 0.0), position: Any = (0.0, 0.0)
) -> Measurement:
    nothing = np.zeros(0)
    return Measurement(
        tick, epoch, tick * PERIOD, who, np.array(position), np.zeros(2), nothing, nothing,
        np.array(applied),
    )  # fmt: skip


def test_the_answer_carries_the_question_and_the_name() -> None:
    command = present(controller().observe(question(0))).command
    assert (command.tick, command.epoch, command.controller) == (0, 0, "a")
    assert command.effort.shape == (2,)


def test_a_repeated_question_gets_the_same_answer() -> None:
    law = Integrating()
    one = controller(law)
    first = one.observe(question(3))
    assert one.observe(question(3)) is first
    assert law.updates == 1


def test_an_old_question_gets_none() -> None:
    one = controller()
    one.observe(question(3))
    assert one.observe(question(2)) is None
    one.observe(question(0, epoch=1))
    assert one.observe(question(4, epoch=0)) is None


def test_a_question_to_somebody_else_gets_none() -> None:
    assert controller().observe(question(0, "b")) is None


def test_the_estimator_sees_every_tick_once_in_charge_or_not() -> None:
    estimator = Counting()
    one = controller(estimator=estimator)
    for tick in range(10):
        who = "a" if tick in (4, 5) else "b"
        one.observe(question(tick, who))
        one.observe(question(tick, who))
    assert estimator.seen == [(0, tick) for tick in range(10)]
    assert estimator.resets == [(0, 0)]
    assert one.last_tick == 9


def test_a_gap_and_a_new_epoch_start_the_estimator_again() -> None:
    estimator = Counting()
    one = controller(estimator=estimator)
    for tick in (0, 1, 5, 6):
        one.observe(question(tick))
    one.observe(question(0, epoch=1))
    assert estimator.resets == [(0, 0), (0, 5), (1, 0)]
    assert [(event.tick, event.what) for event in one.events] == [(5, EstimateStarted("a", False))]


def test_one_that_comes_in_flight_says_where_its_estimator_begins() -> None:
    one, successor = controller(), controller()
    one.observe(question(3))
    successor.take_over(one)
    successor.observe(question(4))
    assert [(event.tick, event.what) for event in one.events] == [(3, EstimateStarted("a", True))]
    assert not successor.events


def test_asked_again_about_the_same_tick_under_its_own_name_it_answers() -> None:
    estimator = Counting()
    one = controller(estimator=estimator)
    assert one.observe(question(7, "b")) is None
    assert one.observe(question(7, "a")) is not None
    assert estimator.seen == [(0, 7)]


def takeover(one: Any, applied: Any) -> Any:
    """Return the efforts of the ticks from 50 on, at which it takes over."""
    for tick in range(50):
        one.observe(question(tick, "b", applied=applied))
    efforts, last = [], applied
    for tick in range(50, 200):
        last = one.observe(question(tick, applied=last, position=(0.1, 0.0))).command.effort
        efforts.append(last)
    return np.array(efforts)


def test_a_law_without_a_free_state_is_blended_in() -> None:
    efforts = takeover(controller(), (30.0, -8.0))
    own = np.array([-460.0 * 0.1, 0.0])
    np.testing.assert_allclose(efforts[0], [30.0, -8.0], atol=1e-12)
    np.testing.assert_allclose(efforts[50], 0.5 * (own + np.array([30.0, -8.0])), atol=1e-12)
    np.testing.assert_allclose(efforts[100:], np.tile(own, (50, 1)))
    assert np.abs(np.diff(efforts, axis=0)).max() < 1.0


def test_a_law_with_a_free_state_takes_over_exactly() -> None:
    efforts = takeover(controller(Integrating()), (30.0, -8.0))
    np.testing.assert_array_equal(efforts, np.tile([30.0, -8.0], (150, 1)))


def test_the_handover_takes_its_time() -> None:
    efforts = takeover(controller(handover_time=0.2), (30.0, 0.0))
    np.testing.assert_allclose(efforts[20:, 0], -46.0)
    assert efforts[19, 0] > -46.0


def test_the_blend_is_one_of_the_terms() -> None:
    one = controller()
    one.observe(question(0, "b"))
    answer = present(one.observe(question(1, applied=(30.0, 0.0))))
    np.testing.assert_allclose(sum(answer.terms.values()), answer.command.effort)
    assert "handover" in answer.terms


def test_at_the_first_tick_there_is_no_predecessor() -> None:
    one = controller()
    one.adopt(replace(PLAN, start=0.0))
    answer = present(one.observe(question(0)))
    np.testing.assert_allclose(answer.command.effort, 3.0 + 920.0)


def test_after_a_plan_of_another_it_is_in_charge_again_without_a_step() -> None:
    one = controller()
    one.observe(question(0))
    one.observe(question(1, "b", applied=(5.0, 5.0)))
    answer = present(one.observe(question(2, applied=(9.0, 9.0), position=(0.2, 0.2))))
    np.testing.assert_allclose(answer.command.effort, 9.0)


def test_without_a_plan_it_holds_the_first_position() -> None:
    one = controller()
    one.observe(question(0, position=(0.3, -0.1)))
    answer = present(one.observe(question(1, position=(0.4, -0.1))))
    np.testing.assert_array_equal(answer.reference.position, [0.3, -0.1])
    np.testing.assert_allclose(answer.command.effort, [-46.0, 0.0])


def test_a_plan_is_followed_from_its_start() -> None:
    one = controller()
    assert one.adopt(PLAN) is None
    references = [present(one.observe(question(tick))).reference for tick in range(200)]
    for tick in (0, 49):
        np.testing.assert_array_equal(references[tick].position, 0.0)
        np.testing.assert_array_equal(references[tick].effort, 0.0)
    np.testing.assert_array_equal(references[50].effort, 3.0)
    np.testing.assert_allclose(references[100].position, [0.5, 0.25])
    for tick in (150, 199):
        np.testing.assert_array_equal(references[tick].position, [1.0, 0.5])
        np.testing.assert_array_equal(references[tick].velocity, 0.0)
        np.testing.assert_array_equal(references[tick].effort, 0.0)


def test_one_that_needs_a_plan_is_not_ready_and_silent_without() -> None:
    estimator = Counting()
    one = controller(requires_plan=True, estimator=estimator)
    assert one.reason
    assert one.observe(question(0)) is None
    assert estimator.seen == [(0, 0)]
    one.adopt(PLAN)
    assert one.reason is None
    assert one.observe(question(0)) is not None


@pytest.mark.parametrize("start", [0.0, 0.1])
@pytest.mark.parametrize("plan_first", [True, False])
def test_a_standby_that_came_in_flight_follows_the_plan_that_is_flown(
    start: float, plan_first: bool
) -> None:
    estimator, flown = Counting(), replace(PLAN, start=start)
    one = controller(requires_plan=True, estimator=estimator)
    if plan_first:
        assert one.adopt(flown) is None
    for tick in range(20, 31):
        assert one.observe(question(tick, "b")) is None
    if not plan_first:
        assert one.adopt(flown) is None
    assert one.reason is None
    reference = present(one.observe(question(31))).reference
    np.testing.assert_array_equal(reference.position, flown.reference(31).position)
    # what it estimated was about another reference
    assert estimator.resets == [(0, 20), *([] if plan_first else [(0, 31)])]


@pytest.mark.parametrize("heard", ["before", "after", "between"])
def test_one_that_came_in_flight_takes_the_plans_of_it_one_after_the_other(heard: str) -> None:
    """Whether it hears them before its first question, after it, or one of them."""
    first, later = replace(PLAN, start=0.0), replace(PLAN, start=0.25)
    one = controller(requires_plan=True)
    if heard != "after":
        assert one.adopt(first) is None
    if heard == "before":
        assert one.adopt(later, True) is None
    one.observe(question(27, "b"))
    if heard == "after":
        assert one.adopt(first) is None
    if heard != "before":
        assert one.adopt(later, True) is None
    for tick in (28, 29):
        one.observe(question(tick, "b"))
    np.testing.assert_array_equal(one.reference(30).position, later.reference(30).position)
    one.begin_epoch(1)
    np.testing.assert_array_equal(one.reference(30).position, first.reference(30).position)


@pytest.mark.parametrize("tuned", [False, True])
@pytest.mark.parametrize("plans", [1, 2])
@pytest.mark.parametrize("led_between", [False, True])
def test_who_came_in_flight_in_charge_joins_the_plans_that_it_hears_later(
    plans: int, led_between: bool, tuned: bool
) -> None:
    first, later = replace(PLAN, start=0.0), replace(PLAN, start=0.25)
    told = ((first, False), (later, True))[:plans]
    one, tick = controller(handover_time=0.2), 27
    answer = present(one.observe(question(tick, applied=(30.0, 0.0), position=(0.7, 0.1))))
    for plan, of_flight in told:
        assert one.adopt(plan, of_flight) is None
        # the answer to this question was given
        again = question(tick, applied=(30.0, 0.0), position=(0.7, 0.1))
        assert present(one.observe(again)) is answer
        if led_between:
            tick += 1
            answer = present(one.observe(question(tick, applied=(30.0, 0.0))))
    if tuned:
        before, one = one, controller(handover_time=0.2)
        one.take_over(before)
    if not led_between:
        tick += 1
        answer = present(one.observe(question(tick, applied=(30.0, 0.0))))
    assert one.reason is None
    np.testing.assert_allclose(answer.command.effort, (30.0, 0.0), atol=1e-12)  # without a step
    np.testing.assert_array_equal(answer.reference.position, told[-1][0].reference(tick).position)
    one.begin_epoch(1)
    np.testing.assert_array_equal(one.reference(30).position, first.reference(30).position)


def test_who_came_between_two_flights_joins_the_plan_that_it_hears_in_the_second() -> None:
    one = controller()
    for tick in range(18):
        one.observe(question(tick, epoch=1))
    assert one.adopt(replace(PLAN, start=0.0)) is None


def test_who_came_in_flight_refuses_what_is_told_too_late_as_the_others_do() -> None:
    """Unless the plan goes on from those that it follows: the others have heard it in time."""
    one, flown = controller(), replace(PLAN, start=0.0)
    one.observe(question(10))
    assert one.adopt(flown) is None
    for tick in range(11, 31):
        one.observe(question(tick))
    stray = replace(PLAN, start=0.25, position=PLAN.position + 0.5)
    assert "the bench is at 0.30 s" in str(one.adopt(stray, True))
    goes_on = replace(PLAN, start=0.2, position=PLAN.position + RAMP[20])
    assert one.adopt(goes_on, True) is None


@pytest.mark.parametrize("tuned", [False, True])
def test_who_was_in_charge_without_a_plan_takes_none_that_has_begun(tuned: bool) -> None:
    one, begun = controller(), replace(PLAN, start=0.0)
    for tick in range(31):
        one.observe(question(tick, "a" if tick < 3 else "b"))
    if tuned:
        before, one = one, controller()
        one.take_over(before)
    assert "the bench is at 0.30 s" in str(one.adopt(begun))
    one.begin_epoch(1)
    one.observe(question(31, "b", 1))
    assert one.adopt(begun) is None


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"start": 0.2}, "starts at 0.2 s, the bench is at 0.30 s"),
        ({"start": 0.3}, "starts at 0.3 s"),
        ({"joint_names": ("hub_pitch", "base_yaw")}, "the plan moves"),
        ({"period": 0.02}, "the period of the plan is 0.02 s"),
    ],
)
def test_a_plan_that_does_not_fit_is_refused_with_the_reason(changes: Any, words: str) -> None:
    one = controller()
    for tick in range(31):
        one.observe(question(tick))
    assert words in str(one.adopt(replace(PLAN, **changes)))
    assert one.plan is None
    refused = one.adopt(replace(PLAN, start=0.31))
    assert "moves at 0, the plan begins with 1" in str(refused)
    assert one.adopt(replace(PLAN, start=0.31, velocity=0.0 * PLAN.velocity)) is None
