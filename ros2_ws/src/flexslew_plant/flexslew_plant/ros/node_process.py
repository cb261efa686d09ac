"""The process of a node: its signals, its exit code."""

import faulthandler
import gc
import signal
import sys
from collections.abc import Callable
from typing import Protocol

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.signals import SignalHandlerOptions

from flexslew_plant.errors import BadInput, FlexslewError
from flexslew_plant.graph.graph_names import require_name
from flexslew_plant.ros.departure import ABORT_TIMEOUT, CLOSE_TIMEOUT
from flexslew_plant.ros.interrupts import SignalHandler
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.start import start_ros
from flexslew_plant.ros.told_lines import write_line


class LoopNode(Protocol):
    """What a loop runs: one node or several.

    It may also have `interrupted()`, called at an interrupt: where it returns True, the object
    stops its loop itself, or is interrupted again. And `close()`, which finishes what must be
    whole, or raises FlexslewError: exit code 3; and `leave()`, which takes off the graph what the
    nodes of the loop do not take with them. They leave last.
    """

    def poll(self) -> float:
        """Do what is due; return the time until the next call [wall s]."""


_signal_handler = SignalHandler()


def _run(loop: Loop, node: LoopNode) -> int:
    """Run the loop; an interrupt ends it, unless `interrupted` returns True."""
    while True:
        try:
            return loop.run(node.poll)
        except KeyboardInterrupt:
            _signal_handler.mark_caught()
            keep_running = getattr(node, "interrupted", lambda: False)()
            if not keep_running:
                return 130


def _closed(node: LoopNode) -> int:
    """Finish what must be whole; return 3 where that failed."""
    try:
        getattr(node, "close", lambda: None)()
    except FlexslewError as error:
        write_line(f"error: {error}", wrong=True)
        return 3
    return 0


def namespace_arguments(namespace: str) -> list[str]:
    """Return the command line of a node in a namespace; empty: in none.

    Raises:
        BadInput: if it is not a valid name.
    """
    name = "/" + namespace.strip("/")
    if name == "/":
        return []
    require_name(name, "--namespace")
    return ["--ros-args", "-r", f"__ns:={name}"]


def run_node(build: Callable[[Loop], LoopNode], args: list[str] | None = None) -> None:
    """Initialise ROS, build the node, run its loop, clean up and exit.

    Args:
        build: takes the loop, returns what it serves.
        args: command line; None: that of the process.
    """
    # our own handlers: rclpy's would invalidate the context before the last messages are sent
    _signal_handler.install()
    faulthandler.register(signal.SIGUSR1)  # prints the stack of each thread, even of one that hangs
    node = loop = None
    code = 0
    try:
        start_ros(args=args, signal_handler_options=SignalHandlerOptions.NO)
        loop = Loop()
        node = build(loop)
        code = _run(loop, node)
    except (KeyboardInterrupt, ExternalShutdownException):
        code = 130
    except BadInput as error:
        write_line(f"error: {error}", wrong=True)
        code = 2
    except FlexslewError as error:
        write_line(f"error: {error}", wrong=True)
        code = 3
    finally:
        _signal_handler.ignore()
        if loop is not None:
            if node is not None:
                loop.close(ABORT_TIMEOUT if code == 130 else CLOSE_TIMEOUT)
                code = _closed(node) or code
            loop.leave(code, getattr(node, "leave", lambda: None))
        # the leave is announced to the graph only if the participant is really destroyed
        del node, loop
        gc.collect()
        rclpy.try_shutdown()
        signal.alarm(0)
    sys.exit(code)
