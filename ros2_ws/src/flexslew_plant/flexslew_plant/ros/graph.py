"""Queries of the graph: missing or incompatible listeners, and whether the plant is there."""

from collections.abc import Sequence
from time import monotonic
from typing import Any, Protocol

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.subscription import Subscription

from flexslew_plant.bench.operation.presence import Heartbeats
from flexslew_plant.graph.policies import HIDDEN


def listeners_of(node: Node, publisher: "Publisher[Any]") -> set[str]:
    """Return the names of all nodes that listen, with the namespace where it is another one."""
    names = set()
    for info in node.get_subscriptions_info_by_topic(publisher.topic_name):
        name = info.node_name.removeprefix(HIDDEN)
        here = info.node_namespace == node.get_namespace()
        names.add(name if here else f"{info.node_namespace.rstrip('/')}/{name}")
    return names


def missing_listeners(
    node: Node, publishers: Sequence["Publisher[Any]"], listeners: Sequence[str]
) -> list[str]:
    """Return which required listeners a sample published now would not reach, and why.

    A listener that requests a QoS that is not offered will never be reached, so it is not waited
    for; see incompatible.

    Args:
        node: node that publishes.
        publishers: publishers that the listeners must receive.
        listeners: names of nodes in the namespace of this one.
    """
    missing: dict[str, str] = {}
    for publisher in publishers:
        for name in set(listeners) - listeners_of(node, publisher):
            missing.setdefault(name, f"{name} ({_mismatch_reason(node, publisher, name)})")
        fitting = [
            info
            for info in node.get_subscriptions_info_by_topic(publisher.topic_name)
            if _fits(publisher, info)
        ]
        if publisher.get_subscription_count() < len(fitting):
            missing["a subscriber"] = f"a subscriber of {publisher.topic_name}"
    return sorted(missing.values())


def _mismatch_reason(node: Node, publisher: "Publisher[Any]", listener: str) -> str:
    """Return why a listener does not receive a topic, and what to change."""
    topic, here = publisher.topic_name, node.get_namespace()
    nodes = node.get_node_names_and_namespaces()
    places = {place for name, place in nodes if name.removeprefix(HIDDEN) == listener}
    if not places:
        return "it is not on the graph"
    if here not in places:
        where = f"it is in namespace {min(places)}, the bench in {here}"
        return f"{where}; start it with -r __ns:={here}"
    kinds = dict(node.get_topic_names_and_types())
    same_type = [
        other for other, kind in kinds.items() if kind == kinds.get(topic) and other != topic
    ]
    other_topics = [other for other in same_type if listener in _listeners_here(node, other)]
    if not other_topics:
        return f"it does not listen to {topic}"
    return f"it listens to {min(other_topics)} instead of {topic}; start both with the same remaps"


def _listeners_here(node: Node, topic: str) -> set[str]:
    return {
        info.node_name.removeprefix(HIDDEN)
        for info in node.get_subscriptions_info_by_topic(topic)
        if info.node_namespace == node.get_namespace()
    }


# a node of which DDS has reported a subscription before the name, or a publisher after it left
UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"


def incompatible(node: Node, publishers: Sequence["Publisher[Any]"]) -> set[tuple[str, str]]:
    """Return node, which may be UNNAMED, and topic of each request for a QoS not offered."""
    return {
        (info.node_name, publisher.topic_name)
        for publisher in publishers
        for info in node.get_subscriptions_info_by_topic(publisher.topic_name)
        if not _fits(publisher, info)
    }


def publishers_of(node: Node, subscription: "Subscription[Any]") -> set[str]:
    """Return the names of the nodes of this namespace that publish the topic subscribed to."""
    return {
        info.node_name
        for info in node.get_publishers_info_by_topic(subscription.topic_name)
        if info.node_namespace == node.get_namespace()
    }


def has_publisher(node: Node, subscription: "Subscription[Any]") -> bool:
    """Return whether a node that is on the graph publishes the topic subscribed to.

    Where many nodes leave at once, Fast DDS 3.2 sometimes reports publishers of a process after
    the report that it is gone: they have no name, and stay for good.
    """
    infos = node.get_publishers_info_by_topic(subscription.topic_name)
    return any(info.node_name != UNKNOWN_NODE for info in infos)


def _fits(publisher: "Publisher[Any]", info: Any) -> bool:
    """Return whether a subscription requests no more than is offered."""
    publisher_qos, subscription_qos = publisher.qos_profile, info.qos_profile
    reliable, latched = ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL
    return bool(
        (subscription_qos.reliability != reliable or publisher_qos.reliability == reliable)
        and (subscription_qos.durability != latched or publisher_qos.durability == latched)
    )


class _Stops(Protocol):
    def stop(self, code: int) -> None: ...


class PlantWatch:
    """Ends a loop when the plant, once seen, is gone for good.

    Another publisher of the plant's topics, such as a bag that is played, is not waited for.

    Args:
        loop: loop to stop.
        node: node that queries the graph.
        subscription: subscription to a topic that only the plant publishes.
        heartbeats: heartbeats of all nodes.
        enabled: False: only update `seen`, never stop the loop.

    Attributes:
        seen: the plant was there; set by the callback of this very subscription, since the plant
            may come and go between two polls. DDS may report other topics earlier than this one.
    """

    def __init__(
        self,
        loop: _Stops,
        node: Node,
        subscription: "Subscription[Any]",
        heartbeats: Heartbeats,
        enabled: bool,
    ) -> None:
        self._loop, self._enabled = loop, enabled
        self._node, self._subscription, self._heartbeats = node, subscription, heartbeats
        self.seen = False

    @property
    def plant_present(self) -> bool:
        """Whether a plant is on the graph: any publisher until a plant has sent a heartbeat."""
        if not self._subscription.get_publisher_count():
            return False
        plant_nodes = self._heartbeats.of_role("plant")
        alive = self._heartbeats.alive(monotonic()).keys()
        infos = self._node.get_publishers_info_by_topic(self._subscription.topic_name)
        names = {info.node_name for info in infos}
        named = not names.isdisjoint(plant_nodes)
        # without a name: reported before it, or left over for good, see has_publisher
        unnamed = UNKNOWN_NODE in names and not alive.isdisjoint(plant_nodes)
        return not plant_nodes or named or unnamed

    def look(self, code: int = 0, keep_running: bool = False) -> None:
        """Check for the plant; stop the loop with this code if it has left, or go on."""
        here = self.plant_present
        if self._enabled and self.seen and not here and not keep_running:
            self._loop.stop(code)
        self.seen = self.seen or here
