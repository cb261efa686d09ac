"""The QoS that a bag states is the one that the bench offers."""

import pytest
from flexslew_plant.ros.node import LOOP, latched
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from flexslew_lab.log.bag_layout import TOPICS, qos_profile


@pytest.mark.parametrize("topic", [t for t in TOPICS if t not in ("/rosout", "/tf_static")])
def test_a_bag_states_the_offered_qos(topic: str) -> None:
    known, stated = TOPICS[topic], qos_profile(topic)
    offered = latched(known.depth) if known.latched else LOOP
    assert stated["depth"] == offered.depth
    kept = offered.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert stated["durability"] == ("transient_local" if kept else "volatile")
    assert offered.reliability == ReliabilityPolicy.RELIABLE
    assert stated["reliability"] == "reliable"
