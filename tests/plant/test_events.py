"""Every kind of event: what it is on the topic and in a log, and what is made of it again."""

import json
from dataclasses import fields
from typing import Any, get_type_hints

import pytest

from flexslew_plant.errors import BadInput
from flexslew_plant.events import (
    EVENTS,
    DisturbanceChanged,
    Fact,
    FaultChanged,
    Level,
    Other,
    PlanRejected,
    SwitchCompleted,
    SwitchDropped,
    SwitchRequested,
    event_of,
    fact_of,
    kind_of,
    level_of,
)
from flexslew_plant.refusal import Cause

GIVEN: dict[str, Any] = {  # where any text, number or flag would not do
    "reason": "stale",
    "cause": Cause.NOT_READY,
    "text": "{kind: command_lost}",
    "shapes": {"yaw": 2.0},
    "fault": {"kind": "command_lost"},
    "settings": {"kp": [1.0]},
    "before": {"kp": [2.0]},
    "rejected": {"stale": 3},
    "effort_step": [0.5, -2.0],
}
PLAIN: dict[Any, Any] = {"str": "some text", "int": 3, "float": 0.5, "bool": True}


def example(kind: type[Any]) -> Any:
    """Return a fact of a kind with a value in every field."""
    hints = get_type_hints(kind)
    values = {}
    for item in fields(kind):
        words = str(hints[item.name])
        plain = next((value for name, value in PLAIN.items() if f"'{name}'" in words), None)
        plain = next((v for name, v in PLAIN.items() if name in words), plain)
        values[item.name] = GIVEN.get(item.name, plain)
    return kind(**values)


@pytest.mark.parametrize("kind", EVENTS)
def test_a_fact_comes_back_from_its_data_as_it_was(kind: str) -> None:
    fact = example(EVENTS[kind])
    event = event_of(fact, 7, 0.07, 1, "plant")
    assert event.kind == kind
    assert event.level in Level
    assert event.message.isprintable()
    data = json.loads(json.dumps(event.data, allow_nan=False))
    assert fact_of(kind, data) == fact
    assert fact_of(kind, {**data, "of_a_later_version": 1}) == fact or kind == "disturbance"


@pytest.mark.parametrize("kind", EVENTS)
def test_what_no_event_of_the_kind_holds_is_refused_with_its_key(kind: str) -> None:
    data = json.loads(json.dumps(event_of(example(EVENTS[kind]), 0, 0.0, 0, "x").data))
    for key in data:
        with pytest.raises(BadInput, match=key):
            fact_of(kind, {**data, key: [[object]]})


def test_keys_are_those_of_every_version() -> None:
    step = SwitchCompleted("a", "b", [0.5])
    assert event_of(step, 0, 0.0, 0, "plant").data == {"from": "a", "to": "b", "effort_step": [0.5]}
    push = DisturbanceChanged({"yaw": 2.0}, on=True)
    assert event_of(push, 0, 0.0, 0, "plant").data == {"yaw": 2.0, "on": True}
    wish = SwitchRequested("b", 5, False, 1.0, "me")
    assert set(event_of(wish, 0, 0.0, 0, "plant").data) == {
        "controller", "tick", "strict", "max_effort_step", "who",
    }  # fmt: skip


def test_the_level_of_what_begins_is_not_that_of_what_ends() -> None:
    assert [level_of(FaultChanged(on)) for on in (True, False)] == [Level.WARNING, Level.INFO]
    assert level_of(PlanRejected("0", "x", 1.0, "me")) is Level.INFO
    assert level_of(PlanRejected("0", controller="pd")) is Level.WARNING
    assert [level.number for level in Level] == [0, 1, 2]


def test_a_kind_that_nobody_knows_here_is_kept_as_it_is() -> None:
    fact: Fact = fact_of("of_a_later_version", {"a": [1]})
    assert fact == Other("of_a_later_version", {"a": [1]})
    assert event_of(fact, 0, 0.0, 0, "x").data == {"a": [1]}


def test_a_cause_is_one_of_those_that_are_known() -> None:
    data = {"controller": "b", "cause": "not_ready", "reason": "words"}
    assert fact_of(kind_of(SwitchDropped), data) == SwitchDropped("b", Cause.NOT_READY, "words")
    with pytest.raises(BadInput, match="cause: 'because'"):
        fact_of(kind_of(SwitchDropped), {**data, "cause": "because"})
