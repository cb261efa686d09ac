"""Which plans a controller followed, as its statuses tell it."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flexslew_control.message_fields import plan_fields
from flexslew_control.plan import Plan
from flexslew_control.plans.plan_file import plan_hash
from flexslew_lab.log.messages.cdr import decode, encode
from flexslew_lab.replay.logged_controllers import plan_changes
from flexslew_plant.bench.message_fields import event_fields
from flexslew_plant.events import EstimateStarted, event_of

CAME = 3, 14  # epoch and tick of the first question that a newcomer heard
STATUS = "flexslew_msgs/msg/ControllerStatus"


def plan(goal: float) -> Plan:
    there = np.full((6, 1), goal)
    still = np.zeros_like(there)
    return Plan("none", ("yaw",), 0.0, 0.01, there, still, still[1:], np.zeros((6, 0)), 0.05)


FIRST, SECOND = plan(0.1), plan(0.2)


def log(*messages: tuple[str, str, Any]) -> Any:
    """Return a bag with these messages behind the two plans, both of tick 0."""
    plans = [("/plan", "flexslew_msgs/msg/Plan", plan_fields(each)) for each in (FIRST, SECOND)]
    coded = [(t, kind, 0, 0, encode(kind, fields)) for t, kind, fields in (*plans, *messages)]
    told = [decode(kind, data) for topic, kind, _, _, data in coded if topic == "/plan"]
    return SimpleNamespace(
        path=Path("crafted"),
        overview=SimpleNamespace(plans=told),
        messages=lambda topics: [m for m in coded if m[0] in topics],
    )


def status(plan: Plan, number: int, epoch: int, tick: int = 0) -> tuple[str, str, Any]:
    fields = {"controller": "pd", "plan_hash": plan_hash(plan), "plan_number": number}
    fields |= {"epoch": epoch, "last_tick": tick, "plan_epoch": epoch if number > 1 else 0}
    return "/controller_status", STATUS, fields


@pytest.mark.parametrize("epochs", [(0, 0, 0), (0, 3, 3), (3, 3, 3)])
def test_a_newcomer_follows_the_last_plan_that_it_heard_before_it_was_asked(
    epochs: tuple[int, int, int],
) -> None:
    """It hears the plans one by one, and of the epoch before them, between or behind them."""
    began = event_of(EstimateStarted("pd", True), CAME[1], 0.14, CAME[0], "pd")
    bag = log(
        status(SECOND, 2, 2),  # of its predecessor
        status(FIRST, 1, epochs[0]),
        status(FIRST, 1, epochs[1]),
        status(SECOND, 2, epochs[2]),
        ("/events", "flexslew_msgs/msg/Event", event_fields(began)),
        status(SECOND, 2, *CAME),
    )
    last = [found for found in plan_changes(bag) if found.first == CAME][-1]
    assert plan_hash(last.told[-1].plan) == plan_hash(SECOND)


@pytest.mark.parametrize("late", [False, True])
def test_one_that_comes_where_its_predecessor_had_no_plan_follows_it_from_its_first_question_on(
    late: bool,
) -> None:
    """The predecessor flew the epoch until then without one; its last word may come after."""
    empty = {"controller": "pd", "epoch": CAME[0], "instance": 1}
    without = ("/controller_status", STATUS, empty)
    topic, kind, fields = status(FIRST, 1, CAME[0])
    newcomer = topic, kind, fields | {"instance": 2, "plan_epoch": CAME[0]}
    unready = topic, STATUS, {"controller": "pd", "instance": 2}
    began = event_of(EstimateStarted("pd", True), CAME[1], 0.14, CAME[0], "pd")
    said = [unready, without, newcomer] if late else [without, unready, newcomer]
    bag = log(without, *said, ("/events", "flexslew_msgs/msg/Event", event_fields(began)))
    found = plan_changes(bag)
    assert [(each.first, plan_hash(each.told[-1].plan)) for each in found] == [
        (CAME, plan_hash(FIRST))
    ]


def test_one_that_names_a_plan_before_the_log_holds_it_follows_those_before_it_too() -> None:
    """It has seen no question, so its status stands at the time of none."""
    later = replace(plan(0.3), start=1.0)
    came = {"epoch": CAME[0], "instance": 2, "plan_epoch": CAME[0]}
    topic, kind, fields = status(later, 3, CAME[0])
    flown = plan_fields(later) | {"stamp": {"sec": 0, "nanosec": 140_000_000}}
    began = event_of(EstimateStarted("pd", True), CAME[1], 0.14, CAME[0], "pd")
    bag = log(
        status(SECOND, 2, CAME[0]),
        (topic, STATUS, {"controller": "pd", "instance": 2}),
        (topic, kind, fields | came),
        ("/plan", "flexslew_msgs/msg/Plan", flown),
        ("/events", "flexslew_msgs/msg/Event", event_fields(began)),
    )
    last = [found for found in plan_changes(bag) if found.first == CAME][-1]
    assert [plan_hash(told.plan) for told in last.told] == [plan_hash(SECOND), plan_hash(later)]
    assert [told.of_flight for told in last.told] == [False, True]


@pytest.mark.parametrize("late", range(5))
def test_a_newcomer_with_statuses_behind_its_first_question_follows_its_plan_from_there_on(
    late: int,
) -> None:
    """They wait while its predecessor counts as alive; the question does not."""
    began = event_of(EstimateStarted("pd", True), CAME[1], 0.14, CAME[0], "pd")
    topic, kind, fields = status(SECOND, 1, CAME[0])
    own = {"instance": 2, "plan_epoch": CAME[0]}
    told = [
        (topic, kind, {"controller": "pd", "instance": 2}),  # no testbed yet
        (topic, kind, {"controller": "pd", "instance": 2}),  # no plan yet
        (topic, kind, fields | own),
        (topic, kind, fields | own | {"last_tick": CAME[1]}),
    ]
    told.insert(late, ("/events", "flexslew_msgs/msg/Event", event_fields(began)))
    third = (topic, kind, {"controller": "pd", "instance": 3})
    before = status(FIRST, 1, CAME[0], 3)
    for log_end in ([], [third]):
        bag = log((topic, kind, before[2] | {"instance": 1}), *told, *log_end)
        found = [each for each in plan_changes(bag) if each.first == CAME]
        assert [plan_hash(each.told[-1].plan) for each in found] == [plan_hash(SECOND)]
