"""What a recorder hears: on its socket, and over DDS."""

import os
from collections.abc import Iterator

from rclpy.node import Node

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.ros.hidden_listener import HiddenListener
from flexslew_plant.direct.inbox import Inbox
from flexslew_plant.direct.names import RECORDER, address, direct
from flexslew_plant.ros.loop import Loop

QUESTIONS = "/measurement"
_TAKE_EVERY = 0.005  # from DDS, while nothing comes: to look costs as much then [wall s]


class Intake:
    """Listens for a recorder.

    Args:
        node: the recorder.
        loop: that serves it.

    Attributes:
        subscriptions: over DDS, by absolute names of topics.
    """

    def __init__(self, node: Node, loop: Loop) -> None:
        self._listener = HiddenListener(node, TOPICS)
        loop.own(self._listener.node)
        self.subscriptions = self._listener.subscriptions
        self._next_take = 0.0  # [wall s]
        self._inbox: Inbox | None = None
        if direct(os.environ):
            questions = self.subscriptions[QUESTIONS].topic_name
            heard = {known.topic_name: name for name, known in self.subscriptions.items()}
            beside = self._listener.node.get_name(), self._listener.node.get_namespace()
            where = address(node.context.get_domain_id(), questions, RECORDER)
            self._inbox = Inbox(where, heard, beside)

    def arrived(self, now: float, last: bool) -> Iterator[tuple[str, bytes]]:
        """Yield topic and CDR of what has come.

        Args:
            now: [wall s].
            last: nothing will come any more.
        """
        over_dds = list(self._listener.take()) if last or now >= self._next_take else []
        if over_dds:
            self._next_take = now
        elif now >= self._next_take:
            self._next_take = now + _TAKE_EVERY
        yield from self._inbox.take(over_dds) if self._inbox else over_dds
