"""Passes on the recorder's messages of every tick, many at a time."""

from array import array

from flexslew_msgs.msg import Recorded
from rclpy.node import Node

from flexslew_plant.graph import topics
from flexslew_plant.ros.offers import publisher

PASSED_ON = (topics.TRUTH, topics.CONTROLLER_STATE)
_BATCH_PERIOD = 0.04  # between two batches of a topic [wall s]
_BATCH_SIZE = (
    32_000  # that go without waiting for it, so that every batch is one piece for DDS [bytes]
)


class Rebroadcast:
    """Passes on messages that are shown rather than acted upon.

    A subscription of its own would wake up a page at every tick, and slow down a bench that goes
    as fast as it can; the recorder has received the messages anyway.

    Args:
        node: the recorder.
    """

    def __init__(self, node: Node) -> None:
        self._publisher = publisher(node, topics.RECORDED)
        self._batches: dict[str, list[bytes]] = {f"/{name}": [] for name in PASSED_ON}
        self._size = 0  # of all batches [bytes]
        self._requested = False
        self._next = 0.0  # [wall s]

    def receive(self, topic: str, data: bytes) -> None:
        """Take a message."""
        if self._requested and topic in self._batches:
            self._batches[topic].append(data)
            self._size += len(data)
            if self._size >= _BATCH_SIZE:
                self._send()

    def poll(self, now: float, last: bool = False) -> None:
        """Send what has waited for long enough, or everything where nothing comes after it."""
        if now < self._next and not last:
            return
        self._next = now + _BATCH_PERIOD
        self._send()
        self._requested = self._publisher.get_subscription_count() > 0

    def _send(self) -> None:
        self._size = 0
        for topic, batch in self._batches.items():
            if batch:
                self._publisher.publish(
                    Recorded(
                        topic=topic,
                        sizes=array("I", map(len, batch)),
                        data=array("B", b"".join(batch)),
                    )
                )
                batch.clear()
