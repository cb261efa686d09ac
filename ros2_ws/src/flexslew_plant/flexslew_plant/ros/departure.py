"""The last messages of a node: delivered to all listeners before it leaves the graph."""

from collections.abc import Callable
from time import monotonic, sleep

from rclpy.duration import Duration
from rclpy.node import Node

from flexslew_plant.ros.alive import Alive
from flexslew_plant.ros.graph import UNKNOWN_NODE, listeners_of, missing_listeners

# How long a node stays at most until all listeners have acknowledged [wall s]. For one held up,
# DDS repairs 256 messages of a topic with every heartbeat: 3 s, or 0.02 s by profiles/loopback.xml.
CLOSE_TIMEOUT = 60.0
ABORT_TIMEOUT = 5.0  # the same for an interrupted node, or for a listener that sends no heartbeat
_MATCHING = 1.0  # for a listener that was discovered and is not matched yet [wall s]
_CLIENT_WAIT = 1.0  # for clients that may still wait for an answer [wall s]
_CALLBACK_COUNT = 50  # callbacks between two checks of the acknowledgements


def wait_for_listeners(
    node: Node, alive: Alive | None, run_callback: Callable[[], None], patience: float
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
        run_callback: lets one callback run.
        patience: longest wait [wall s].
    """
    start, warned = monotonic(), False
    pending, names = list(node.publishers), ""
    services = [service.srv_name for service in node.services]
    while pending and (elapsed := monotonic() - start) < patience:
        pending[0].wait_for_all_acked(Duration(seconds=0.05))
        matching = elapsed < _MATCHING
        pending = [
            p
            for p in pending
            if not p.wait_for_all_acked(Duration())
            or (matching and missing_listeners(node, [p], []))
        ]
        for _ in range(
            _CALLBACK_COUNT
        ):  # else heartbeats would be received later than they are sent
            run_callback()
        names = ", ".join(publisher.topic_name for publisher in pending)
        if not pending or elapsed <= 1.0:
            continue
        listeners = {name for p in pending for name in listeners_of(node, p)}
        if not warned:
            who = ", ".join(sorted(listeners))
            node.get_logger().warning(f"awaiting acknowledgement: {names}; received by {who}")
            warned = True
        if alive is None:
            continue
        now = monotonic()
        if alive.heartbeats.lost(listeners, ABORT_TIMEOUT, now):
            break  # it has sent heartbeats, and has been silent for long
        unknown = any(
            name.endswith(UNKNOWN_NODE) for name in listeners
        )  # stays unnamed: see has_publisher
        nodes = listeners & alive.heartbeats.alive(now).keys()
        if elapsed > ABORT_TIMEOUT and (unknown or not nodes):
            break
    if pending:
        node.get_logger().warning(f"exiting, unacknowledged: {names}")
    until = monotonic() + min(_CLIENT_WAIT, patience)
    while monotonic() < until and any(map(node.count_clients, services)):
        run_callback()
        sleep(0.01)
