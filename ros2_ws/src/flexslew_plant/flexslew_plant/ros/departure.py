"""The last words of a node: heard by all who listen before it leaves the graph."""

from collections.abc import Callable
from time import monotonic, sleep

from rclpy.duration import Duration
from rclpy.node import Node

from flexslew_plant.ros.alive import Alive
from flexslew_plant.ros.graph import UNNAMED, listeners_of, unmatched

# How long a node stays at most until all have heard it [wall s]. For a listener that was held up,
# DDS repairs 256 messages of a topic with every heartbeat: 3 s, or 0.02 s by profiles/loopback.xml.
DEPARTURE_TIMEOUT = 60.0
INTERRUPTED_TIMEOUT = (
    5.0  # the same when somebody has interrupted it, or for one that sends no heartbeat
)
_MATCHING = 1.0  # for a listener that was discovered and is not matched yet [wall s]
_ANSWERS = 1.0  # for clients, who may still wait for an answer [wall s]
_SEVERAL = 50  # callbacks between two polls at who has heard what


def wait_until_acknowledged(
    node: Node, alive: Alive | None, serve: Callable[[], None], patience: float
) -> None:
    """Return as soon as a node was heard, or patience is at an end.

    A writer that leaves takes with it what its listeners have not acknowledged, reliable or not.
    Listeners that send no heartbeat are waited for only a few seconds, and so is one that DDS names
    no more: it has left, and acknowledges nothing. Where nodes of the bench listen as well, nobody
    can tell who is behind, until DDS gives up one that is silent, after 20 s.
    Nobody tells a node whether an answer of its services was heard: it stays for a moment while
    clients do.

    Args:
        node: that wants to leave.
        alive: signs of life of the others, where it hears them.
        serve: lets one callback run.
        patience: [wall s].
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
        for _ in range(_SEVERAL):  # else signs of life would come later than they are sent
            serve()
        names = ", ".join(publisher.topic_name for publisher in unheard)
        if not unheard or waited <= 1.0:
            continue
        listeners = {name for p in unheard for name in listeners_of(node, p)}
        if not told:
            who = ", ".join(sorted(listeners))
            node.get_logger().warning(f"awaiting acknowledgement: {names}; heard by {who}")
            told = True
        if alive is None:
            continue
        now = monotonic()
        if alive.presence.lost(listeners, INTERRUPTED_TIMEOUT, now):
            break  # was alive once and has been silent for long
        gone = any(name.endswith(UNNAMED) for name in listeners)  # for good: see is_published
        nodes = listeners & alive.presence.alive(now).keys()
        if waited > INTERRUPTED_TIMEOUT and (gone or not nodes):
            break
    if unheard:
        node.get_logger().warning(f"exiting, unacknowledged: {names}")
    until = monotonic() + min(_ANSWERS, patience)
    while monotonic() < until and any(map(node.count_clients, services)):
        serve()
        sleep(0.01)
