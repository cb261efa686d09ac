"""The messages that a recorder receives on its socket and over DDS."""

import os
from collections.abc import Iterator

from rclpy.node import Node

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.ros.hidden_listener import HiddenListener
from flexslew_lab.ros.plant_only import SIGN_OF_LIFE, PlantOnly
from flexslew_plant.direct.inbox import Inbox
from flexslew_plant.direct.names import RECORDER, address, direct
from flexslew_plant.graph import topics
from flexslew_plant.ros.graph import is_published
from flexslew_plant.ros.loop import Loop

QUESTIONS = "/measurement"
# topics of nodes that leave after the plant
_AFTER_PLANT = ("/effort_command", "/controller_state", "/plan", "/planned_trajectory")
_SILENCE = 10.0  # after which nothing is expected any more [wall s]; DDS repairs every 3 s
_LONGEST = 30.0  # limit for nodes that are never silent, after the plant has left [wall s]
_TAKE_EVERY = 0.005  # from DDS, while nothing comes: to look costs as much then [wall s]


class Intake:
    """Listens for a recorder.

    Args:
        node: the recorder.
        loop: that serves it.

    Attributes:
        subscriptions: over DDS, by absolute names of topics.
        plant_only: filter of publishers on the topics of the plant.
    """

    def __init__(self, node: Node, loop: Loop) -> None:
        self._listener = HiddenListener(node, TOPICS)
        loop.own(self._listener.node)
        self.subscriptions = dict(self._listener.subscriptions)
        self._listener.listen(SIGN_OF_LIFE, topics.TOPICS[topics.ALIVE])
        self.plant_only = PlantOnly()
        self._next_take = self._heard = 0.0  # when something came [wall s]
        self._plant_here = 0.0  # when it was seen last [wall s]
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
        looks = last or now >= self._next_take
        over_dds = list(self.plant_only.admit(self._listener.take(), now)) if looks else []
        if over_dds:
            self._next_take = now
        elif now >= self._next_take:
            self._next_take = now + _TAKE_EVERY
        for message in self._inbox.take(over_dds) if self._inbox else over_dds:
            self._heard = now
            if message[0] == QUESTIONS:
                self._plant_here = now
            yield message

    def expects_more(self, now: float, plant_here: bool) -> bool:
        """Return whether nodes that leave after the plant may still send messages."""
        node = self._listener.node
        if plant_here:
            self._plant_here = now
        until = min(self._heard + _SILENCE, self._plant_here + _LONGEST)
        there = (is_published(node, self.subscriptions[topic]) for topic in _AFTER_PLANT)
        return now < until and any(there)
