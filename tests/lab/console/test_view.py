"""What a page takes of the graph, on which anybody may say anything."""

import pytest

from flexslew_lab.console.view import BenchView
from flexslew_lab.log.messages.cdr import encode
from flexslew_plant.graph import topics
from flexslew_plant.graph.topics import TOPICS

NOTE = {"kind": "note", "data": '{"text": "it rings"}'}


@pytest.mark.parametrize(
    ("topic", "odd"),
    [
        (topics.EVENTS, {"kind": "note", "data": "{"}),
        (topics.EVENTS, {"kind": "note", "data": '{"text": 7}'}),
        (topics.EVENTS, {"kind": "note", "level": 9}),
        (topics.TESTBED, {"joint_names": ["a"], "settings": "{"}),  # without a unit and a limit
        (topics.PLAN, {"joint_names": ["a"], "period": 0.01, "position": [float("nan")]}),
        (topics.CONTROLLER_STATUS, {"controller": "a", "settings": "{"}),
    ],
)
def test_a_message_that_no_log_would_hold_is_passed_over(
    topic: str, odd: dict[str, object]
) -> None:
    view, kind = BenchView(), TOPICS[topics.EVENTS].type
    view.take(topic, TOPICS[topic].type, [encode(TOPICS[topic].type, odd), b"\0"])
    assert (view.joints, view.plan, view.controllers) == (None, None, {})
    view.take(topics.EVENTS, kind, [encode(kind, odd) for odd in ({"data": "["}, NOTE)])
    assert [event.message for event in view.events] == [""]
