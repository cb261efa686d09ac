"""The executor of a node's process."""

import os
import signal
from collections.abc import Callable
from math import inf
from time import monotonic

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.node import Node

from flexslew_plant.network import require_loopback
from flexslew_plant.processes.atomic import atomic
from flexslew_plant.ros.alive import Alive
from flexslew_plant.ros.coroutines import PendingResult
from flexslew_plant.ros.dead_nodes import take_off_graph
from flexslew_plant.ros.departure import wait_for_listeners
from flexslew_plant.ros.outlets import DirectPublishers
from flexslew_plant.ros.told_lines import write_line

# environment variable: id of the process that started this node and without which it ends
SUPERVISOR = "FLEXSLEW_SUPERVISOR"
_BEGINNING = 0.02  # between two checks for older nodes [wall s]
_CLOSE_TIMEOUT = 10  # until a process that hangs in DDS is ended [wall s]


class Loop:
    """The executor of one process. A callback may call `stop`, from then on `run` returns."""

    def __init__(self) -> None:
        self._executor = EventsExecutor()
        self._alive: dict[Node, Alive] = {}
        self._publishers: list[DirectPublishers] = []
        self._code: int | None = None
        self._next_poll = 0.0  # when to poll [wall s]
        self._last_service = monotonic()  # until then, before it runs [wall s]
        self._nodes: list[Node] = []
        self._closing = False

    def hurry(self) -> None:
        """Poll before the next event, since its input has changed."""
        self._next_poll = 0.0

    def add(self, node: Node) -> None:
        """Serve this node, too.

        Raises:
            RunFault: if other machines could reach it, see network.require_loopback.
        """
        require_loopback()
        self._executor.add_node(node)
        self._nodes.append(node)

    def live(self, node: Node, role: str) -> Alive:
        """Serve this node and send its heartbeat."""
        self._alive[node] = Alive(node, role)
        self.add(node)
        return self._alive[node]

    def only(self, node: Node, role: str) -> Alive:
        """Serve a node of a role that a bench has once, and return when it is the only one.

        Raises:
            BadInput: if an older node of the role stays.
        """
        alive = self.live(node, role)
        self.begin(alive, lambda: alive.is_second(monotonic()))
        return alive

    def begin(self, alive: Alive, check: Callable[[], object] = lambda: None) -> None:
        """Serve this node until it is the first of its name, or the loop is stopped.

        So a second one publishes nothing, answers no request and acts on no message.

        Args:
            alive: heartbeat of a node that has published nothing yet.
            check: called repeatedly meanwhile.
        """
        while not (alive.is_first(monotonic()) or self.stopped):
            check()
            if self._parent_lost:
                self.stop(130)
            self._spin_once(_BEGINNING)
        self._last_service = monotonic()

    @property
    def _parent_lost(self) -> bool:
        """Whether ROS or the supervisor is gone, so that nothing would ever end this process."""
        parent = int(os.environ.get(SUPERVISOR, "0"))
        return not rclpy.ok() or bool(parent and os.getppid() != parent)

    def direct_publishers(self, node: Node) -> DirectPublishers:
        """Return outlets of a node of this loop, which serves them with the node."""
        self._publishers.append(DirectPublishers(node))
        return self._publishers[-1]

    def future(self) -> PendingResult:
        """Return a future that a coroutine of this loop may await."""
        return PendingResult(executor=self._executor)

    def own(self, node: Node) -> None:
        """Take a node that is not served; it leaves with the others."""
        self._nodes.append(node)

    def close(self, patience: float) -> None:
        """Release the nodes once their messages are acknowledged, or patience [wall s] is over."""
        self._closing = True
        for node in self._executor.get_nodes():
            alive = self._alive.get(node)
            wait_for_listeners(node, alive, lambda: self._spin_once(0.0), patience)
        for publishers in self._publishers:
            publishers.close()
        self._executor.shutdown()

    def leave(self, code: int, before: Callable[[], None]) -> None:
        """Take all nodes off the graph, after the call of `before`.

        Fast DDS 3.2 hangs at times where others leave at the same moment: one thread waits for the
        events in PDP::removeWriterProxyData, the events wait for it to announce this node. It holds
        up all of Python. SIGALRM then ends the process; the supervisor has received its code, and
        the other nodes the announcement that the nodes are gone.
        """
        if SUPERVISOR in os.environ:
            write_line(f"leaves with exit code {code}")
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(_CLOSE_TIMEOUT)
        before()
        for node, alive in self._alive.items():
            if alive.heartbeat.process:
                take_off_graph(node, alive.heartbeat)
        while self._nodes:
            self._nodes.pop().destroy_node()

    def _spin_once(self, timeout: float) -> None:
        """Send the heartbeats that are due, and let one callback run."""
        now = monotonic()
        next_heartbeat = min((alive.poll(now) for alive in self._alive.values()), default=inf)
        with atomic:  # raised while rclpy makes a message, an interrupt comes out as RuntimeError
            # never without a timeout: this executor would neither dispatch nor see a signal
            self._executor.spin_once(timeout_sec=max(min(timeout, next_heartbeat - now), 0.0))

    @property
    def stopped(self) -> bool:
        """Whether `stop` was called."""
        return self._code is not None

    @property
    def is_closing(self) -> bool:
        """Whether its nodes stay only until their messages are acknowledged, without polls."""
        return self.stopped or self._closing

    def stop(self, code: int) -> None:
        """End the loop; the process exits with this code."""
        self._code = code

    def run(self, poll: Callable[[], float]) -> int:
        """Serve the graph until stopped; return the exit code.

        Args:
            poll: called between events; returns the time until its next call [wall s].
        """
        # while a node was built, it received no message
        built, self._last_service = max(monotonic() - self._last_service, 0.0), inf
        for alive in self._alive.values():
            alive.heartbeats.extend_timeouts(built)
        next_check = 0.0
        while self._code is None:
            now = monotonic()
            for publishers in self._publishers:
                publishers.turn()
            if now >= self._next_poll:
                with atomic:  # an interrupt finds no half-written tick or chunk
                    for publishers in self._publishers:
                        publishers.look(now)
                    self._next_poll = now + poll()
            for publishers in self._publishers:
                publishers.send()
            self._spin_once(self._next_poll - now)
            if now >= next_check:
                if self._parent_lost:
                    return 130
                next_check = now + 0.5
        return self._code
