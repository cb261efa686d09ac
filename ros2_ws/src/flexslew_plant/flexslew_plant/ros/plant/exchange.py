"""Question and answer between the plant and the controllers."""

import os
from collections import deque
from collections.abc import Callable, Collection, Iterator
from math import inf
from time import monotonic
from typing import Any, Protocol

from rclpy.node import Node
from rclpy.subscription import Subscription

from flexslew_plant.bench.operation.session import Session
from flexslew_plant.bench.wire import command_from, measurement_bytes
from flexslew_plant.direct.line import SLICE
from flexslew_plant.direct.lines import Lines
from flexslew_plant.direct.names import DDS, SOCKET, address, direct
from flexslew_plant.errors import BadInput
from flexslew_plant.events import TransportChosen, UnexpectedMessage
from flexslew_plant.graph import topics
from flexslew_plant.measurement import EffortCommand, Measurement
from flexslew_plant.ros.graph import missing_listeners
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.offers import subscription
from flexslew_plant.ros.outlets import DirectPublishers

_AT_ONCE = 0.005  # ticks flown by calls before the graph is served again [wall s]
_CALL_CHECK_PERIOD = 0.02  # between two checks for calls [wall s]
_REPORT_DELAY = 1.0  # for a controller to call, before DDS is reported as its transport [wall s]
_GRAPH_CHECK_PERIOD = 0.1  # between two checks for controllers that answer over DDS [wall s]


class LocalController(Protocol):
    """A controller in the plant's process, which answers by a function call."""

    @property
    def name(self) -> str:
        """Name of the controller on the bench."""

    def answer(self, question: Measurement) -> EffortCommand | None:
        """Observe a question; return the answer, published already, if it names this controller."""


class ControllerLink:
    """Queries a neighbour by calls, controllers of this machine by lines, and others by messages.

    The plant subscribes to `effort_command` only while a controller that is neither the neighbour
    nor on a line may answer there. All listeners on the graph receive copies.

    Args:
        node: the plant.
        direct_publishers: outlets of the node.
        loop: loop that serves the node.
        session: session that poses the questions.
        take: passes an answer on; returns whether the loop should poll at once.
        local_controller: a controller in this process. The plant listens to no other until there is
            another controller; from then on all answers come as messages, in one order.
    """

    def __init__(
        self,
        node: Node,
        direct_publishers: DirectPublishers,
        loop: Loop,
        session: Session,
        take: Callable[[EffortCommand], bool],
        local_controller: LocalController | None = None,
    ) -> None:
        self._node, self._loop, self._take, self._local_controller = (
            node,
            loop,
            take,
            local_controller,
        )
        self._session = session
        self._pending: deque[Measurement] = deque()  # what the neighbour has still to observe
        self._commands: Subscription[Any] | None = None
        self._last_report: dict[str, str] = {}  # the transport of each controller, as reported
        self._since: dict[str, float] = {}  # when each was on a line, or seen at first [wall s]
        self._next_call_check = self._next_graph = 0.0  # [wall s]
        self._requested_controller, self._warned = "", False  # a stray message was reported
        self._publishers, self.measurements = (
            direct_publishers,
            direct_publishers.publisher(topics.MEASUREMENT),
        )
        self._topic = node.resolve_topic_name(topics.EFFORT_COMMAND)
        self._lines: Lines | None = None
        if local_controller is None:
            self._listen()
            if direct(os.environ):
                domain = node.context.get_domain_id()
                measurement_topic = self.measurements.publisher.topic_name
                where = address(domain, measurement_topic, self._topic)
                self._lines = Lines(where, self._newest)

    def ask(self, question: Measurement) -> None:
        """Send a question out."""
        self._requested_controller = question.controller
        if self._lines:
            data = measurement_bytes(question)
            self._lines.send(question.controller, data, eager=self.measurements.can_busy_wait())
            if self.measurements.received:
                self.measurements.publish(data)
            return
        if self.measurements.received:
            self.measurements.publish(measurement_bytes(question))
        if self._local_controller is not None:
            self._pending.append(question)
            self._loop.hurry()

    def call(self, wait: float) -> float:
        """Fly without messages for a moment; return the longest time until the next poll [wall s].

        Args:
            wait: time for which nothing is due [wall s].
        """
        until = monotonic() + _AT_ONCE
        while self._local_controller is not None and self._pending:
            command = self._local_controller.answer(self._pending.popleft())
            if command is None or self._commands is not None:
                continue
            if self._take(command) or monotonic() >= until:
                return 0.0
        lines = self._lines
        if lines is None:
            return inf
        while self._answer_pending and self._requested_controller in lines.answering:
            answer = lines.answer(self._requested_controller, min(wait, SLICE))
            if answer is None or self._take(answer) or monotonic() >= until:
                return 0.0
            if self._session.tick_timer.paced:
                return 0.0  # something else may be due before the next answer
            wait = SLICE
        return SLICE if lines.handshake_pending else _CALL_CHECK_PERIOD

    def look(self, now: float) -> None:
        """Take calls; listen to `effort_command` while a controller may answer there."""
        if self._lines is None:
            return
        if (
            now >= self._next_call_check
            or self._lines.handshake_pending
            or not self._session.run.running
        ):
            self._next_call_check = now + _CALL_CHECK_PERIOD
            self._lines.look()
            before = len(self._direct)
            for command in self._lines.received():  # also those that announce an answer
                self._take(command)
            if len(self._direct) > before:  # the subscription may be obsolete
                self._next_graph = now
            self._report_links(now)
        if now >= self._next_graph:
            self._next_graph = now + _GRAPH_CHECK_PERIOD
            self._choose()

    def received(self) -> Iterator[EffortCommand]:
        """Take the answers that wait."""
        if self._lines is not None:
            yield from self._lines.received()
        if self._commands is None:
            return
        with self._commands.handle:
            take, kind = self._commands.handle.take_message, self._commands.msg_type
            while (taken := take(kind, True)) is not None:
                yield from self._decode(taken[0])

    def add_controller(self, controller: str) -> None:
        """Listen to the answers of this controller, too."""
        if self._commands is None and controller not in (self._name, *self._direct):
            self._listen()

    def without_link(self, controllers: Collection[str]) -> list[str]:
        """Return which of these controllers a question would not reach now."""
        self._publishers.turn()  # the listeners are counted when the question goes out
        others = {*controllers} - {self._name} - self._direct
        return missing_listeners(self._node, [self.measurements.publisher], sorted(others))

    @property
    def _name(self) -> str:
        return "" if self._local_controller is None else self._local_controller.name

    @property
    def _direct(self) -> set[str]:
        """The controllers that answer on a line."""
        return set() if self._lines is None else self._lines.answering

    @property
    def _answer_pending(self) -> bool:
        """Whether an answer is missing."""
        return self._session.run.running and not self._session.bench.answered

    def _newest(self) -> tuple[int, int]:
        question = self._session.bench.question
        return question.epoch, question.tick

    def _choose(self) -> None:
        infos = self._node.get_publishers_info_by_topic(self._topic)
        here = self._node.get_namespace()
        others = [i for i in infos if i.node_name not in self._direct or i.node_namespace != here]
        if self._commands is None and others:
            self._listen()
        elif self._commands is not None and self._direct and not others:
            self._node.destroy_subscription(self._commands)
            self._commands = None

    def _report_links(self, now: float) -> None:
        """Report once the transport of each controller, which needs a moment to choose it."""
        session = self._session
        for name in session.reasons:
            reason = session.reason(name, now)  # a silent controller has no transport
            link = SOCKET if name in self._direct else DDS
            if link == SOCKET:
                self._since[name] = now
            is_final = link == SOCKET or now > self._since.setdefault(name, now) + _REPORT_DELAY
            if (
                reason is None
                and is_final
                and self._last_report.get(name) != link
                and session.run.running
            ):
                self._last_report[name] = link
                session.bench.tell(TransportChosen(name, link))

    def _listen(self) -> None:
        topic, callback = topics.EFFORT_COMMAND, self._on_command
        self._commands = subscription(self._node, topic, callback, raw=True)

    def _on_command(self, data: bytes) -> None:
        for command in self._decode(data):
            self._take(command)

    def _decode(self, data: bytes) -> Iterator[EffortCommand]:
        """Yield an answer that came over DDS, unless it is the copy of one that came on a line."""
        if self._lines is not None and self._lines.copied(data):
            return
        try:
            yield command_from(data)
        except BadInput as error:
            if not self._warned:
                self._warned = True
                what = UnexpectedMessage(topics.EFFORT_COMMAND, self._node.get_name(), str(error))
                self._session.bench.tell(what)
