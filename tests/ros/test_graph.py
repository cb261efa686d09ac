"""Whom the bench waits for is said with the reason and the remedy."""

from collections.abc import Iterator
from threading import Event
from types import SimpleNamespace
from typing import Any

import pytest
import rclpy
from flexslew_msgs.msg import Measurement

from flexslew_lab.run.domain import locked_domain
from flexslew_plant.graph import topics
from flexslew_plant.ros.graph import UNKNOWN_NODE, has_publisher, missing_listeners
from flexslew_plant.ros.offers import publisher, qos

LOOKS = 2000  # until DDS has told, 10 ms each


@pytest.fixture
def context() -> Iterator[rclpy.Context]:
    with locked_domain() as domain:
        found = rclpy.Context()
        found.init(domain_id=domain)
        yield found
        found.shutdown()


@pytest.mark.parametrize(
    ("place", "topic", "missing"),
    [
        ("/a", "", ["recorder (it does not listen to /a/measurement)"]),
        ("/b", "measurement", [
            "recorder (it is in namespace /b, the bench in /a; start it with -r __ns:=/a)"
        ]),
        ("/a", "questions", [
            "recorder (it listens to /a/questions instead of /a/measurement; start both with the "
            "same remaps)"
        ]),
        ("/a", "measurement", []),
    ],
)  # fmt: skip
def test_who_does_not_hear_is_named_with_its_topic_and_what_to_change(
    context: rclpy.Context, place: str, topic: str, missing: list[str]
) -> None:
    plant = rclpy.create_node("plant", context=context, namespace="/a")
    questions = publisher(plant, topics.MEASUREMENT)
    assert missing_listeners(plant, [questions], ["recorder"]) == [
        "recorder (it is not on the graph)"
    ]
    recorder = rclpy.create_node("recorder", context=context, namespace=place)
    profile = qos(topics.TOPICS[topics.MEASUREMENT])
    if topic:
        recorder.create_subscription(Measurement, topic, print, profile)
    for _ in range(LOOKS):
        if missing_listeners(plant, [questions], ["recorder"]) == missing:
            break
        Event().wait(0.01)
    assert missing_listeners(plant, [questions], ["recorder"]) == missing


@pytest.mark.parametrize(
    ("names", "there"), [([], False), ([UNKNOWN_NODE], False), ([UNKNOWN_NODE, "lqr"], True)]
)
def test_a_publisher_that_has_no_name_any_more_is_not_there(names: list[str], there: bool) -> None:
    """As Fast DDS leaves them where many leave at once: a recorder waited 10 s for them."""
    infos = [SimpleNamespace(node_name=name) for name in names]
    node: Any = SimpleNamespace(get_publishers_info_by_topic=lambda topic: infos)
    heard: Any = SimpleNamespace(topic_name="/effort_command")
    assert has_publisher(node, heard) is there
