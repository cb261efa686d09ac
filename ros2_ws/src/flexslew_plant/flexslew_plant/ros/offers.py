"""Publishers and subscriptions as the table of topics has them, and services that are answered."""

import warnings
from collections.abc import Callable
from functools import cache
from importlib import import_module
from inspect import iscoroutine
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from flexslew_plant.graph.topics import TOPICS, Topic
from flexslew_plant.ros.coroutines import start

_SEND_ATTEMPTS = 10  # of an answer, 0.1 s each
LISTENER_DEPTH = (
    100  # latched samples a listener takes at least: several nodes may publish one each
)


@cache
def message_class(kind: str) -> Any:
    """Return the class of `package/msg/Type`."""
    package, _, name = kind.split("/")
    return getattr(import_module(f"{package}.msg"), name)


def qos(topic: Topic, at_least: int = 0) -> QoSProfile:
    """Return the QoS of a topic.

    Args:
        topic: an entry of the table.
        at_least: samples kept, where the table has fewer.
    """
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=max(topic.depth, at_least),
        reliability=(
            ReliabilityPolicy.RELIABLE if topic.reliable else ReliabilityPolicy.BEST_EFFORT
        ),
        durability=(
            DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE
        ),
    )


def publisher(node: Node, name: str) -> "Publisher[Any]":
    """Return a publisher of a topic of the table."""
    topic = TOPICS[name]
    return node.create_publisher(message_class(topic.type), name, qos(topic))


def subscription(
    node: Node, name: str, callback: Callable[[Any], None], raw: bool = False, at: str = ""
) -> "Subscription[Any]":
    """Return a subscription to a topic of the table.

    Args:
        node: that listens.
        name: a key of TOPICS.
        callback: takes the message, or its bytes.
        raw: bytes instead of messages.
        at: another name on the graph.
    """
    topic = TOPICS[name]
    profile = qos(topic, LISTENER_DEPTH if topic.latched else 0)
    return node.create_subscription(
        message_class(topic.type), at or name, callback, profile, raw=raw
    )


def service(node: Node, kind: Any, name: str, answer: Callable[[Any, Any], Any]) -> None:
    """Offer a service with an answer that reaches a client not discovered by this node yet.

    A client may find the server before the server finds it, on a busy machine long before: Fast
    DDS waits 0.1 s for the listener of the answer, rclpy warns, and the answer is lost. It is sent
    again.

    Args:
        node: that offers it.
        kind: type of the service.
        name: of the service.
        answer: takes request and reply, returns the reply; or a coroutine, see coroutines.start.
    """
    # in a tuple a coroutine comes to send_response, and not to the executor
    made = node.create_service(kind, name, lambda request, reply: (answer(request, reply),))
    send = made.send_response

    def send_with_retries(response: Any, header: Any) -> None:
        for _ in range(_SEND_ATTEMPTS - 1):
            with warnings.catch_warnings(record=True) as warning_records:
                warnings.simplefilter("always")
                send(response, header)
            if not warning_records:
                return
        send(response, header)

    def send_when_ready(answered: tuple[Any], header: Any) -> None:
        (response,) = answered
        if iscoroutine(response):
            start(response, lambda reply: send_with_retries(reply, header))
        else:
            send_with_retries(response, header)

    made.send_response = send_when_ready
