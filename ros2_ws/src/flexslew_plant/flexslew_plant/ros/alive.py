"""The signs of life of the nodes: each beats on `alive` and hears the others."""

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

NOTICE = 1.0  # for an older one to hear of a newer one, or to leave [wall s]
_LOOK = 0.05  # that counts between two looks at who was here before [wall s]
# for one whose process lives, and was not heard, on processors that are busy [wall s]
_WAITS = 3.0
# what nobody else publishes, of the roles that a bench has once
_OWN = {"plant": topics.MEASUREMENT, "planner": topics.PLAN}
_PARTICIPANTS = "ros_discovery_info"  # each publishes there (rmw_dds_common), in no namespace
_PREFIX = 12  # of a GUID of DDS, the part of its participant, which is one of a process [B]


class Alive:
    """Beats for a node and keeps who else is alive.

    Args:
        node: whose life it is.
        role: plant, controller, recorder, planner, console or live.
    """

    def __init__(self, node: Node, role: str) -> None:
        self._node, self.presence = node, Presence()
        self.beat = Beat(node.get_name(), role, random.getrandbits(63), time_ns(), own_identity())
        self._message = msg.Alive(**self.beat._asdict())
        self._publisher = publisher(node, topics.ALIVE)
        subscription(node, topics.ALIVE, self._hear)
        self._next = 0.0
        self._met = 0.0  # an older one [wall s]
        # for how long it has looked while nobody was there unheard, and while somebody was [wall s]
        self._certain = self._doubted = 0.0
        self._looked = monotonic()  # [wall s]
        self._since: dict[tuple[int, int], int] = {}  # of others, see _dated

    @property
    def older(self) -> Refusal | None:
        """Who was here before under the same name, or as a plant of this namespace, if any."""
        found = self.presence.older(self.beat, monotonic())
        if found is None:
            return None
        words = f"another {found.role} called {found.node} is on the graph already"
        return Refusal(words, cause=Cause.DUPLICATE)

    def is_second(self, now: float) -> bool:
        """Return whether another one was here before; this one leaves unless that does.

        Raises:
            BadInput: it stays, and has had the time to notice this one.
        """
        older = self.older
        self._met = (self._met or now) if older else 0.0
        if older and now - self._met > NOTICE:
            raise BadInput(f"{older}; give this bench a namespace or a ROS_DOMAIN_ID of its own")
        return older is not None

    def is_first(self, now: float) -> bool:
        """Return whether nobody was here before: asked before a node publishes or serves anything.

        Whoever is there, and was not heard of yet, may be one who was, unless it stays silent: then
        it has died, or gives no signs of life at all.
        """
        passed = min(now - self._looked, _LOOK)  # held up itself it hears nothing meanwhile
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
        """Return whether the graph shows others of its name or role that gave no sign of life."""
        return self._rivals_on_graph() > len(self.presence.younger(self.beat, now))

    def _rivals_on_graph(self) -> int:
        """Return how many others have its name, its role if that is had once, or no name yet."""
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
        """Return a beat since when its process runs by the clock that nobody sets.

        That of the wall may have been set back since this one started: the newer one would be taken
        for the older. Where the other one is on another machine there is no better one.
        """
        key = beat.instance, beat.since
        if key not in self._since:
            here, there = started(self.beat.process), started(beat.process)
            known = None not in (here, there) and here != there
            self._since[key] = self.beat.since + (there or 0) - (here or 0) if known else beat.since
        return beat._replace(since=self._since[key])


def _participants(found: Iterable[Any]) -> set[bytes]:
    """Return whose publishers these are, as a graph shows them."""
    return {bytes(info.endpoint_gid)[:_PREFIX] for info in found}
