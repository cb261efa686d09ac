"""What every node of the bench shares: parameters, QoS, the loop, conversion of messages."""

import gc
import json
import os
import signal
import sys
from array import array
from collections.abc import Callable, Sequence
from time import monotonic
from typing import Any

import rclpy
from builtin_interfaces.msg import Time
from flexslew_msgs import msg
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from rclpy.task import Future

from flexslew_plant.arrays import Vector
from flexslew_plant.bench.events import Event
from flexslew_plant.bench.wire import stamp_of
from flexslew_plant.errors import BadInput, FlexslewError
from flexslew_plant.settings import flat, load_yaml, plain, validated

# environment variable: id of the process that started this node and without which it ends
SUPERVISOR = "FLEXSLEW_SUPERVISOR"
# How long a node stays at most until all have heard it [wall s]. For a listener that was held up,
# DDS repairs 256 messages of a topic every 3 s.
LAST_WORDS = 60.0
_HURRIED = 5.0  # the same when somebody has interrupted it

# Nothing on the loop may be lost: reliable, and deeper than the 1,000 ticks by which the plant lets
# anyone fall behind (Standby). Keeping all in DDS would stop every writer when a reader dies.
LOOP = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=4000,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)


def latched(depth: int) -> QoSProfile:
    """Return the QoS under which a late subscriber still gets the last `depth` samples."""
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


def new_node(name: str, own_parameters: bool = True) -> Node:
    """Return a node that takes any parameter; `settings_of` says which are right.

    Args:
        name: unless the command line says another one.
        own_parameters: False for the second node of a process, which has neither a name from the
            command line nor parameters.
    """
    return Node(
        name,
        use_global_arguments=own_parameters,
        start_parameter_services=own_parameters,
        allow_undeclared_parameters=True,
        automatically_declare_parameters_from_overrides=True,
    )


def parameters_of(node: Node) -> dict[str, Any]:
    """Return what the node was given, nested by the dots of the names."""
    given: dict[str, Any] = {}
    for name, parameter in node.get_parameters_by_prefix("").items():
        if name == "use_sim_time" or name.startswith(("qos_overrides", "start_type_description")):
            continue
        *path, last = name.split(".")
        place = given
        for part in path:
            place = place.setdefault(part, {})
        value = parameter.value
        if isinstance(value, str) and value.startswith("["):
            value = load_yaml(value, f"node {node.get_name()}: {name}")
        place[last] = value.tolist() if isinstance(value, array) else value
    return given


def declared(node: Node, kind: Any, given: dict[str, Any]) -> Any:
    """Return `given` as a section and declare the parameters that were left out.

    Nested sections are dotted names; what ROS cannot hold (a list of sections) is YAML text.

    Raises:
        BadInput: an unknown parameter or a value that is not allowed.
    """
    settings = validated(kind, given, f"node {node.get_name()}")
    read_only = ParameterDescriptor(read_only=True)
    for name, value in flat(plain(settings)).items():
        if not node.has_parameter(name):
            node.declare_parameter(name, value, read_only)
    return settings


def settings_of(node: Node, kind: Any) -> Any:
    """Return all parameters of the node as one section; see declared."""
    return declared(node, kind, parameters_of(node))


def unmatched(node: Node, publishers: Sequence[Publisher], listeners: Sequence[str]) -> list[str]:
    """Return whom a sample published now would not reach, of those that must be there."""
    missing = set()
    for publisher in publishers:
        found = node.get_subscriptions_info_by_topic(publisher.topic_name)
        missing |= set(listeners) - {info.node_name for info in found}
        if publisher.get_subscription_count() < len(found):
            missing.add(f"a subscriber of {publisher.topic_name}")
    return sorted(missing)


def wait_until_heard(node: Node, patience: float = _HURRIED) -> None:
    """Wait until everything that the node has published has arrived.

    A writer that leaves takes with it what its listeners have not acknowledged, reliable or not.

    Args:
        node: that will leave.
        patience: [wall s]
    """
    start, unheard = monotonic(), list(node.publishers)
    for limit, words in ((1.0, "stays until all is heard"), (patience, "leaves, not all heard")):
        unheard = [
            publisher
            for publisher in unheard
            if not publisher.wait_for_all_acked(
                Duration(seconds=max(start + limit - monotonic(), 0.0))
            )
        ]
        if unheard:
            names = ", ".join(publisher.topic_name for publisher in unheard)
            node.get_logger().warning(f"{words}: {names}")


def stamp(seconds: float) -> Time:
    """Return simulated seconds as a stamp."""
    return Time(**stamp_of(seconds)._asdict())


def doubles(values: Vector) -> "array[float]":
    """Return an array as the type that rclpy copies fastest."""
    return array("d", values.tobytes())


def event_message(event: Event) -> msg.Event:
    """Return the event as a message."""
    return msg.Event(
        stamp=stamp(event.time),
        tick=event.tick,
        epoch=event.epoch,
        level=int(event.level),
        source=event.source,
        kind=event.kind,
        message=event.message,
        data=json.dumps(event.data),
    )


class Loop:
    """The executor of one process. A callback may call `stop`, from then on `run` returns."""

    def __init__(self) -> None:
        self._executor = EventsExecutor()
        self._code: int | None = None
        self._due = 0.0  # when to poll [wall s]

    def hurry(self) -> None:
        """Poll before the next event: something changed that it has to know."""
        self._due = 0.0

    def add(self, node: Node) -> None:
        """Serve this node, too."""
        self._executor.add_node(node)

    def future(self) -> Future:
        """Return a future that a coroutine of this loop may await."""
        return self._executor.create_future()

    def close(self, patience: float) -> None:
        """Let go of the nodes as soon as they were heard, or patience is at an end [wall s]."""
        for node in self._executor.get_nodes():
            wait_until_heard(node, patience)
        self._executor.shutdown()

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
            now = monotonic()
            if now >= self._due:
                self._due = now + poll()
            # never without a timeout: this executor would neither dispatch nor see a signal
            self._executor.spin_once(timeout_sec=max(self._due - now, 0.0))
            if now >= next_look:
                if not rclpy.ok() or (supervisor and os.getppid() != supervisor):
                    return 130  # nobody would ever end this process
                next_look = now + 0.5
        return self._code


class PlantWatch:
    """Ends a loop when the plant, once seen, is gone for good.

    Args:
        loop: to stop.
        subscription: to a topic that only the plant publishes.
        enabled: otherwise it only watches.
    """

    def __init__(self, loop: Loop, subscription: Subscription[Any], enabled: bool) -> None:
        self._loop, self._subscription, self._enabled = loop, subscription, enabled
        self._seen = False

    def look(self, code: int = 0, stay: bool = False) -> None:
        """Look for the plant; stop the loop with this code if it has left, unless told to stay."""
        here = self._subscription.get_publisher_count() > 0
        if self._enabled and self._seen and not here and not stay:
            self._loop.stop(code)
        self._seen = self._seen or here


def run_node(build: Callable[[Loop], Any], args: list[str] | None = None) -> None:
    """Initialise ROS, build the node, run its loop, clean up and exit.

    Args:
        build: takes the loop, returns an object with `poll() -> float` and `close()`.
        args: command line; None: of the process.
    """
    # our own handlers: rclpy's would invalidate the context before the last words are said
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    thing = loop = None
    code = 0
    try:
        loop = Loop()
        thing = build(loop)
        code = loop.run(thing.poll)
    except (KeyboardInterrupt, ExternalShutdownException):
        code = 130
    except BadInput as error:
        print(f"error: {error}", file=sys.stderr)
        code = 2
    except FlexslewError as error:
        print(f"error: {error}", file=sys.stderr)
        code = 3
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # from here on it ends anyway
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        if thing is not None and loop is not None:
            loop.close(_HURRIED if code == 130 else LAST_WORDS)
            thing.close()
        # the graph hears of our leaving only if the participant is really destroyed
        del thing, loop
        gc.collect()
        rclpy.try_shutdown()
    sys.exit(code)
