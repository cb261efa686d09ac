"""The status of a recorder: up to which tick the system has the log."""

from collections.abc import Callable

from rclpy.node import Node

from flexslew_lab.log.recording.recording import Recording
from flexslew_plant.bench.wire import RecorderProgress, recorder_status_bytes
from flexslew_plant.graph import topics
from flexslew_plant.ros.offers import publisher

_PERIOD = 0.1  # over DDS, while a plant has a line [wall s]


class RecorderStatus:
    """Reports the safe tick to the plant, which waits rather than lose more than a second.

    A plant with a line receives every status there, and all nodes some of them over DDS: a message
    over DDS costs both ends more than the log of a tick does.

    Args:
        node: the recorder.
        instance: instance of the node, as in its heartbeat.
        recording: what it writes.
        acknowledge: sends a status to a plant with a line; returns whether there is one.
    """

    def __init__(
        self,
        node: Node,
        instance: int,
        recording: Recording,
        acknowledge: Callable[[bytes], bool],
    ) -> None:
        self._name, self._instance, self._recording = node.get_name(), instance, recording
        self._publisher, self._acknowledge = publisher(node, topics.RECORDER_STATUS), acknowledge
        # epoch and safe tick of the last status over DDS, and on the line
        self._published = self._acknowledged = recording.safe
        self._next = 0.0  # over DDS, while there is a line [wall s]

    def publish(self, now: float, time: float) -> None:
        """Publish a status if there is something new.

        Args:
            now: wall clock [s].
            time: latest simulated time of the bench [s].
        """
        epoch, tick = safe = self._recording.safe
        if safe == self._published or (safe == self._acknowledged and now < self._next):
            return
        progress = RecorderProgress(
            self._name, tick, epoch, self._recording.messages, self._instance
        )
        status = recorder_status_bytes(progress, time)
        if safe != self._acknowledged and self._acknowledge(status):
            self._acknowledged = safe
            if now < self._next:
                return
        self._published, self._next = safe, now + _PERIOD
        self._publisher.publish(status)
