"""A host between the questions that its node receives and the answers that it publishes."""

from collections.abc import Callable
from math import inf
from time import monotonic
from typing import Any

from rclpy.node import Node
from rclpy.subscription import Subscription

from flexslew_control.controllers.host import ControllerHost
from flexslew_control.message_fields import state_bytes
from flexslew_control.ros.calling import PlantConnection
from flexslew_plant.bench.wire import Stamp, command_bytes, measurement_from, stamp_of
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics
from flexslew_plant.measurement import EffortCommand, Measurement
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.offers import subscription
from flexslew_plant.ros.outlets import DirectPublishers

_AT_ONCE = 0.005  # questions of a line answered before the graph is served again [wall s]
_BUSY = 0.5  # after a question the next one is waited for on the line alone [wall s]
_IDLE = 0.02  # else the graph is, for so long [wall s]
# a node that was started in flight waits so long for its listeners before it answers [wall s];
# without a limit no controller could come back after the recorder has died
_JOIN_PATIENCE = 5.0


class AnswerServer:
    """Answers `measurement` on `effort_command`, and publishes the intermediate results.

    These go out on `controller_state`. Where the plant has a line (see Calling), questions come on
    it; the subscription to `measurement` ends, and the answer goes out on the line before its copy
    does on `effort_command`.

    Args:
        node: node of the controller.
        outlets: outlets of the node.
        loop: loop that serves the node.
        host: host of the controller, which answers.
        observed: called with the tick of each question, after its answer.
        instance: instance of the node, as in its heartbeat.
        by_call: the plant shares this process and calls `answer` instead.

    Attributes:
        period: one tick of the bench [s].
        silent: an older node of this name answers; this one takes no questions.
        heard: subscription to the questions; None: they come by calls or on the line.
        sent: outlets of the commands, then of the states.
        missing_listeners: returns the nodes that must receive its messages, and do not yet.
    """

    def __init__(
        self,
        node: Node,
        outlets: DirectPublishers,
        loop: Loop,
        host: ControllerHost,
        observed: Callable[[int], None],
        instance: int,
        by_call: bool = False,
    ) -> None:
        self._node, self._outlets, self._host, self._observed = node, outlets, host, observed
        self._loop, self._instance = loop, instance
        self.period, self.inactive = 0.01, False
        self.publishers = [
            outlets.publisher(t) for t in (topics.EFFORT_COMMAND, topics.CONTROLLER_STATE)
        ]
        self.missing_listeners: Callable[[], list[str]] = list
        self._join_deadline = inf  # then a node started in flight answers at the latest [wall s]
        self.received: Subscription[Any] | None = None
        self._connection: PlantConnection | None = None
        self._last_question = -inf  # last time that a question came on the line or was due [wall s]
        self._last_received: tuple[int, int] | None = None  # newest before the line
        if not by_call:
            self._listen()
            self._connection = PlantConnection(
                node, host.name, self.publishers[0].publisher.topic_name
            )

    @property
    def name(self) -> str:
        """Name of the controller on the bench."""
        return self._host.name

    def answer(self, question: Measurement) -> EffortCommand | None:
        """Observe a question; return the answer, published already, if it names this controller."""
        return self._answer(question, None, None)

    def restart(self, period: float) -> None:
        """Forget received questions: a testbed was announced, with this period [s]."""
        self.period, self._last_received = period, None
        if self._connection is not None:
            self._connection.at_once()

    def expect(self) -> None:
        """Wait for questions on the line from now on: the next one comes at once, or has come."""
        self._last_question = monotonic()
        self._loop.hurry()

    def look(self, now: float) -> None:
        """Call the plant where it answers; subscribe to `measurement` where there is no line."""
        if self._connection is None:
            return
        self._connection.look(now, self.inactive)
        if self.received is None and self._connection.line_lost(now):
            self._listen()

    def fly(self) -> float:
        """Answer questions on the line for a moment; return the time to the next call [wall s]."""
        if self._connection is None or not self._connection.open:
            return inf
        if not self._connection.started and not self._begin():
            return _IDLE
        if self.received is not None:  # not within its own callback
            self._node.destroy_subscription(self.received)
            self.received = None
        now = monotonic()
        busy, until = now < self._last_question + _BUSY, now + _AT_ONCE
        while (data := self._connection.receive(busy)) is not None:
            self._last_question = monotonic()
            self._receive_on_line(data, self._connection)
            if self._last_question >= until:
                break
        return 0.0 if monotonic() < self._last_question + _BUSY else _IDLE

    def serve(self) -> bool:
        """Answer a pending question; return whether there was one."""
        if self._connection is not None and self._connection.started:
            data = self._connection.receive(False)
            if data is not None:
                self._receive_on_line(data, self._connection)
            return data is not None
        if self.received is None:
            return False
        with self.received.handle:
            taken = self.received.handle.take_message(self.received.msg_type, True)
        if taken is not None:
            self._receive(taken[0])
        return taken is not None

    def _listen(self) -> None:
        self.received = subscription(self._node, topics.MEASUREMENT, self._receive, raw=True)

    def _begin(self) -> bool:
        """Change to the line if all earlier questions were received; return whether it was done."""
        newest = self._host.newest
        required = newest if self.received is not None else None  # else none come otherwise
        if self._connection is None or not self._connection.can_begin(required, monotonic()):
            return False
        self._last_received = newest
        self._connection.begin()
        self.expect()
        return True

    def _receive(self, data: bytes) -> None:
        line = self._connection
        if line is not None and line.started:
            return
        try:
            question, at = measurement_from(data, self.period)
        except BadInput as error:
            self._host.ignored(topics.MEASUREMENT, str(error))
            self._observed(self._host.last_tick)
            return
        self._answer(question, at, None)
        if line is not None and line.open:
            self._begin()

    def _receive_on_line(self, data: bytes, line: PlantConnection) -> None:
        try:
            question, at = measurement_from(data, self.period)
        except BadInput:  # not in the format of a plant
            line.close()
            return
        if self._last_received is not None:
            if (question.epoch, question.tick) < self._last_received:
                return
            self._last_received = None
        line.hurry(question.controller == self.name and self.publishers[0].can_busy_wait())
        self._answer(question, at, line)

    def _answer(
        self, question: Measurement, at: Stamp | None, line: PlantConnection | None
    ) -> EffortCommand | None:
        if self.inactive or self._waits_for_listeners(question):
            return None
        answer, command = self._host.observe(question), None
        if answer is not None:
            command, (commands, states) = answer.command, self.publishers
            if line is not None or commands.received or states.received:
                at = at or stamp_of(question.time)
                data = command_bytes(command, at, self._instance)
                if line is not None:
                    line.send(data)
                commands.publish(data)
                if states.received:
                    states.publish(state_bytes(answer, at))
        self._observed(question.tick)
        return command

    def _waits_for_listeners(self, question: Measurement) -> bool:
        """Return whether this would be a first question in flight that the log cannot show.

        The log must contain where a new instance begins, also if the instance is killed soon after.
        """
        if question.tick == 0 or self._host.newest is not None or not self.missing_listeners():
            return False
        self._join_deadline = min(self._join_deadline, monotonic() + _JOIN_PATIENCE)
        return monotonic() < self._join_deadline
