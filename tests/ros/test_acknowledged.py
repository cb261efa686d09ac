"""A controller is ready once the recorder has acknowledged its status, and so receives all else."""

from types import SimpleNamespace
from typing import Any

import pytest

from flexslew_control.controllers.host import ControllerHost
from flexslew_control.ros import announcer
from flexslew_control.ros.announcer import StatusPublisher
from flexslew_plant.bench.operation.presence import Heartbeats


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
    host = ControllerHost("pd_feedforward", {})
    return StatusPublisher(
        node, host, "pd_feedforward", alive, [node, node], lambda: None, listeners
    )


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
