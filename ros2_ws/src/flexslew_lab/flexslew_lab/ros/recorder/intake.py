"""The messages that a recorder receives on its socket and over DDS."""

import os
from collections.abc import Iterator

from rclpy.node import Node

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.ros.hidden_listener import HiddenListener
from flexslew_lab.ros.recorder.plant_only import HEARTBEAT_TOPIC, PlantOnly
from flexslew_plant.direct.inbox import RecorderInput
from flexslew_plant.direct.names import RECORDER, address, direct
from flexslew_plant.graph import topics
from flexslew_plant.ros.graph import has_publisher
from flexslew_plant.ros.loop import Loop

MEASUREMENT_TOPIC = "/measurement"
# topics of nodes that leave after the plant
_AFTER_PLANT = ("/effort_command", "/controller_state", "/plan", "/planned_trajectory")
_SILENCE = 10.0  # after which nothing is expected any more [wall s]; DDS repairs every 3 s
_MAX_WAIT = 30.0  # limit for nodes that are never silent, after the plant has left [wall s]
_TAKE_EVERY = 0.005  # from DDS, while nothing comes: to look costs as much then [wall s]


class MessageSource:
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
        self._listener.listen(HEARTBEAT_TOPIC, topics.TOPICS[topics.ALIVE])
        self.plant_only = PlantOnly()
        self._next_take = self._last_received = 0.0  # when something came [wall s]
        self._plant_here = 0.0  # when it was seen last [wall s]
        self._inbox: RecorderInput | None = None
        if direct(os.environ):
            measurement_topic = self.subscriptions[MEASUREMENT_TOPIC].topic_name
            names = {known.topic_name: name for name, known in self.subscriptions.items()}
            listener_id = self._listener.node.get_name(), self._listener.node.get_namespace()
            where = address(node.context.get_domain_id(), measurement_topic, RECORDER)
            self._inbox = RecorderInput(where, names, listener_id)

    def received(self, now: float, last: bool) -> Iterator[tuple[str, bytes]]:
        """Yield topic and CDR of what has come.

        Args:
            now: [wall s].
            last: nothing will come any more.
        """
        take_now = last or now >= self._next_take
        over_dds = (
            list(self.plant_only.filter_messages(self._listener.take(), now)) if take_now else []
        )
        if over_dds:
            self._next_take = now
        elif now >= self._next_take:
            self._next_take = now + _TAKE_EVERY
        for message in self._inbox.take(over_dds) if self._inbox else over_dds:
            self._last_received = now
            if message[0] == MEASUREMENT_TOPIC:
                self._plant_here = now
            yield message

    def has_pending(self, now: float, plant_here: bool) -> bool:
        """Return whether the plant, or nodes that leave after it, may still send messages."""
        node = self._listener.node
        if plant_here:
            self._plant_here = now
            return True
        until = min(self._last_received + _SILENCE, self._plant_here + _MAX_WAIT)
        active = (has_publisher(node, self.subscriptions[topic]) for topic in _AFTER_PLANT)
        return now < until and any(active)
