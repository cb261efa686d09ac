"""What an operator asks of a running bench, as short-lived service clients."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
from flexslew_msgs import srv
from rclpy.node import Node

from flexslew_plant import topics
from flexslew_plant.errors import FlexslewError
from flexslew_plant.ros.messages import stamp

_TIMEOUT = 5.0  # for the plant to be found and to answer [wall s]


@contextmanager
def _operator() -> Iterator[Node]:
    rclpy.init()
    node = rclpy.create_node("operator")
    try:
        yield node
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def _call(node: Node, kind: Any, name: str, request: Any, timeout: float = _TIMEOUT) -> Any:
    client = node.create_client(kind, name)
    if not client.wait_for_service(timeout_sec=_TIMEOUT):
        raise FlexslewError(
            f"no bench offers {name}; is one running, and with the same ROS_DOMAIN_ID?"
        )
    future = client.call_async(request)
    rclpy.spin_until_future_complete(node, future, timeout_sec=timeout)
    if not future.done():
        raise FlexslewError(f"the bench did not answer {name} within {timeout:g} s")
    return future.result()


def list_controllers() -> tuple[str, list[dict[str, Any]]]:
    """Return who is in charge and everybody's status.

    Raises:
        FlexslewError: there is no bench.
    """
    with _operator() as node:
        reply = _call(
            node, srv.ListControllers, topics.LIST_CONTROLLERS, srv.ListControllers.Request()
        )
    keys = ("controller", "law", "ready", "reason", "last_tick", "plan_hash")
    return reply.active, [{key: getattr(c, key) for key in keys} for c in reply.controllers]


def switch_controller(
    controller: str, at: float, strict: bool, max_effort_step: float
) -> tuple[bool, str]:
    """Return whether the switch is under way, and the bench's words.

    Args:
        controller: who takes over.
        at: simulated time [s]; 0: the next tick.
        strict: refuse a step of the effort above max_effort_step.
        max_effort_step: [N m or N].

    Raises:
        FlexslewError: there is no bench.
    """
    request = srv.SwitchController.Request(
        controller=controller,
        at=stamp(at),
        strict=strict,
        max_effort_step=max_effort_step,
        timeout=_TIMEOUT / 2,
    )
    with _operator() as node:
        reply = _call(node, srv.SwitchController, topics.SWITCH_CONTROLLER, request)
    return reply.ok, reply.message
