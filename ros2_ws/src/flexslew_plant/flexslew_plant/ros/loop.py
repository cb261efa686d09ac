"""The process of a node: its executor, its signals, its exit code."""

import gc
import os
import signal
import sys
from collections.abc import Callable
from math import inf
from time import monotonic
from typing import Protocol

import rclpy
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from flexslew_plant.errors import BadInput, FlexslewError
from flexslew_plant.ros.alive import Alive
from flexslew_plant.ros.graph import listeners_of

# environment variable: id of the process that started this node and without which it ends
SUPERVISOR = "FLEXSLEW_SUPERVISOR"
# How long a node stays at most until all have heard it [wall s]. For a listener that was held up,
# DDS repairs 256 messages of a topic every 3 s.
LAST_WORDS = 60.0
_HURRIED = 5.0  # the same when somebody has interrupted it, or for one that gives no sign of life


class Served(Protocol):
    """What a loop runs: one node or several.

    It may also have `interrupted()`, called when somebody wants it to end; where that returns True,
    it stops its loop itself, or is interrupted again.
    """

    def poll(self) -> float:
        """Do what is due; return after how many wall seconds to be called again."""

    def close(self) -> None:
        """Leave the graph."""


class _Interrupts:
    """SIGINT and SIGTERM end the process, also where the exception is swallowed on its way.

    What is raised within a compiler's callback or a destructor is printed and forgotten there.
    """

    def __init__(self) -> None:
        self._raised, self._taken = 0, 0

    def install(self) -> None:
        """Answer both signals from now on."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._raise)

    def ignore(self) -> None:
        """Answer them no more: it ends anyway."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)

    def taken(self) -> None:
        """Note that somebody has caught it."""
        self._taken = self._raised

    def raise_swallowed(self) -> None:
        """Raise again what nobody has caught.

        Raises:
            KeyboardInterrupt: there was a signal.
        """
        if self._raised > self._taken:
            raise KeyboardInterrupt

    def _raise(self, number: int, frame: object) -> None:
        self._raised += 1
        raise KeyboardInterrupt


_interrupts = _Interrupts()


class Loop:
    """The executor of one process. A callback may call `stop`, from then on `run` returns."""

    def __init__(self) -> None:
        self._executor = EventsExecutor()
        self._alive: dict[Node, Alive] = {}
        self._code: int | None = None
        self._due = 0.0  # when to poll [wall s]

    def hurry(self) -> None:
        """Poll before the next event: something changed that it has to know."""
        self._due = 0.0

    def add(self, node: Node) -> None:
        """Serve this node, too."""
        self._executor.add_node(node)

    def live(self, node: Node, role: str) -> Alive:
        """Serve this node and beat for it."""
        self._alive[node] = Alive(node, role)
        self._executor.add_node(node)
        return self._alive[node]

    def future(self) -> Future:
        """Return a future that a coroutine of this loop may await."""
        return self._executor.create_future()

    def close(self, patience: float) -> None:
        """Let go of the nodes as soon as they were heard, or patience is at an end [wall s].

        A writer that leaves takes with it what its listeners have not acknowledged, reliable or
        not. A listener that gives no sign of life is waited for only a few seconds.
        """
        start = monotonic()
        for node in self._executor.get_nodes():
            unheard = list(node.publishers)
            names, told = "", False
            while unheard and (waited := monotonic() - start) < patience:
                unheard = [
                    publisher
                    for publisher in unheard
                    if not publisher.wait_for_all_acked(Duration(seconds=0.05))
                ]
                self._serve(0.0)
                names = ", ".join(publisher.topic_name for publisher in unheard)
                if unheard and waited > 1.0 and not told:
                    node.get_logger().warning(f"stays until all is heard: {names}")
                    told = True
                listeners = {name for p in unheard for name in listeners_of(node, p)}
                if waited > 1.0 and self._dead(node, listeners):
                    break
            if unheard:
                node.get_logger().warning(f"leaves, not all heard: {names}")
        self._executor.shutdown()

    def _dead(self, node: Node, listeners: set[str]) -> set[str]:
        """Return the listeners that were alive once and have been silent for long."""
        alive = self._alive.get(node)
        return alive.presence.lost(listeners, _HURRIED, monotonic()) if alive else set()

    def _serve(self, timeout: float) -> None:
        """Beat, and let one callback run."""
        now = monotonic()
        due = min((alive.poll(now) for alive in self._alive.values()), default=inf)
        # never without a timeout: this executor would neither dispatch nor see a signal
        self._executor.spin_once(timeout_sec=max(min(timeout, due - now), 0.0))

    def stop(self, code: int) -> None:
        """End the loop; the process exits with this code."""
        self._code = code

    def run(self, poll: Callable[[], float]) -> int:
        """Serve the graph until stopped; return the exit code.

        Args:
            poll: called between events, returns after how many wall seconds it wants to be called
                again.
        """
        supervisor = int(os.environ.get(SUPERVISOR, "0"))
        next_look = 0.0
        while self._code is None:
            _interrupts.raise_swallowed()
            now = monotonic()
            if now >= self._due:
                self._due = now + poll()
            self._serve(self._due - now)
            if now >= next_look:
                if not rclpy.ok() or (supervisor and os.getppid() != supervisor):
                    return 130  # nobody would ever end this process
                next_look = now + 0.5
        return self._code


def _run(loop: Loop, served: Served) -> int:
    """Run the loop; an interrupt ends it, unless what is served has still something to do."""
    while True:
        try:
            return loop.run(served.poll)
        except KeyboardInterrupt:
            _interrupts.taken()
            stay = getattr(served, "interrupted", lambda: False)()
            if not stay:
                return 130


def within(namespace: str) -> list[str]:
    """Return the command line of a node in a namespace; empty: in none."""
    name = "/" + namespace.strip("/")
    return ["--ros-args", "-r", f"__ns:={name}"] if name != "/" else []


def run_node(build: Callable[[Loop], Served], args: list[str] | None = None) -> None:
    """Initialise ROS, build the node, run its loop, clean up and exit.

    Args:
        build: takes the loop, returns what it serves.
        args: command line; None: of the process.
    """
    # our own handlers: rclpy's would invalidate the context before the last words are said
    _interrupts.install()
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    served = loop = None
    code = 0
    try:
        loop = Loop()
        _interrupts.raise_swallowed()
        served = build(loop)
        code = _run(loop, served)
    except (KeyboardInterrupt, ExternalShutdownException):
        code = 130
    except BadInput as error:
        print(f"error: {error}", file=sys.stderr)
        code = 2
    except FlexslewError as error:
        print(f"error: {error}", file=sys.stderr)
        code = 3
    finally:
        _interrupts.ignore()
        if served is not None and loop is not None:
            loop.close(_HURRIED if code == 130 else LAST_WORDS)
            served.close()
        # the graph hears of our leaving only if the participant is really destroyed
        del served, loop
        gc.collect()
        rclpy.try_shutdown()
    sys.exit(code)
