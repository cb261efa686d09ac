"""Listens on behalf of a node, off its executor: messages wait in DDS until they are taken."""

from collections.abc import Iterator, Mapping
from typing import Any

from rclpy.node import Node
from rclpy.subscription import Subscription

from flexslew_plant.graph.policies import HIDDEN
from flexslew_plant.graph.topics import Topic
from flexslew_plant.ros.offers import LISTENER_DEPTH, message_class, qos


class HiddenListener:
    """Raw subscriptions of a second node, which ROS hides for the underscore in its name.

    Taking many messages at once costs the bench far less than waking up for each of them, and an
    executor wakes up for every subscription of its nodes.

    Args:
        node: the visible node; its namespace and its remappings apply.
        topics: topics by their absolute names in a bench without a namespace.

    Attributes:
        node: the second one.
    """

    def __init__(self, node: Node, topics: Mapping[str, Topic]) -> None:
        self.node = Node(
            HIDDEN + node.get_name(),
            context=node.context,
            namespace=node.get_namespace(),
            use_global_arguments=False,
            start_parameter_services=False,
            enable_rosout=False,
        )
        self._resolve = node.resolve_topic_name
        self.subscriptions: dict[str, Subscription[Any]] = {}
        for name, topic in topics.items():
            self.listen(name, topic)

    def listen(self, name: str, topic: Topic) -> None:
        """Subscribe to one more topic."""
        self.subscriptions[name] = self.node.create_subscription(
            message_class(topic.type),
            self._resolve(topic.name),
            _ignore,
            qos(topic, LISTENER_DEPTH if topic.latched else 0),
            raw=True,
        )

    def ignore(self, name: str) -> None:
        """Unsubscribe from a topic."""
        self.node.destroy_subscription(self.subscriptions.pop(name))

    def take(self) -> Iterator[tuple[str, bytes, Mapping[str, Any]]]:
        """Yield all waiting messages: topic as it was given, CDR, and the message info of DDS."""
        for name, subscription in self.subscriptions.items():
            with subscription.handle:
                take, kind = subscription.handle.take_message, subscription.msg_type
                while (taken := take(kind, True)) is not None:
                    yield name, *taken

    def close(self) -> None:
        """Leave the graph."""
        self.node.destroy_node()


def _ignore(_: Any) -> None:
    """Messages are taken by hand."""
