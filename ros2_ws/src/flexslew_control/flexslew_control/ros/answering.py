"""A host between the questions that its node receives and the answers that it publishes."""

from collections.abc import Callable
from math import inf
from time import monotonic
from typing import Any

from rclpy.node import Node
from rclpy.subscription import Subscription

from flexslew_control.controllers.host import ControllerHost
from flexslew_control.message_fields import state_bytes
from flexslew_control.ros.calling import Calling
from flexslew_plant.bench.wire import Stamp, command_bytes, measurement_from, stamp_of
from flexslew_plant.graph import topics
from flexslew_plant.measurement import EffortCommand, Measurement
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.offers import subscription
from flexslew_plant.ros.outlets import Outlets

_AT_ONCE = 0.005  # questions of a line answered before the graph is served again [wall s]
_BUSY = 0.5  # after a question the next one is waited for on the line alone [wall s]
_IDLE = 0.02  # else the graph is, for so long [wall s]


class Answering:
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
    """

    def __init__(
        self,
        node: Node,
        outlets: Outlets,
        loop: Loop,
        host: ControllerHost,
        observed: Callable[[int], None],
        instance: int,
        by_call: bool = False,
    ) -> None:
        self._node, self._outlets, self._host, self._observed = node, outlets, host, observed
        self._loop, self._instance = loop, instance
        self.period, self.silent = 0.01, False
        self.sent = [outlets.publisher(t) for t in (topics.EFFORT_COMMAND, topics.CONTROLLER_STATE)]
        self.heard: Subscription[Any] | None = None
        self._calling: Calling | None = None
        self._asked = -inf  # last time that a question came on the line or was due [wall s]
        self._heard_before: tuple[int, int] | None = None  # newest before the line
        if not by_call:
            self._listen()
            self._calling = Calling(node, host.name, self.sent[0].publisher.topic_name)

    @property
    def name(self) -> str:
        """Name of the controller on the bench."""
        return self._host.name

    def answer(self, question: Measurement) -> EffortCommand | None:
        """Observe a question; return the answer, published already, if it names this controller."""
        return self._answered(question, None, None)

    def begin_anew(self, period: float) -> None:
        """Forget received questions: a testbed was announced, with this period [s]."""
        self.period, self._heard_before = period, None
        if self._calling is not None:
            self._calling.at_once()

    def expect(self) -> None:
        """Wait for questions on the line from now on: the next one comes at once, or has come."""
        self._asked = monotonic()
        self._loop.hurry()

    def look(self, now: float) -> None:
        """Call the plant where it answers; subscribe to `measurement` where there is no line."""
        if self._calling is None:
            return
        self._calling.look(now, self.silent)
        if self.heard is None and self._calling.hung_up(now):
            self._listen()

    def fly(self) -> float:
        """Answer questions on the line for a moment; return the time to the next call [wall s]."""
        if self._calling is None or not self._calling.open:
            return inf
        if not self._calling.begun and not self._begin():
            return _IDLE
        if self.heard is not None:  # not within its own callback
            self._node.destroy_subscription(self.heard)
            self.heard = None
        now = monotonic()
        busy, until = now < self._asked + _BUSY, now + _AT_ONCE
        while (data := self._calling.receive(busy)) is not None:
            self._asked = monotonic()
            self._hear_on_line(data, self._calling)
            if self._asked >= until:
                break
        return 0.0 if monotonic() < self._asked + _BUSY else _IDLE

    def serve(self) -> bool:
        """Answer a pending question; return whether there was one."""
        if self._calling is not None and self._calling.begun:
            data = self._calling.receive(False)
            if data is not None:
                self._hear_on_line(data, self._calling)
            return data is not None
        if self.heard is None:
            return False
        with self.heard.handle:
            taken = self.heard.handle.take_message(self.heard.msg_type, True)
        if taken is not None:
            self._hear(taken[0])
        return taken is not None

    def _listen(self) -> None:
        self.heard = subscription(self._node, topics.MEASUREMENT, self._hear, raw=True)

    def _begin(self) -> bool:
        """Change to the line if all earlier questions were received; return whether it was done."""
        newest = self._host.newest
        waits_for = newest if self.heard is not None else None  # else none come otherwise
        if self._calling is None or not self._calling.may_begin(waits_for, monotonic()):
            return False
        self._heard_before = newest
        self._calling.begin()
        self.expect()
        return True

    def _hear(self, data: bytes) -> None:
        line = self._calling
        if line is not None and line.begun:
            return
        try:
            question, at = measurement_from(data, self.period)
        except ValueError as error:
            self._host.ignored(topics.MEASUREMENT, str(error))
            self._observed(self._host.last_tick)
            return
        self._answered(question, at, None)
        if line is not None and line.open:
            self._begin()

    def _hear_on_line(self, data: bytes, line: Calling) -> None:
        try:
            question, at = measurement_from(data, self.period)
        except ValueError:  # not in the format of a plant
            line.close()
            return
        if self._heard_before is not None:
            if (question.epoch, question.tick) < self._heard_before:
                return
            self._heard_before = None
        line.hurry(question.controller == self.name and self.sent[0].may_wait_awake())
        self._answered(question, at, line)

    def _answered(
        self, question: Measurement, at: Stamp | None, line: Calling | None
    ) -> EffortCommand | None:
        if self.silent:
            return None
        answer, command = self._host.observe(question), None
        if answer is not None:
            command, (commands, states) = answer.command, self.sent
            if line is not None or commands.heard or states.heard:
                at = at or stamp_of(question.time)
                data = command_bytes(command, at, self._instance)
                if line is not None:
                    line.send(data)
                commands.publish(data)
                if states.heard:
                    states.publish(state_bytes(answer, at))
        self._observed(question.tick)
        return command
