"""A node with a coroutine that waits does nothing until there is something to do."""

from collections.abc import Callable, Iterator
from time import monotonic
from typing import Any

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger

from flexslew_lab.run.domain import locked_domain
from flexslew_plant.ros.coroutines import PendingResult, start
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.offers import service
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


def test_a_coroutine_is_resumed_once_by_each_result() -> None:
    first, second, seen = PendingResult(), PendingResult(), list[Any]()

    async def inner() -> Any:
        seen.append("inner")
        return await second

    async def outer() -> Any:
        seen.append(await first)
        found = await inner()
        return found, await first  # which is there: it does not wait

    start(outer(), seen.append)
    assert seen == []
    first.set_result(1)
    assert seen == [1, "inner"]
    second.set_result(2)
    assert seen == [1, "inner", (2, 1)]


def test_a_client_waits_without_a_turn_of_the_loop(loop: Loop) -> None:
    """The executor of rclpy would take a whole processor for it."""
    pending = list[PendingResult]()

    async def answer(_: Any, reply: Any) -> Any:
        pending.append(loop.future())
        reply.message = await pending[0]
        return reply

    node, other = rclpy.create_node("server"), rclpy.create_node("client")
    loop.add(node)
    service(node, Trigger, "wait", answer)
    client, executor = other.create_client(Trigger, "wait"), SingleThreadedExecutor()
    executor.add_node(other)

    def until(condition: Callable[[], Any]) -> None:
        end = monotonic() + PATIENCE
        while not condition():
            assert monotonic() < end
            executor.spin_once(timeout_sec=0.01)
            loop._spin_once(0.01)

    until(client.service_is_ready)
    reply = client.call_async(Trigger.Request())
    until(lambda: pending)
    turns, polls = 0, 0
    spin = loop._spin_once

    def counted(timeout: float) -> None:
        nonlocal turns
        turns += 1
        spin(timeout)

    def poll() -> float:
        nonlocal polls
        polls += 1
        if polls == 20:
            loop.stop(0)
        return 0.02

    loop._spin_once = counted  # type: ignore[method-assign]
    loop.run(poll)
    assert turns < 200  # with one that is resumed at every turn some ten thousand
    loop._spin_once = spin  # type: ignore[method-assign]
    executor.spin_once(timeout_sec=0.0)
    assert not reply.done()
    pending[0].set_result("at last")
    until(reply.done)
    assert reply.result().message == "at last"
    executor.shutdown()
    other.destroy_node()
