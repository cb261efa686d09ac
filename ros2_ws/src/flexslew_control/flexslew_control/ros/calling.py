"""A controller's end of the line to its plant."""

import os
from math import inf

from rclpy.node import Node

from flexslew_plant.direct.line import SLICE, DirectLine, call, facts
from flexslew_plant.direct.lines import ANSWERS, CALLER, EPOCH, TICK
from flexslew_plant.direct.names import address, direct
from flexslew_plant.graph import topics

_RETRY_PERIOD = 0.2  # until the plant is called again [wall s]
_OVERLAP = 1.0  # for the questions before those of the line [wall s]
_WITHOUT = 1.0  # without a line until the node subscribes to messages again [wall s]


class PlantConnection:
    """Calls the plant of the bench until it answers, and again when it has hung up.

    Args:
        node: node of the controller.
        name: its name on the bench.
        response_topic: absolute name of the topic of its commands.

    Attributes:
        begun: questions come on the line; those received elsewhere are copies.
    """

    def __init__(self, node: Node, name: str, response_topic: str) -> None:
        measurement_topic = node.resolve_topic_name(topics.MEASUREMENT)
        self._address = address(node.context.get_domain_id(), measurement_topic, response_topic)
        self._name, self._direct = name, direct(os.environ)
        self._line: DirectLine | None = None
        self.started = False
        self._before: tuple[int, int] | None = None  # the newest question that is not on the line
        self._connected_at = 0.0  # time of the next call [wall s]
        self._next = 0.0  # when the line was lost [wall s]
        self._since = -inf  # there has been no line [wall s]

    @property
    def open(self) -> bool:
        """The plant has been reached and has not hung up."""
        return self._line is not None and not self._line.closed

    def look(self, now: float, inactive: bool) -> None:
        """Call if there is no line, and it is time.

        Args:
            now: [wall s].
            inactive: an older node of this name answers: hang up and do not call.
        """
        if inactive:
            self.close()
        if self.open:
            return
        if self._line is not None:
            self._line, self._before, self._since, self.started = None, None, now, False
        if inactive or not self._direct or now < self._next:
            return
        self._next = now + _RETRY_PERIOD
        self._line = call(self._address)
        if self._line is not None:
            self._line.notify({CALLER: self._name})

    def at_once(self) -> None:
        """Call with the next look: a plant has come."""
        self._next = 0.0

    def line_lost(self, now: float) -> bool:
        """Return whether there has been no line for a while."""
        return not self.open and now > self._since + _WITHOUT

    def can_begin(self, newest: tuple[int, int] | None, now: float) -> bool:
        """Return whether the next question is one of the line.

        Args:
            newest: epoch and tick of the last question received; None: none was.
            now: [wall s].
        """
        if self._before is None:
            data = self.receive(False)
            if data is None:
                return False
            message = facts(data)
            epoch, tick = message.get(EPOCH), message.get(TICK)
            if not isinstance(epoch, int) or not isinstance(tick, int):
                self.close()
                return False
            self._before, self._connected_at = (epoch, tick), now
        return newest is None or newest >= self._before or now > self._connected_at + _OVERLAP

    def begin(self) -> None:
        """Announce that answers come on the line from now on."""
        assert self._line is not None
        self.started = True
        self._line.notify({ANSWERS: True})

    def receive(self, wait: bool) -> bytes | None:
        """Return the next question; None: there is none yet, or the plant has hung up."""
        return None if self._line is None else self._line.receive(SLICE if wait else 0.0)

    def hurry(self, eager: bool) -> None:
        """Wait awake for the next question, or not; see DirectLine."""
        if self._line is not None:
            self._line.eager = eager

    def send(self, answer: bytes) -> None:
        """Send an answer."""
        if self._line is not None:
            self._line.send(answer)

    def close(self) -> None:
        """Hang up."""
        if self._line is not None:
            self._line.close()
