"""The last messages of a node: delivered to all listeners before it leaves the graph."""

from collections.abc import Callable
from time import monotonic, sleep

from rclpy.duration import Duration
from rclpy.node import Node

from flexslew_plant.ros.alive import Alive
from flexslew_plant.ros.graph import UNNAMED, listeners_of, unmatched

# How long a node stays at most until all listeners have acknowledged [wall s]. For one held up,
# DDS repairs 256 messages of a topic with every heartbeat: 3 s, or 0.02 s by profiles/loopback.xml.
DEPARTURE_TIMEOUT = 60.0
INTERRUPTED_TIMEOUT = (
    5.0  # the same for an interrupted node, or for a listener that sends no heartbeat
)
_MATCHING = 1.0  # for a listener that was discovered and is not matched yet [wall s]
_ANSWERS = 1.0  # for clients that may still wait for an answer [wall s]
_SEVERAL = 50  # callbacks between two checks of the acknowledgements


def wait_until_acknowledged(
    node: Node, alive: Alive | None, serve: Callable[[], None], patience: float
) -> None:
    """Return as soon as all messages of a node are acknowledged, or patience is at an end.

    A writer that leaves takes with it what its listeners have not acknowledged, reliable or not.
    A listener that sends no heartbeat is waited for only a few seconds, and so is one that has no
    name in DDS: it has left, and acknowledges nothing. Where nodes of the bench listen as well, it
    is unknown which listener is behind, until DDS gives up a silent one, after 20 s.
    A node cannot find out whether an answer of its services has arrived: it stays for a moment
    while there are clients.

    Args:
        node: node that leaves.
        alive: heartbeats of the other nodes; None: the node does not receive them.
        serve: lets one callback run.
        patience: longest wait [wall s].
    """
    start, told = monotonic(), False
    unheard, names = list(node.publishers), ""
    services = [service.srv_name for service in node.services]
    while unheard and (waited := monotonic() - start) < patience:
        unheard[0].wait_for_all_acked(Duration(seconds=0.05))
        matching = waited < _MATCHING
        unheard = [
            p
            for p in unheard
            if not p.wait_for_all_acked(Duration()) or (matching and unmatched(node, [p], []))
        ]
        for _ in range(_SEVERAL):  # else heartbeats would be received later than they are sent
            serve()
        names = ", ".join(publisher.topic_name for publisher in unheard)
        if not unheard or waited <= 1.0:
            continue
        listeners = {name for p in unheard for name in listeners_of(node, p)}
        if not told:
            who = ", ".join(sorted(listeners))
            node.get_logger().warning(f"awaiting acknowledgement: {names}; received by {who}")
            told = True
        if alive is None:
            continue
        now = monotonic()
        if alive.presence.lost(listeners, INTERRUPTED_TIMEOUT, now):
            break  # it has sent heartbeats, and has been silent for long
        gone = any(name.endswith(UNNAMED) for name in listeners)  # stays unnamed: see is_published
        nodes = listeners & alive.presence.alive(now).keys()
        if waited > INTERRUPTED_TIMEOUT and (gone or not nodes):
            break
    if unheard:
        node.get_logger().warning(f"exiting, unacknowledged: {names}")
    until = monotonic() + min(_ANSWERS, patience)
    while monotonic() < until and any(map(node.count_clients, services)):
        serve()
        sleep(0.01)
