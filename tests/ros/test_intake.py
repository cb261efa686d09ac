"""What a recorder still waits for when the plant has left."""

from collections.abc import Callable, Iterator
from pathlib import Path
from time import monotonic
from typing import Any

import pytest
import rclpy
from flexslew_msgs import msg

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.ros import recorder_node
from flexslew_lab.ros.recorder.intake import MessageSource
from flexslew_lab.run.domain import locked_domain
from flexslew_plant.graph.topics import EFFORT_COMMAND, MEASUREMENT, TOPICS
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.offers import qos
from flexslew_plant.ros.parameters import new_node
from flexslew_plant.ros.start import start_ros

PATIENCE = 60.0  # of a busy machine [wall s]


@pytest.fixture
def loop(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Loop]:
    with locked_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        start_ros(args=["--ros-args", "-p", f"folder:={tmp_path / 'bag'}"])
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


def test_an_interrupted_recorder_waits_for_the_last_answer_of_a_controller(
    loop: Loop, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """All nodes are interrupted at once, and the plant is the first to leave."""
    now = 1000.0
    monkeypatch.setattr(recorder_node, "monotonic", lambda: now)
    recorder = recorder_node.Recorder(loop)
    others = rclpy.create_node("others")
    plant = others.create_publisher(msg.Measurement, MEASUREMENT, qos(TOPICS[MEASUREMENT]))
    known = qos(TOPICS[EFFORT_COMMAND])
    talker = others.create_publisher(msg.EffortCommand, EFFORT_COMMAND, known)

    def until(condition: Callable[[], Any]) -> None:
        end = monotonic() + PATIENCE
        while not condition():
            assert monotonic() < end
            recorder.poll()

    def look() -> bool:
        """Return whether the recorder goes on after its next look at the graph."""
        nonlocal now
        now += 0.25
        recorder.poll()
        return not loop.stopped

    until(lambda: talker.get_subscription_count() and plant.get_subscription_count())
    plant.publish(msg.Measurement(controller="pd", period=0.01))
    until(lambda: recorder._watch.seen)
    assert recorder.interrupted()
    others.destroy_publisher(plant)
    until(lambda: not recorder._watch.plant_present)
    assert look()
    talker.publish(msg.EffortCommand(controller="pd", effort=[1.0]))
    until(lambda: recorder._order._waiting)
    assert look()
    others.destroy_publisher(talker)
    until(lambda: not recorder._source.has_pending(now, False))
    assert not look()
    recorder.close()
    efforts = BagReader(tmp_path / "bag").columns("/effort_command", {"effort"})["effort"]
    assert efforts.tolist() == [[1.0]]
    others.destroy_node()
