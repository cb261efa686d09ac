"""Question and answer between the plant and the controllers."""

from collections import deque
from collections.abc import Callable, Collection, Iterator
from functools import partial
from math import inf
from time import monotonic
from typing import Any, Protocol

from rclpy.node import Node
from rclpy.subscription import Subscription

from flexslew_plant import topics
from flexslew_plant.bench.wire import command_from, measurement_bytes
from flexslew_plant.measurement import EffortCommand, Measurement
from flexslew_plant.ros.graph import unmatched
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.offers import publish_if_heard, publisher, subscription

_AT_ONCE = 0.001  # ticks flown by calls before the graph is served again [wall s]


class Neighbour(Protocol):
    """A controller in the plant's process, which is asked by a call."""

    @property
    def name(self) -> str:
        """What the bench knows it by."""

    def answer(self, question: Measurement) -> EffortCommand | None:
        """Observe a question; return the answer, published already, if it names this controller."""


class Exchange:
    """Asks by messages, and a neighbour by calls; then everybody else hears copies.

    Args:
        node: the plant.
        loop: that serves it.
        take: passes an answer on; returns whether the loop should poll at once.
        neighbour: a controller in this process. Nobody else is listened to until there is
            another controller; from then on all answers come as messages, in one order.
    """

    def __init__(
        self,
        node: Node,
        loop: Loop,
        take: Callable[[EffortCommand], bool],
        neighbour: Neighbour | None = None,
    ) -> None:
        self._node, self._loop, self._take, self._neighbour = node, loop, take, neighbour
        self._unseen: deque[Measurement] = deque()  # what the neighbour has still to observe
        self._commands: Subscription[Any] | None = None
        self.questions = publisher(node, topics.MEASUREMENT)
        if neighbour is None:
            self._listen()

    def ask(self, question: Measurement) -> None:
        """Send a question out."""
        publish_if_heard(self.questions, partial(measurement_bytes, question))
        if self._neighbour is not None:
            self._unseen.append(question)
            self._loop.hurry()

    def call(self) -> float:
        """Fly by calls for a moment; return when to poll again at the latest [wall s]."""
        until = monotonic() + _AT_ONCE
        while self._neighbour is not None and self._unseen:
            command = self._neighbour.answer(self._unseen.popleft())
            if command is None or self._commands is not None:
                continue
            if self._take(command) or monotonic() >= until:
                return 0.0
        return inf

    def arrived(self) -> Iterator[EffortCommand]:
        """Take the answers that wait in DDS."""
        if self._commands is None:
            return
        with self._commands.handle:
            take, kind = self._commands.handle.take_message, self._commands.msg_type
            while (taken := take(kind, True)) is not None:
                yield command_from(taken[0])

    def known(self, controller: str) -> None:
        """Listen to the answers of this controller, too."""
        if self._commands is None and controller != self._name:
            self._listen()

    def unheard(self, controllers: Collection[str]) -> list[str]:
        """Return which of these controllers a question would not reach now."""
        return unmatched(self._node, [self.questions], sorted({*controllers} - {self._name}))

    @property
    def _name(self) -> str:
        return "" if self._neighbour is None else self._neighbour.name

    def _listen(self) -> None:
        topic, hear = topics.EFFORT_COMMAND, self._hear
        self._commands = subscription(self._node, topic, hear, raw=True)

    def _hear(self, data: bytes) -> None:
        self._take(command_from(data))
