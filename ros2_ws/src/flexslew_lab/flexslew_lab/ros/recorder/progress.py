"""How far the log is, for the plant, which waits rather than lose more than a second of it."""

from rclpy.node import Node

from flexslew_lab.log.recording.recording import Recording
from flexslew_lab.ros.recorder.intake import MessageSource
from flexslew_plant.bench.wire import RecorderProgress, progress_bytes
from flexslew_plant.graph import topics
from flexslew_plant.ros.offers import publisher

_DDS_PERIOD = 0.1  # of statuses over DDS while the plant is on a line [wall s]


class ProgressReport:
    """Sends the safe tick on the plant's line, and as `recorder_status` over DDS.

    A status over DDS costs the plant a hundred times as much as one on its line. While there is a
    line, DDS carries ten a second.

    Args:
        node: the recorder.
        source: the lines of the recorder.
        recording: the log.
        instance: of the recorder, as in its heartbeat.
    """

    def __init__(
        self, node: Node, source: MessageSource, recording: Recording, instance: int
    ) -> None:
        self._name, self._instance = node.get_name(), instance
        self._source, self._recording = source, recording
        self._publisher = publisher(node, topics.RECORDER_STATUS)
        self._last = recording.safe
        self._data, self._next = b"", 0.0  # still to go over DDS, and when [wall s]

    def update(self, time: float, now: float) -> None:
        """Send the safe tick if it has changed.

        Args:
            time: of the newest message [s].
            now: [wall s].
        """
        if self._recording.safe == self._last:
            return
        self._last = epoch, tick = self._recording.safe
        progress = RecorderProgress(
            self._name, tick, epoch, self._recording.messages, self._instance
        )
        self._data = progress_bytes(progress, time)
        if not self._source.acknowledge(self._data):
            self.publish(now, last=True)

    def publish(self, now: float, last: bool) -> None:
        """Publish over DDS what is due.

        Args:
            now: [wall s].
            last: whether all is due, as nothing follows.
        """
        if self._data and (last or now >= self._next):
            self._publisher.publish(self._data)
            self._data, self._next = b"", now + _DDS_PERIOD
