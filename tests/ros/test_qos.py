"""The QoS that a bag states is the one that the bench offers."""

import pytest
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from flexslew_lab.log.bag_layout import TOPICS, qos_profile
from flexslew_plant.graph import topics
from flexslew_plant.ros.offers import qos

RECORDED = {name if name.startswith("/") else f"/{name}": name for name in topics.TOPICS}


@pytest.mark.parametrize("topic", sorted(set(TOPICS) & set(RECORDED)))
def test_a_bag_states_the_offered_qos(topic: str) -> None:
    stated, offered = qos_profile(topic), qos(topics.TOPICS[RECORDED[topic]])
    assert stated["depth"] == offered.depth
    kept = offered.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert stated["durability"] == ("transient_local" if kept else "volatile")
    reliable = offered.reliability == ReliabilityPolicy.RELIABLE
    assert stated["reliability"] == ("reliable" if reliable else "best_effort")


def test_most_of_the_graph_is_recorded() -> None:
    assert {"/measurement", "/effort_command", "/truth", "/events", "/clock"} <= set(TOPICS)
