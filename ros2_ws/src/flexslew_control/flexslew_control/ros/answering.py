"""A host between the questions that its node hears and the answers that it publishes."""

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.subscription import Subscription

from flexslew_control.controllers.host import ControllerHost
from flexslew_control.message_fields import state_bytes
from flexslew_plant import topics
from flexslew_plant.bench.wire import Stamp, command_bytes, measurement_from, stamp_of
from flexslew_plant.measurement import EffortCommand, Measurement
from flexslew_plant.ros.offers import publish_if_heard, publisher, subscription


class Answering:
    """Answers `measurement` on `effort_command`, and says on `controller_state` what led to it.

    Args:
        node: of the controller.
        host: that is asked.
        observed: called with the tick of each question, after its answer.
        by_call: the plant shares this process and calls `answer` instead.

    Attributes:
        period: of the bench [s].
        silent: observe only.
        heard: the questions; None: they come by calls.
        sent: the commands, then the states.
    """

    def __init__(
        self,
        node: Node,
        host: ControllerHost,
        observed: Callable[[int], None],
        by_call: bool = False,
    ) -> None:
        self._host, self._observed = host, observed
        self.period, self.silent = 0.01, False
        self.sent = [publisher(node, t) for t in (topics.EFFORT_COMMAND, topics.CONTROLLER_STATE)]
        self.heard: Subscription[Any] | None = None
        if not by_call:
            self.heard = subscription(node, topics.MEASUREMENT, self._hear, raw=True)

    @property
    def name(self) -> str:
        """What the bench knows the controller by."""
        return self._host.name

    def answer(self, question: Measurement) -> EffortCommand | None:
        """Observe a question; return the answer, published already, if it names this controller."""
        return self._answered(question, stamp_of(question.time))

    def serve(self) -> bool:
        """Answer a question that waits; return whether there was one."""
        if self.heard is None:
            return False
        with self.heard.handle:
            taken = self.heard.handle.take_message(self.heard.msg_type, True)
        if taken is not None:
            self._hear(taken[0])
        return taken is not None

    def _hear(self, data: bytes) -> None:
        self._answered(*measurement_from(data, self.period))

    def _answered(self, question: Measurement, at: Stamp) -> EffortCommand | None:
        answer, command = self._host.observe(question), None
        if answer is not None and not self.silent:
            command = answer.command
            publish_if_heard(self.sent[0], partial(command_bytes, command, at))
            publish_if_heard(self.sent[1], partial(state_bytes, answer, at))
        self._observed(question.tick)
        return command
