"""The heartbeats of the nodes: each node sends its own on `alive` and receives the others'."""

import random
from collections.abc import Iterable
from time import monotonic, time_ns
from typing import Any

from flexslew_msgs import msg
from rclpy.node import Node

from flexslew_plant.bench.operation.presence import BEAT_EVERY, SILENT_AFTER, Beat, Presence
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics
from flexslew_plant.graph.rtps import participants_here
from flexslew_plant.processes.process_identity import own_identity, started
from flexslew_plant.refusal import Cause, Refusal
from flexslew_plant.ros.graph import UNNAMED
from flexslew_plant.ros.offers import publisher, subscription

NOTICE = 1.0  # for an older node to receive the beat of a newer one, or to leave [wall s]
_LOOK = 0.05  # counted at most between two checks for older nodes [wall s]
# for a node with a running process and no heartbeat received, on busy processors [wall s]
_WAITS = 3.0
# topics that no other node publishes, by the roles that a bench has once
_OWN = {"plant": topics.MEASUREMENT, "planner": topics.PLAN}
_PARTICIPANTS = "ros_discovery_info"  # of each participant (rmw_dds_common), in no namespace
_PREFIX = 12  # length of the participant part of a DDS GUID, one participant per process [B]


class Alive:
    """Sends the heartbeat of a node and keeps the heartbeats of the others.

    Args:
        node: node that sends the heartbeat.
        role: plant, controller, recorder, planner, console or live.
    """

    def __init__(self, node: Node, role: str) -> None:
        self._node, self.presence = node, Presence()
        self.beat = Beat(node.get_name(), role, random.getrandbits(63), time_ns(), own_identity())
        self._message = msg.Alive(**self.beat._asdict())
        self._publisher = publisher(node, topics.ALIVE)
        subscription(node, topics.ALIVE, self._hear)
        self._next = 0.0
        self._met = 0.0  # when it found an older node [wall s]
        # for how long it has watched without, and with, a rival that sent no heartbeat [wall s]
        self._certain = self._doubted = 0.0
        self._looked = monotonic()  # [wall s]
        self._since: dict[tuple[int, int], int] = {}  # start times of other nodes, see _dated

    @property
    def older(self) -> Refusal | None:
        """The older node of the same name, or the older plant of this namespace, if any."""
        found = self.presence.older(self.beat, monotonic())
        if found is None:
            return None
        words = f"another {found.role} called {found.node} is on the graph already"
        return Refusal(words, cause=Cause.DUPLICATE)

    def is_second(self, now: float) -> bool:
        """Return whether there is an older node; this one leaves unless the older one does.

        Raises:
            BadInput: if the older node stays, and has had the time to notice this one.
        """
        older = self.older
        self._met = (self._met or now) if older else 0.0
        if older and now - self._met > NOTICE:
            raise BadInput(f"{older}; give this bench a namespace or a ROS_DOMAIN_ID of its own")
        return older is not None

    def is_first(self, now: float) -> bool:
        """Return whether there is no older node; call it before the node publishes or serves.

        A node on the graph that has not sent a heartbeat yet may be older, unless it stays silent:
        then it has died, or sends no heartbeats at all.
        """
        passed = min(now - self._looked, _LOOK)  # receives nothing while it is held up itself
        self._looked = now
        if self.older:
            return False
        node = self._node
        shown = _participants(node.get_publishers_info_by_topic(_PARTICIPANTS, no_mangle=True))
        here = participants_here(node.context.get_domain_id())
        if len(shown) < here or self._has_silent_rivals(now):
            self._certain, self._doubted = 0.0, self._doubted + passed
            return self._doubted > (SILENT_AFTER if len(shown) > here else _WAITS)
        self._certain, self._doubted = self._certain + passed, 0.0
        return self._certain >= BEAT_EVERY

    def _has_silent_rivals(self, now: float) -> bool:
        """Return whether the graph shows rivals of its name or role that sent no heartbeat."""
        return self._rivals_on_graph() > len(self.presence.younger(self.beat, now))

    def _rivals_on_graph(self) -> int:
        """Return how many other nodes have its name, its role where that is unique, or no name."""
        node, own = self._node, _OWN.get(self.beat.role)
        here = [
            info
            for topic in (topics.ALIVE, *([own] if own else []))
            for info in node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
            if info.node_name == UNNAMED
            or (
                info.node_namespace == node.get_namespace()
                and (topic == own or info.node_name == self.beat.node)
            )
        ]
        return len(_participants(here)) - 1

    def poll(self, now: float) -> float:
        """Beat if it is time; return when it is time again [wall s]."""
        if now >= self._next:
            self._publisher.publish(self._message)
            self._next = now + BEAT_EVERY
        return self._next

    def _hear(self, message: msg.Alive) -> None:
        if message.instance != self.beat.instance:
            beat = Beat(*(getattr(message, name) for name in Beat._fields))
            self.presence.hear(self._dated(beat), monotonic())

    def _dated(self, beat: Beat) -> Beat:
        """Return a beat with the start time of its process on the monotonic clock.

        The wall clock may have been set back since this node started: the newer node would be taken
        for the older. For a node on another machine only the wall clock is known.
        """
        key = beat.instance, beat.since
        if key not in self._since:
            here, there = started(self.beat.process), started(beat.process)
            known = None not in (here, there) and here != there
            self._since[key] = self.beat.since + (there or 0) - (here or 0) if known else beat.since
        return beat._replace(since=self._since[key])


def _participants(found: Iterable[Any]) -> set[bytes]:
    """Return the participants of these publishers, which a graph query has returned."""
    return {bytes(info.endpoint_gid)[:_PREFIX] for info in found}
