"""Who was here before, whatever the wall clock says."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from math import inf
from socket import AF_INET, SOCK_DGRAM, socket
from typing import Any

import pytest
import rclpy

from flexslew_lab.run.domain import locked_domain
from flexslew_plant.bench.operation.presence import Heartbeat
from flexslew_plant.graph.rtps import ports
from flexslew_plant.processes.process_identity import current_identity
from flexslew_plant.ros.alive import Alive

HOUR = 3_600_000_000_000  # [ns]
LOOK = 0.02  # between two looks [wall s]


@pytest.fixture
def later() -> Iterator[str]:
    """Yield the identity of a process that was started after this one."""
    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    yield f"{current_identity().rpartition('/')[0]}/{child.pid}"
    child.communicate(b"\n")


def alive(own: Heartbeat) -> Alive:
    one: Any = object.__new__(Alive)
    one.heartbeat, one._since = own, {}
    return one  # type: ignore[no-any-return]


def test_one_that_came_later_is_the_younger_though_the_clock_was_set_back(later: str) -> None:
    first = Heartbeat("plant", "plant", 1, 2 * HOUR, current_identity())
    second = Heartbeat("plant", "plant", 2, HOUR, later)
    assert alive(first)._with_start_time(second).start_order > first.start_order
    assert alive(second)._with_start_time(first).start_order < second.start_order
    assert alive(first)._with_start_time(second)._replace(since=HOUR) == second


@pytest.mark.parametrize(
    "process", ["", "elsewhere/1", current_identity()], ids=["unknown", "elsewhere", "this one"]
)
def test_where_the_machine_cannot_tell_the_wall_clock_does(process: str) -> None:
    first = Heartbeat("plant", "plant", 1, 2 * HOUR, current_identity())
    second = Heartbeat("plant", "plant", 2, HOUR, process)
    assert alive(first)._with_start_time(second) == second


@pytest.fixture
def domain() -> Iterator[int]:
    with locked_domain() as number:
        rclpy.init(domain_id=number)
        yield number
        rclpy.shutdown()


@contextmanager
def undiscovered(domain: int, sockets: int) -> Iterator[None]:
    """Hold the ports of a participant that says nothing."""
    with ExitStack() as held:
        for number in range(sockets):
            one = held.enter_context(socket(AF_INET, SOCK_DGRAM))
            one.bind(("127.0.0.1", ports(domain)[-1] + number))
        yield


def first_after(one: Alive, patience: float) -> float:
    """Return for how long it listens before it is the first [wall s]; inf: for longer."""
    begin, looks = one._last_check, int(patience / LOOK)
    done = (LOOK * k for k in range(1, looks + 1) if one.is_first(begin + LOOK * k))
    return next(done, inf)


def test_one_listens_until_it_has_discovered_who_has_a_socket_on_this_machine(domain: int) -> None:
    one = Alive(rclpy.create_node("plant"), "plant")
    with undiscovered(domain, 2):
        assert first_after(one, 2.0) == inf
    assert first_after(one, 1.0) == pytest.approx(0.25, abs=LOOK)  # it may only now be heard


def test_a_port_that_another_process_sends_from_is_no_participant(domain: int) -> None:
    one = Alive(rclpy.create_node("plant"), "plant")
    with undiscovered(domain, 1):
        assert first_after(one, 1.0) == pytest.approx(0.25, abs=LOOK)


def test_one_that_stays_undiscovered_is_not_waited_for_for_ever(domain: int) -> None:
    one = Alive(rclpy.create_node("plant"), "plant")
    with undiscovered(domain, 2):
        assert first_after(one, 5.0) == pytest.approx(3.0, abs=2 * LOOK)


def test_one_that_was_held_up_itself_has_not_listened_meanwhile(domain: int) -> None:
    one = Alive(rclpy.create_node("plant"), "plant")
    assert not one.is_first(one._last_check + 10.0)
    assert first_after(one, 1.0) > 0.1
