"""The heartbeats of the nodes: each node sends its own on `alive` and receives the others'."""

import random
from collections.abc import Iterable
from time import monotonic, time_ns
from typing import Any

from flexslew_msgs import msg
from rclpy.node import Node

from flexslew_plant.bench.operation.presence import (
    HEARTBEAT_PERIOD,
    HEARTBEAT_TIMEOUT,
    Heartbeat,
    Heartbeats,
)
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics
from flexslew_plant.graph.rtps import count_participants
from flexslew_plant.processes.process_identity import current_identity, started
from flexslew_plant.refusal import Cause, Refusal
from flexslew_plant.ros.graph import UNKNOWN_NODE
from flexslew_plant.ros.offers import publisher, subscription

NODE_WAIT_TIME = 1.0  # for an older node to receive the beat of a newer one, or to leave [wall s]
_CHECK_PERIOD = 0.05  # counted at most between two checks for older nodes [wall s]
# for a node with a running process and no heartbeat received, on busy processors [wall s]
_PROCESS_TIMEOUT = 3.0
# topics that no other node publishes, by the roles that a bench has once
_ROLE_TOPICS = {"plant": topics.MEASUREMENT, "planner": topics.PLAN}
_PARTICIPANTS = "ros_discovery_info"  # of each participant (rmw_dds_common), in no namespace
_PREFIX = 12  # length of the participant part of a DDS GUID, one participant per process [B]


class Alive:
    """Sends the heartbeat of a node and keeps the heartbeats of the others.

    Args:
        node: node that sends the heartbeat.
        role: plant, controller, recorder, planner, console or live.
    """

    def __init__(self, node: Node, role: str) -> None:
        self._node, self.heartbeats = node, Heartbeats()
        self.heartbeat = Heartbeat(
            node.get_name(), role, random.getrandbits(63), time_ns(), current_identity()
        )
        self._message = msg.Alive(**self.heartbeat._asdict())
        self._publisher = publisher(node, topics.ALIVE)
        subscription(node, topics.ALIVE, self._receive)
        self._next = 0.0
        self._duplicate_since = 0.0  # when it found an older node [wall s]
        # for how long it has watched without, and with, a rival that sent no heartbeat [wall s]
        self._clear_time = self._duplicate_time = 0.0
        self._last_check = monotonic()  # [wall s]
        self._since: dict[tuple[int, int], int] = {}  # start times of other nodes

    @property
    def previous(self) -> Refusal | None:
        """The older node of the same name, or the older plant of this namespace, if any."""
        found = self.heartbeats.previous(self.heartbeat, monotonic())
        if found is None:
            return None
        words = f"another {found.role} called {found.node} is on the graph already"
        return Refusal(words, cause=Cause.DUPLICATE)

    def is_second(self, now: float) -> bool:
        """Return whether there is an older node; this one leaves unless the older one does.

        Raises:
            BadInput: if the older node stays, and has had the time to notice this one.
        """
        duplicate = self.previous
        self._duplicate_since = (self._duplicate_since or now) if duplicate else 0.0
        if duplicate and now - self._duplicate_since > NODE_WAIT_TIME:
            raise BadInput(
                f"{duplicate}; give this bench a namespace or a ROS_DOMAIN_ID of its own"
            )
        return duplicate is not None

    def is_first(self, now: float) -> bool:
        """Return whether there is no older node; call it before the node publishes or serves.

        A node on the graph that has not sent a heartbeat yet may be older, unless it stays silent:
        then it has died, or sends no heartbeats at all.
        """
        passed = min(
            now - self._last_check, _CHECK_PERIOD
        )  # receives nothing while it is held up itself
        self._last_check = now
        if self.previous:
            return False
        node = self._node
        participants = _participants(
            node.get_publishers_info_by_topic(_PARTICIPANTS, no_mangle=True)
        )
        here = count_participants(node.context.get_domain_id())
        if len(participants) < here or self._has_missing_heartbeats(now):
            self._clear_time, self._duplicate_time = 0.0, self._duplicate_time + passed
            return self._duplicate_time > (
                HEARTBEAT_TIMEOUT if len(participants) > here else _PROCESS_TIMEOUT
            )
        self._clear_time, self._duplicate_time = self._clear_time + passed, 0.0
        return self._clear_time >= HEARTBEAT_PERIOD

    def _has_missing_heartbeats(self, now: float) -> bool:
        """Return whether the graph shows rivals of its name or role that sent no heartbeat."""
        return self._count_duplicates() > len(self.heartbeats.later(self.heartbeat, now))

    def _count_duplicates(self) -> int:
        """Return how many other nodes have its name, its role where that is unique, or no name."""
        node, role_topic = self._node, _ROLE_TOPICS.get(self.heartbeat.role)
        here = [
            info
            for topic in (topics.ALIVE, *([role_topic] if role_topic else []))
            for info in node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
            if info.node_name == UNKNOWN_NODE
            or (
                info.node_namespace == node.get_namespace()
                and (topic == role_topic or info.node_name == self.heartbeat.node)
            )
        ]
        return len(_participants(here)) - 1

    def poll(self, now: float) -> float:
        """Beat if it is time; return when it is time again [wall s]."""
        if now >= self._next:
            self._publisher.publish(self._message)
            self._next = now + HEARTBEAT_PERIOD
        return self._next

    def _receive(self, message: msg.Alive) -> None:
        if message.instance != self.heartbeat.instance:
            heartbeat = Heartbeat(*(getattr(message, name) for name in Heartbeat._fields))
            self.heartbeats.receive(self._with_start_time(heartbeat), monotonic())

    def _with_start_time(self, heartbeat: Heartbeat) -> Heartbeat:
        """Return a beat with the start time of its process on the monotonic clock.

        The wall clock may have been set back since this node started: the newer node would be taken
        for the older. For a node on another machine only the wall clock is known.
        """
        key = heartbeat.instance, heartbeat.since
        if key not in self._since:
            here, remote_start = started(self.heartbeat.process), started(heartbeat.process)
            known = None not in (here, remote_start) and here != remote_start
            self._since[key] = (
                self.heartbeat.since + (remote_start or 0) - (here or 0)
                if known
                else heartbeat.since
            )
        return heartbeat._replace(since=self._since[key])


def _participants(found: Iterable[Any]) -> set[bytes]:
    """Return the participants of these publishers, which a graph query has returned."""
    return {bytes(info.endpoint_gid)[:_PREFIX] for info in found}
