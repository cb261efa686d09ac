"""A controller is ready once the recorder has acknowledged its status, and so receives all else."""

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
import rclpy
from flexslew_msgs import msg

from flexslew_control.controllers.host import ControllerHost
from flexslew_control.ros import announcer, answering
from flexslew_control.ros.announcer import StatusPublisher
from flexslew_control.ros.controller_node import ControllerNode
from flexslew_lab.run.domain import locked_domain
from flexslew_plant.bench import message_fields
from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.bench.operation.presence import Heartbeats
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.messages import message_of, stamp
from flexslew_plant.ros.start import start_ros


class Status:
    """A publisher of the status whose listener acknowledges when it is told to."""

    topic_name = "/controller_status"

    def __init__(self) -> None:
        self.acknowledged, self.published = False, list[Any]()
        self.publish = self.published.append

    def wait_for_all_acked(self, timeout: Any) -> bool:
        assert timeout.nanoseconds == 0  # a node that waits answers no question
        return self.acknowledged or not self.published


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [100.0]
    monkeypatch.setattr(announcer, "monotonic", lambda: now[0])
    return now


@pytest.fixture
def status(monkeypatch: pytest.MonkeyPatch) -> Status:
    one = Status()
    monkeypatch.setattr(announcer, "publisher", lambda node, topic: one)
    monkeypatch.setattr(announcer, "missing_listeners", lambda node, publishers, names: [])
    return one


def announced(listeners: list[str]) -> StatusPublisher:
    """Return what announces a controller that has all but an acknowledgement."""
    heartbeat = SimpleNamespace(instance=7)
    alive: Any = SimpleNamespace(previous=None, heartbeats=Heartbeats(), heartbeat=heartbeat)
    node: Any = SimpleNamespace()
    host, channels = ControllerHost("pd_feedforward", {}), [SimpleNamespace(publisher=None)] * 2
    answers: Any = SimpleNamespace(received=None, publishers=channels)
    return StatusPublisher(node, host, "pd_feedforward", alive, answers, listeners)


def test_it_is_not_connected_before_the_recorder_has_acknowledged(
    status: Status, clock: list[float]
) -> None:
    one = announced(["recorder"])
    assert one.missing_listeners() == ["a subscriber of /controller_status"]  # none published yet
    one.look()
    assert len(status.published) == 1
    assert one.missing_listeners() == ["a subscriber of /controller_status"]
    status.acknowledged = True
    assert one.missing_listeners() == []
    status.acknowledged = False
    assert one.missing_listeners() == []  # it was connected, and each status counts no more


def test_a_listener_that_takes_nothing_holds_it_up_for_some_seconds(
    status: Status, clock: list[float]
) -> None:
    one = announced(["recorder"])
    one.look()
    assert one.missing_listeners()
    clock[0] += 4.9
    assert one.missing_listeners()
    clock[0] += 0.2
    assert one.missing_listeners() == []


def test_it_waits_for_nobody_where_no_listener_is_required(
    status: Status, clock: list[float]
) -> None:
    assert announced([]).missing_listeners() == []


@pytest.fixture
def loop(monkeypatch: pytest.MonkeyPatch) -> Iterator[Loop]:
    with locked_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        start_ros(args=["--ros-args", "-p", "wait_for:=[recorder]"])
        one = Loop()
        yield one
        one.close(0.0)
        one.leave(0, lambda: None)
        rclpy.shutdown()


def controller(loop: Loop, bench: Bench) -> ControllerNode:
    """Return the node of a controller of a bench, which calls it."""
    node = ControllerNode("pd_feedforward", loop, by_call=True)
    settings = {"bench": bench.settings}
    fields = {"stamp": stamp(0.0), **message_fields.testbed_fields(bench, settings)}
    node._on_testbed(message_of(msg.Testbed, fields))
    return node


def test_a_controller_that_comes_in_flight_answers_once_the_recorder_is_there(
    loop: Loop, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else its first answers would be flown and stand in no log, if it is killed soon after."""
    now = 100.0
    monkeypatch.setattr(answering, "monotonic", lambda: now)
    bench = Bench(BenchSettings(active="pd_feedforward"))
    node, first = controller(loop, bench), bench.question
    assert node.answering.answer(first._replace(tick=200)) is None
    assert node._host.newest is None  # nor does its estimator begin
    now += 4.9
    assert node.answering.answer(first._replace(tick=690)) is None
    now += 0.2  # a recorder that has died must not keep it away for good
    answer = node.answering.answer(first._replace(tick=710))
    assert answer is not None
    assert answer.tick == 710


def test_at_tick_0_it_answers_since_the_plant_has_waited_for_all(loop: Loop) -> None:
    bench = Bench(BenchSettings(active="pd_feedforward"))
    assert controller(loop, bench).answering.answer(bench.question) is not None
