"""A bag while a run fills it: what is written, what no kill can take any more, and until when."""

from collections.abc import Callable

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.recording.bag_writer import RecordingStopped
from flexslew_lab.log.recording.recording_order import Ordered, tick_and_epoch
from flexslew_lab.log.recording.unfinished import BEFORE_START, StartedBag

# A kill loses what the OS does not have: at most this, plus messages in transit.
_FLUSH_AFTER, _FLUSH_TICKS = 0.5, 25  # [wall s], ticks
_OTHER_RUN = "holds the log of a run that was another one; choose another folder"


class Recording:
    """Writes ordered messages and hands them to the system often enough.

    A bag left by a killed recorder continues with the next messages of the same run: all messages
    wait until a question confirms that it is the same run.

    Args:
        bag: bag to write.
        failed: called once, with one line, when the disk takes no more; the run goes on.
    """

    def __init__(self, bag: StartedBag, failed: Callable[[str], None]) -> None:
        self._writer, self._failed = bag.writer, failed
        self._before, self._known_messages = bag.last, bag.received
        self._pending: list[Ordered] | None = [] if bag.last > BEFORE_START else None
        self.stopped = False  # the disk takes no more
        self.safe = self._written = BEFORE_START  # (epoch, tick) flushed to the OS; put in a chunk
        self._offset = 0, 0  # epoch that is written, and when it began in log time [ns]
        self._next_flush = 0.0  # [wall s]

    @property
    def messages(self) -> int:
        """How many messages were taken so far."""
        return self._writer.messages

    def write(self, message: Ordered) -> None:
        """Write a message; in log time, an epoch begins where the one before has ended."""
        if self._pending is None:
            self._put(message)
            return
        self._pending.append(message)
        if message.topic == "/measurement":
            tick, epoch = tick_and_epoch(message.data)
            if (epoch, tick) < self._before:
                self._stop(RecordingStopped(f"{self._writer.folder}: {_OTHER_RUN}"))
            self._decide()

    def _decide(self) -> None:
        waiting, self._pending = self._pending or [], None
        for message in waiting:
            self._put(message)

    def _put(self, message: Ordered) -> None:
        if (message.topic, message.data) in self._known_messages:
            return
        if message.epoch > self._offset[0]:
            self._offset = message.epoch, self._writer.last - message.at
        topic, at = message.topic, message.at + self._offset[1]
        if not self.stopped:
            try:
                self._writer.write(topic, TOPICS[topic].type, message.data, at)
            except RecordingStopped as error:
                self._stop(error)
        if topic == "/measurement":
            tick, epoch = tick_and_epoch(message.data)
            self._written = epoch, tick
            if epoch > self.safe[0] or tick >= self.safe[1] + _FLUSH_TICKS:
                self._flush()

    def flush(self, now: float) -> None:
        """Hand over what waits, if it has waited long enough at this wall time [s]."""
        if now >= self._next_flush:
            self._next_flush = now + _FLUSH_AFTER
            self._flush()

    def close(self) -> None:
        """Make the bag whole.

        Raises:
            RecordingStopped: there is no room for it.
        """
        self._decide()
        self._writer.close({"messages": str(self._writer.messages)})

    def _flush(self) -> None:
        if not self.stopped:  # else the plant need not wait for the log
            try:
                self._writer.flush()
            except RecordingStopped as error:
                self._stop(error)
        self.safe = self._written

    def _stop(self, error: RecordingStopped) -> None:
        self.stopped = True
        self._failed(str(error))
