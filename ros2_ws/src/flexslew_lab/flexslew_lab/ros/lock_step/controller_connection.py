"""The plant's side of the topics to one controller's process; see docs/any_language.md."""

from collections.abc import Callable, Mapping
from time import monotonic
from typing import Any

import numpy as np
import rclpy
from flexslew_msgs import msg
from rclpy.experimental import EventsExecutor
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from flexslew_plant.bench.wire import command_from, measurement_bytes
from flexslew_plant.errors import BadInput, FlexslewError
from flexslew_plant.graph import topics
from flexslew_plant.measurement import EffortCommand, Measurement
from flexslew_plant.message_codec import leading
from flexslew_plant.network import require_loopback
from flexslew_plant.processes.atomic import atomic
from flexslew_plant.ros.alive import Alive
from flexslew_plant.ros.messages import message_of, stamp
from flexslew_plant.ros.offers import publisher, subscription
from flexslew_plant.ros.start import start_ros

_STAMP = leading("flexslew_msgs/msg/EffortCommand", "stamp.sec", "stamp.nanosec")
_NO_STATUS = "nothing was received on controller_status"
_POLL = 0.05  # longest wait for one message [wall s]


class ControllerFault(FlexslewError):
    """A controller's process breaks a rule of docs/any_language.md, in one line."""


class ControllerConnection:
    """A node in place of the plant, which exchanges questions and answers with one controller.

    Args:
        testbed: fields of flexslew_msgs/Testbed but for its stamp, which are announced.
        patience: longest wait for anything that must come [wall s].
        exit_words: returns how the controller's process has ended; empty: it runs.

    Attributes:
        node: the node.
        name: name of the controller, known once it is ready.
        commands: answers that came and were not taken yet, each with its stamp [s].
        status: last status of the controller; None: none came.
        heartbeats: by node, each with the wall time at which it came [s].
    """

    def __init__(
        self, testbed: Mapping[str, Any], patience: float, exit_words: Callable[[], str]
    ) -> None:
        self._fields, self._patience, self._exit_words = testbed, patience, exit_words
        # the arguments of this process are those of the controller
        start_ros(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self.node = node = rclpy.create_node("plant")
        self._executor = EventsExecutor()
        self._executor.add_node(node)
        require_loopback()
        self._alive = Alive(node, "plant")
        self._testbed = publisher(node, topics.TESTBED)
        self._measurement = publisher(node, topics.MEASUREMENT)
        self._state = publisher(node, topics.BENCH_STATE)
        self.name = ""
        self.commands: list[tuple[EffortCommand, float]] = []
        self.status: msg.ControllerStatus | None = None
        self.heartbeats: dict[str, list[tuple[msg.Alive, float]]] = {}
        self._decode_error = ""  # what is wrong with the newest answer
        self._answered = (-1, -1)  # epoch and tick of the last answer that was taken
        subscription(node, topics.EFFORT_COMMAND, self._on_command, raw=True)
        subscription(node, topics.CONTROLLER_STATUS, self._on_status)
        subscription(node, topics.ALIVE, self._on_heartbeat)

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown()

    def wait_for_start(self) -> None:
        """Wait until the controller has joined the graph.

        Raises:
            ControllerFault: it has not; see until.
        """
        self.until(
            lambda: self.status is not None or self._testbed.get_subscription_count() > 0,
            _NO_STATUS,
        )

    def announce(self) -> None:
        """Announce the testbed, wait until the controller is ready, and take its name.

        Raises:
            ControllerFault: it does not become ready, or subscribes to no measurement.
        """
        self._testbed.publish(message_of(msg.Testbed, {"stamp": stamp(0.0), **self._fields}))
        self.until(lambda: self.status is not None, _NO_STATUS)
        self.until(
            lambda: self.ready,
            lambda: f"it is not ready: {self.status.reason if self.status else ''}",
        )
        assert self.status is not None
        self.name = self.status.controller
        if not self.name:
            raise ControllerFault(
                "controller is empty in its controller_status; it must be its name"
            )
        self.until(
            lambda: self._measurement.get_subscription_count() > 0,
            "measurement has no subscription",
        )

    @property
    def ready(self) -> bool:
        """Whether the controller reports that it would answer."""
        return self.status is not None and bool(self.status.ready)

    @property
    def best_effort(self) -> bool:
        """Whether the controller subscribes to measurement without reliability."""
        found = self.node.get_subscriptions_info_by_topic(self._measurement.topic_name)
        return any(one.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT for one in found)

    @property
    def instances(self) -> set[int]:
        """The instances in the controller's heartbeats."""
        return {heartbeat.instance for heartbeat, _ in self.heartbeats.get(self.name, [])}

    def send(self, question: Measurement) -> None:
        """Publish a question."""
        self._measurement.publish(measurement_bytes(question))

    def ask(self, question: Measurement) -> EffortCommand:
        """Publish a question to the controller; return its answer.

        Raises:
            ControllerFault: none comes, or a bench would reject it.
        """
        self.commands.clear()
        self.send(question)
        self.until(lambda: bool(self.commands), f"no answer to tick {question.tick}")
        return self.take_answer(question)

    def take_answer(self, question: Measurement) -> EffortCommand:
        """Return the oldest answer that came.

        Raises:
            ControllerFault: a bench would reject it.
        """
        command, at = self.commands.pop(0)
        self.check(command, at, question)
        self._answered = question.epoch, question.tick
        return command

    def check(self, command: EffortCommand, at: float, question: Measurement) -> None:
        """Refuse an answer that a bench would reject.

        Args:
            command: the answer.
            at: its stamp [s].
            question: that it answers.

        Raises:
            ControllerFault: a bench would reject it.
        """
        tick, epoch = question.tick, question.epoch
        where = f"answer to tick {tick} of epoch {epoch}"
        if (command.tick, command.epoch) != (tick, epoch):
            if (command.epoch, command.tick) == self._answered:
                raise ControllerFault(
                    f"tick {command.tick} of epoch {command.epoch} is answered twice"
                )
            raise ControllerFault(f"{where}: it has tick {command.tick} of epoch {command.epoch}")
        if command.controller != self.name:
            raise ControllerFault(
                f"{where}: controller is {command.controller!r}, not {self.name!r}"
            )
        size = len(self._fields["effort_limit"])
        if command.effort.shape != (size,):
            raise ControllerFault(
                f"{where}: {command.effort.size} efforts; the bench has {size} actuators"
            )
        if not np.isfinite(command.effort).all():
            raise ControllerFault(f"{where}: an effort is not finite")
        instances = self.instances
        if instances and command.instance not in {0, *instances}:
            raise ControllerFault(
                f"{where}: its instance is {command.instance}, on alive {min(instances)}; a bench "
                "takes it for another process of that name"
            )
        if abs(at - question.time) > 1e-9:
            raise ControllerFault(
                f"{where}: its stamp is {at:.9g} s; that of the question is {question.time:.9g}"
            )

    def publish_state(self, state: str, tick: int, epoch: int) -> None:
        """Publish the state of the bench, `running` or `paused`, with the controller as active."""
        self._state.publish(
            msg.BenchState(state=state, tick=max(tick, 0), epoch=epoch, active=self.name)
        )

    def until(self, done: Callable[[], bool], otherwise: str | Callable[[], str]) -> None:
        """Wait for something.

        Raises:
            ControllerFault: it has not come in time, or the controller's process has ended.
        """
        end = monotonic() + self._patience
        while not done():
            if ended := self._exit_words():
                raise ControllerFault(ended)
            if monotonic() > end:
                words = otherwise if isinstance(otherwise, str) else otherwise()
                raise ControllerFault(f"{words} within {self._patience:g} s{self._qos_mismatch()}")
            self.spin_once(_POLL)

    def spin(self, seconds: float) -> None:
        """Receive messages for so long [wall s]."""
        end = monotonic() + seconds
        while (left := end - monotonic()) > 0.0:
            self.spin_once(min(left, _POLL))

    def spin_once(self, timeout: float) -> None:
        """Receive messages; wait for the first one at most so long [wall s].

        Raises:
            ControllerFault: an answer is no message.
        """
        self._alive.poll(monotonic())
        with atomic:  # as a node's loop does
            self._executor.spin_once(timeout_sec=timeout)
        if self._decode_error:
            words, self._decode_error = self._decode_error, ""
            raise ControllerFault(f"a bench cannot read its answer: {words}")

    def _on_command(self, data: bytes) -> None:
        try:
            command = command_from(data)
        except BadInput as error:
            self._decode_error = str(error)
            return
        sec, nanosec = _STAMP.unpack_from(data)
        self.commands.append((command, sec + 1e-9 * nanosec))

    def _on_status(self, message: msg.ControllerStatus) -> None:
        self.status = message

    def _on_heartbeat(self, message: msg.Alive) -> None:
        if message.role != "plant":  # its own
            self.heartbeats.setdefault(message.node, []).append((message, monotonic()))

    def _qos_mismatch(self) -> str:
        """Return which QoS keeps it and a bench from hearing each other, in words."""
        node, found = self.node, list[str]()
        for topic in (topics.CONTROLLER_STATUS, topics.EFFORT_COMMAND):
            for info in node.get_publishers_info_by_topic(node.resolve_topic_name(topic)):
                offered, table = info.qos_profile, topics.TOPICS[topic]
                if offered.reliability is ReliabilityPolicy.BEST_EFFORT:
                    found.append(f"it offers {topic} as best effort, a bench requests reliable")
                elif table.latched and offered.durability is DurabilityPolicy.VOLATILE:
                    found.append(f"it offers {topic} as volatile, a bench requests transient local")
        for info in node.get_subscriptions_info_by_topic(self._measurement.topic_name):
            if info.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL:
                found.append("it requests measurement as transient local, which is volatile")
        return "".join(f"; {words}" for words in found)
