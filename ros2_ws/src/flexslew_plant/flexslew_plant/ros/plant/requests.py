"""Services of the plant: granted while it flies, rests or waits, refused when it leaves."""

from collections.abc import Callable
from inspect import iscoroutinefunction
from typing import Any

from rclpy.node import Node

from flexslew_plant.bench.handover import RUN_OVER
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.offers import service


def add_service(
    node: Node, loop: Loop, kind: Any, name: str, answer: Callable[[Any, Any], Any]
) -> None:
    """Offer a service that refuses requests when the plant leaves.

    The plant still serves until its messages are acknowledged; but a request granted then would
    neither happen nor stand in the log.

    Args:
        node: node of the plant.
        loop: loop that serves the node.
        kind: type of the service.
        name: name of the service.
        answer: takes request and reply, returns the reply, at once or as a coroutine.
    """

    async def later(request: Any, reply: Any) -> Any:
        return _reject(reply) if loop.is_closing else await answer(request, reply)

    def at_once(request: Any, reply: Any) -> Any:
        return _reject(reply) if loop.is_closing else answer(request, reply)

    service(node, kind, name, later if iscoroutinefunction(answer) else at_once)


def _reject(reply: Any) -> Any:
    """Fill in why a request is refused; the success fields of replies are false by default."""
    if hasattr(reply, "result"):  # of simulation_interfaces
        reply.result.result = reply.result.RESULT_OPERATION_FAILED
        reply.result.error_message = str(RUN_OVER)
    elif hasattr(reply, "message"):
        reply.message = str(RUN_OVER)
    if hasattr(reply, "number"):  # of a fault
        reply.number = -1
    return reply
