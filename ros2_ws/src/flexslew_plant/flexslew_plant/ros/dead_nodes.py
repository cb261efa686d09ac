"""Removal of nodes from the graph after the death of their process, which cannot leave itself.

DDS keeps a killed process on the graph, and goes on sending to it, until its lease is over (20 s).
Where nodes have shared memory, as by their own profile, each of these messages creates a port
again, at times while a restarted process creates its own; see profiles/loopback.xml.
"""

from rclpy.node import Node

from flexslew_plant.bench.operation.presence import Beat, Presence
from flexslew_plant.graph import topics
from flexslew_plant.graph.rtps import FAST_DDS, dispose, tell_all
from flexslew_plant.processes.process_identity import has_ended

_PERIOD = 0.1  # between two polls [wall s]


class DeadNodes:
    """Takes dead nodes off the graph of all processes of this machine.

    Args:
        node: node that queries the graph.
        presence: heartbeats of all nodes.
    """

    def __init__(self, node: Node, presence: Presence) -> None:
        self._node, self._presence = node, presence
        self._next = 0.0  # [wall s]
        self._gone: set[int] = set()  # instances

    def poll(self, now: float) -> set[str]:
        """Check for dead nodes if it is time; return the names of those that were found."""
        dead: set[str] = set()
        if now < self._next:
            return dead
        self._next = now + _PERIOD
        for beat in self._presence.overdue(now):
            if beat.instance in self._gone or not has_ended(beat.process):
                continue
            dead.add(beat.node)
            self._presence.ended(beat)
            if not take_off_graph(self._node, beat):  # done, or it took its leave itself
                self._gone.add(beat.instance)
        return dead


def take_off_graph(node: Node, beat: Beat) -> bool:
    """Announce to all processes of this machine that a participant left; return if it was there.

    Fast DDS writes the last 16 bits of the process id into the prefix of a GUID (GuidUtils), which
    distinguishes the node of this beat from another of its name.

    Args:
        node: node that queries the graph.
        beat: beat of a node of that participant; its process must be known.
    """
    topic = node.resolve_topic_name(topics.ALIVE)
    low = (int(beat.process.split("/")[1]) & 0xFFFF).to_bytes(2, "little")
    requested = beat.node, node.get_namespace(), FAST_DDS, low
    found = set()
    for info in node.get_publishers_info_by_topic(topic):
        gid = bytes(info.endpoint_gid)
        if (info.node_name, info.node_namespace, gid[:2], gid[4:6]) == requested:
            found.add(gid[:12])
    for prefix in found:
        tell_all(dispose(prefix), node.context.get_domain_id())
    return bool(found)
