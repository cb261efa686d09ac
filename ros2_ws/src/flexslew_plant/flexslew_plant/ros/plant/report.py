"""What the plant node prints: progress, which nodes are missing, which are duplicates."""

from collections.abc import Sequence

from rclpy.node import Node

from flexslew_plant.bench.operation.run_state import FINISHED
from flexslew_plant.bench.operation.session import Session
from flexslew_plant.events import SecondPlant
from flexslew_plant.ros.alive import Alive
from flexslew_plant.ros.dead_nodes import GraphCleanup
from flexslew_plant.ros.graph import UNKNOWN_NODE, incompatible
from flexslew_plant.ros.outlet import DirectPublisher
from flexslew_plant.ros.told_lines import write_line

_QOS_CHECK_PERIOD = 1.0  # between two checks for incompatible QoS requests [wall s]


class PlantReport:
    """Prints the progress and logs problems of the graph.

    Args:
        node: the plant.
        session: session of the plant.
        alive: signs of life.
        progress: print the tick twice per second of wall time, and the last one.
        publishers: outlets that must reach their listeners.
    """

    def __init__(
        self,
        node: Node,
        session: Session,
        alive: Alive,
        progress: bool,
        publishers: Sequence[DirectPublisher],
    ) -> None:
        self._node, self._session, self._alive = node, session, alive
        self._progress, self._publishers = (
            progress,
            [topic_publisher.publisher for topic_publisher in publishers],
        )
        self._graph_cleanup = GraphCleanup(node, alive.heartbeats)
        self._next, self._last_tick = 0.0, -1  # when to print again [wall s]; the last tick printed
        self._waiting_for: list[str] = []  # nodes that the bench waits for, as logged
        self._duplicates: set[str] = set()  # younger plants
        self._next_qos = 0.0  # of the next check for incompatible QoS requests [wall s]
        self._warned: set[tuple[str, str]] = set()  # node and topic

    def poll(self, now: float) -> None:
        """Print the progress, log missing nodes and second plants; let go of dead nodes."""
        session = self._session
        for name in self._graph_cleanup.poll(now):
            session.node_progress.clear(name)
        if self._progress:
            self._print_tick(now)
        duplicates = {
            heartbeat.node for heartbeat in self._alive.heartbeats.later(self._alive.heartbeat, now)
        }
        for name in sorted(duplicates - self._duplicates):
            session.bench.tell(SecondPlant(name))
        self._duplicates = duplicates
        if session.waiting_for != self._waiting_for:
            self._waiting_for = session.waiting_for
            if self._waiting_for:
                self._node.get_logger().info(f"waiting for {', '.join(self._waiting_for)}")
        if now >= self._next_qos:
            self._warn_of_qos(now)

    def _print_tick(self, now: float) -> None:
        run, bench = self._session.run, self._session.bench
        over = run.state == FINISHED and bench.tick != self._last_tick
        if over or (run.running and now >= self._next):
            write_line(f"tick {bench.tick} of {bench.last_tick}")
            self._next, self._last_tick = now + 0.5, bench.tick

    def _warn_of_qos(self, now: float) -> None:
        """Warn once of each node that requests a QoS that is not offered, whenever it comes."""
        found = incompatible(self._node, self._publishers)
        named = {(node, topic) for node, topic in found if node != UNKNOWN_NODE}
        for node, topic in sorted(named - self._warned):
            self._node.get_logger().warning(f"incompatible QoS requested: {node} on {topic}")
        self._warned |= named
        self._next_qos = now + _QOS_CHECK_PERIOD
