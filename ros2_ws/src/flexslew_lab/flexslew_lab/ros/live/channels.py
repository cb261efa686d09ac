"""The topics of the bench as channels of a Foxglove server: bytes and schemas, not read."""

from collections import deque
from functools import partial
from typing import Any

from rclpy.node import Node

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.messages.cdr import stamp_of
from flexslew_lab.log.messages.schemas import schema_text
from flexslew_plant.ros.offers import LISTENER_DEPTH, message_class, qos

_TIME_TOPICS = {"/clock", "/measurement", "/truth"}  # the plant's own: each rises until a reset


class LiveChannels:
    """Forwards the serialised messages with their schemas; reads none of them but for the time.

    Args:
        node: of this process.
        foxglove: the library of the server.
        context: of the server; its channels close with it.
    """

    def __init__(self, node: Node, foxglove: Any, context: Any) -> None:
        self.now = 0  # simulated time of the bench [ns]
        self._latched: dict[str, deque[tuple[bytes, int]]] = {}  # with log times
        self._channels: dict[str, Any] = {}
        self._last = 0  # simulated time of the last message [ns]
        self._last_times = dict.fromkeys(_TIME_TOPICS, 0)  # of their last messages [ns]
        for topic, known in TOPICS.items():
            text = schema_text(known.type).encode()
            self._channels[topic] = foxglove.Channel(
                topic,
                schema=foxglove.Schema(name=known.type, encoding="ros2msg", data=text),
                message_encoding="cdr",
                context=context,
            )
            if known.latched:
                self._latched[topic] = deque(maxlen=max(known.depth, LISTENER_DEPTH))
            node.create_subscription(
                message_class(known.type),
                known.name,
                partial(self._forward, topic, known.type),
                qos(known, LISTENER_DEPTH if known.latched else 0),
                raw=True,
            )

    def send_stored(self, topic: str) -> None:
        """Send the latched messages of a topic to a newcomer."""
        for data, time in self._latched.get(topic, ()):
            self._channels[topic].log(data, log_time=time)

    def _forward(self, topic: str, kind: str, data: bytes) -> None:
        self._last = stamp_of(kind, data, self._last)
        self._channels[topic].log(data, log_time=self._last)
        if topic in self._latched:
            self._latched[topic].append((data, self._last))
        elif topic in _TIME_TOPICS:
            if self._last > self.now or self._last < self._last_times[topic]:
                self.now = self._last
            self._last_times[topic] = self._last
