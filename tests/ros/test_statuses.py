"""Whose status counts where several use one name: the oldest one's that is alive."""

from typing import Any

import pytest
from flexslew_msgs.msg import ControllerStatus

from flexslew_lab.log.messages.cdr import encode
from flexslew_lab.ros.recorder.namesakes import StatusFilter
from flexslew_plant.bench.operation.presence import Heartbeat, Heartbeats
from flexslew_plant.ros import statuses
from flexslew_plant.ros.statuses import StatusMonitor

OLD, YOUNG = (Heartbeat("pd", "controller", number, since=number) for number in (1, 2))


def status(instance: int, law: str = "pd_feedforward") -> Any:
    return ControllerStatus(controller="pd", law=law, instance=instance)


def cdr_of(instance: int) -> tuple[str, bytes]:
    return "/controller_status", encode(
        "flexslew_msgs/msg/ControllerStatus", {"controller": "pd", "instance": instance}
    )


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [0.0]
    monkeypatch.setattr(statuses, "monotonic", lambda: now[0])
    return now


def test_what_a_second_one_says_counts_once_the_first_has_gone(clock: list[float]) -> None:
    presence, taken = Heartbeats(), list[int]()
    said = StatusMonitor(presence, lambda each: taken.append(each.instance))
    presence.receive(OLD, 0.0)
    said.receive(status(1))
    said.receive(status(2))
    presence.receive(YOUNG, 0.5)
    said.poll(0.5)
    assert taken == [1]
    presence.receive(YOUNG, 2.0)  # and nothing of the first one
    said.poll(2.0)
    assert taken == [1, 2]
    assert said.counted["pd"].instance == 2


def test_who_comes_late_hears_of_both_and_takes_the_older_one(clock: list[float]) -> None:
    presence, taken = Heartbeats(), list[int]()
    said = StatusMonitor(presence, lambda each: taken.append(each.instance))
    for instance in (1, 2):  # nobody's sign of life was heard
        said.receive(status(instance))
    presence.receive(YOUNG, 0.1)
    presence.receive(OLD, 0.2)
    said.poll(0.2)
    assert taken == [1, 2, 1]


def test_whoever_tells_no_number_is_known_by_name(clock: list[float]) -> None:
    presence, taken = Heartbeats(), list[str]()
    said = StatusMonitor(presence, lambda each: taken.append(each.law))
    presence.receive(OLD, 0.0)
    said.receive(status(0, "mine"))
    said.poll(0.5)
    assert taken == ["mine"]


def test_a_log_leaves_out_a_second_one_and_keeps_one_that_was_started_again() -> None:
    presence = Heartbeats()
    log, first, second = StatusFilter(presence), cdr_of(1), cdr_of(2)
    other = "/truth", b""
    presence.receive(OLD, 0.0)
    assert list(log.filter_messages([first, second, other], 0.1)) == [first, other]
    presence.receive(OLD, 0.3)  # it has lived on
    assert not list(log.filter_messages([], 0.3))
    presence.receive(YOUNG, 5.0)
    assert not list(log.filter_messages([], 5.0))
    presence.receive(OLD, 6.0)
    assert not list(
        log.filter_messages([second], 6.1)
    )  # started while the dead one counts as alive
    presence.receive(YOUNG, 7.0)
    assert list(log.filter_messages([], 7.0)) == [second]


def test_a_log_has_at_its_end_what_still_waits() -> None:
    presence = Heartbeats()
    log, second = StatusFilter(presence), cdr_of(2)
    presence.receive(OLD, 0.0)
    assert not list(log.filter_messages([second], 0.1))
    assert list(log.filter_messages([], 0.1, last=True)) == [second]
