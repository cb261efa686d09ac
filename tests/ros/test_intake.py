"""What a recorder still waits for when the plant has left."""

from collections.abc import Iterator
from time import monotonic
from typing import Any

import pytest
import rclpy
from flexslew_msgs import msg

from flexslew_lab.ros.recorder.intake import MessageSource
from flexslew_lab.run.domain import locked_domain
from flexslew_plant.graph.topics import EFFORT_COMMAND, MEASUREMENT, TOPICS
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.offers import qos
from flexslew_plant.ros.parameters import new_node
from flexslew_plant.ros.start import start_ros

PATIENCE = 60.0  # of a busy machine [wall s]


@pytest.fixture
def loop(monkeypatch: pytest.MonkeyPatch) -> Iterator[Loop]:
    with locked_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        start_ros(args=[])
        one = Loop()
        yield one
        one.close(0.0)
        one.leave(0, lambda: None)
        rclpy.shutdown()


def test_who_never_falls_silent_holds_a_recorder_up_for_half_a_minute(loop: Loop) -> None:
    intake = MessageSource(new_node("recorder"), loop)
    others = rclpy.create_node("others")
    plant = others.create_publisher(msg.Measurement, MEASUREMENT, qos(TOPICS[MEASUREMENT]))
    known = qos(TOPICS[EFFORT_COMMAND])
    talker = others.create_publisher(msg.EffortCommand, EFFORT_COMMAND, known)

    def hears(publisher: Any, message: Any, now: float, plant_here: bool = False) -> bool:
        """Return whether it expects more at this time, at which it has heard a message."""
        end = monotonic() + PATIENCE
        topic = "/" + publisher.topic.lstrip("/")
        while topic not in (t for t, _ in intake.received(now, last=True)):
            assert monotonic() < end
            publisher.publish(message)
        return intake.has_pending(now, plant_here)

    assert hears(plant, msg.Measurement(), 100.0, plant_here=True)
    assert hears(talker, msg.EffortCommand(), 105.0)
    assert not intake.has_pending(115.1, plant_here=False)  # silent for long
    assert hears(talker, msg.EffortCommand(), 129.0)
    assert not hears(talker, msg.EffortCommand(), 131.0)
    others.destroy_node()
