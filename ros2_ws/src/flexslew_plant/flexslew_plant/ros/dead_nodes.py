"""Removal of nodes from the graph after the death of their process, which cannot leave itself.

DDS keeps a killed process on the graph, and goes on sending to it, until its lease is over (20 s).
Where nodes have shared memory, as by their own profile, each of these messages creates a port
again, at times while a restarted process creates its own; see profiles/loopback.xml.
"""

from rclpy.node import Node

from flexslew_plant.bench.operation.presence import Heartbeat, Heartbeats
from flexslew_plant.graph import topics
from flexslew_plant.graph.rtps import FAST_DDS, dispose, send_to_all
from flexslew_plant.processes.process_identity import has_terminated

_PERIOD = 0.1  # between two polls [wall s]


class GraphCleanup:
    """Takes dead nodes off the graph of all processes of this machine.

    Args:
        node: node that queries the graph.
        heartbeats: heartbeats of all nodes.
    """

    def __init__(self, node: Node, heartbeats: Heartbeats) -> None:
        self._node, self._heartbeats = node, heartbeats
        self._next = 0.0  # [wall s]
        self._removed: set[int] = set()  # instances

    def poll(self, now: float) -> set[str]:
        """Check for dead nodes if it is time; return the names of those that were found."""
        removed: set[str] = set()
        if now < self._next:
            return removed
        self._next = now + _PERIOD
        for heartbeat in self._heartbeats.late_heartbeats(now):
            if heartbeat.instance in self._removed or not has_terminated(heartbeat.process):
                continue
            removed.add(heartbeat.node)
            self._heartbeats.ended(heartbeat)
            if not take_off_graph(self._node, heartbeat):  # done, or it took its leave itself
                self._removed.add(heartbeat.instance)
        return removed


def take_off_graph(node: Node, heartbeat: Heartbeat) -> bool:
    """Announce to all processes of this machine that a participant left; return if it was there.

    Fast DDS writes the last 16 bits of the process id into the prefix of a GUID (GuidUtils), which
    distinguishes the node of this beat from another of its name.

    Args:
        node: node that queries the graph.
        heartbeat: beat of a node of that participant; its process must be known.
    """
    topic = node.resolve_topic_name(topics.ALIVE)
    low = (int(heartbeat.process.split("/")[1]) & 0xFFFF).to_bytes(2, "little")
    requested = heartbeat.node, node.get_namespace(), FAST_DDS, low
    found = set()
    for info in node.get_publishers_info_by_topic(topic):
        gid = bytes(info.endpoint_gid)
        if (info.node_name, info.node_namespace, gid[:2], gid[4:6]) == requested:
            found.add(gid[:12])
    for prefix in found:
        send_to_all(dispose(prefix), node.context.get_domain_id())
    return bool(found)
