"""The order in which a recorder writes its messages: by epoch, then by simulated time."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable
from operator import itemgetter
from struct import error
from typing import NamedTuple

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.messages import cdr
from flexslew_lab.log.messages.readable import can_read
from flexslew_lab.log.recording.consecutive import TickSequence
from flexslew_lab.log.recording.open_ticks import PATIENCE, TRACKED_TOPICS, OpenTicks
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics
from flexslew_plant.graph.topics import DISPLAYED
from flexslew_plant.message_codec import layout_of, leading

_OF_PLANT = ("/measurement", "/truth")  # their epoch counts
# Patience for the other of the two, once received, and for a tick between two [wall s]: on a
# starved machine it comes late. A plant may publish no truth at all; for that PATIENCE is
# enough.
_SILENCE_TIMEOUT = 15.0
_STATUS = "/controller_status"
_FRAMES = frozenset({topics.TF, topics.TF_STATIC})  # of all benches of a domain
_DISPLAY_TOPICS = tuple("/" + name.lstrip("/") for name in DISPLAYED)  # they have none
_RANK = {topic: rank for rank, topic in enumerate(TOPICS)}
_BEFORE_START = 0, -1  # epoch and time before all others
_time, _by_time = itemgetter(0, 1), itemgetter(0, 1, 2)


class Ordered(NamedTuple):
    """A message at its place in the log."""

    epoch: int
    at: int  # simulated time in its epoch [ns]
    rank: int  # of its topic among those of one time
    topic: str
    data: bytes  # CDR


class _PendingMessages(NamedTuple):
    """Displayed messages from a tick 0 without a question yet, and after it."""

    since: float  # [wall s]
    messages: list[tuple[str, int, bytes]]


class RecordingOrder:
    """Sorts messages as they come; hands out what is surely complete.

    The topics of one tick do not arrive at one moment, so what is newer than the newest message of
    the round before waits for the next one. A tick waits for the ticks before it, which may come
    another way, and until its answer is there, or known to be missed, or has been waited for long
    enough: see Consecutive and OpenTicks.

    Args:
        namespace: of the bench, absolute: frames of others are left out.

    Attributes:
        newest: epoch, and simulated time in it [ns].
        tick: of that time.
        garbled: topics of messages that were left out, since they are none of their type, or no
            reader would take the log.
    """

    def __init__(self, namespace: str = "/") -> None:
        self._namespace = namespace
        self.newest, self.tick = (0, 0), 0
        self.invalid_topics: set[str] = set()
        self._display_times = dict.fromkeys(_DISPLAY_TOPICS, (0, 0))  # epoch and time by topic
        self._pending: dict[str, _PendingMessages] = {}  # by topic
        self._waiting: list[Ordered] = []
        self._open = OpenTicks()
        self._plant = {topic: TickSequence() for topic in _OF_PLANT}
        self._complete_until = _BEFORE_START  # epoch and time up to which they have come
        self._progress_time = 0.0  # when it moved or was the newest [wall s]
        self._wait_start = 0.0  # for the other of the two, which never came [wall s]

    def take(
        self, messages: Iterable[tuple[str, bytes]], now: float, last: bool = False
    ) -> list[Ordered]:
        """Return what can be written now.

        Args:
            messages: topic and CDR, as they came since the last round.
            now: wall clock [s].
            last: nothing will come any more.
        """
        horizon = self._horizon(now)
        new_messages, plant = [], self._plant
        for topic, data in messages:
            at = cdr.stamp_of(TOPICS[topic].type, data, self.newest[1])
            if at < 0:  # no log has such a time
                self.invalid_topics.add(topic)
                continue
            if topic in plant:
                try:
                    tick, epoch = tick_and_epoch(data, topic)
                except error:
                    self.invalid_topics.add(topic)
                    continue
                plant[topic].receive(epoch, tick, at)
                if (epoch, at) >= self.newest:
                    self.newest, self.tick = (epoch, at), tick
            new_messages.append((topic, at, data))
        new_messages = [*self._release_pending(now, last), *new_messages]
        wait, multiple_epochs = self._waiting.append, self.newest[0] > 0
        for topic, at, data in new_messages:
            if topic in self._display_times and not last and self._is_pending(topic, at, data, now):
                continue
            try:
                has_epoch = multiple_epochs or topic in self._display_times or topic == _STATUS
                epoch = self._epoch(topic, at, data) if has_epoch else 0
                if topic in _FRAMES and not of_namespace(data, self._namespace):
                    continue
                if not can_read(topic, data):
                    self.invalid_topics.add(topic)
                    continue
                if topic in TRACKED_TOPICS:
                    self._open.receive(epoch, at, topic, data, now)
            except (error, BadInput):
                self.invalid_topics.add(topic)
                continue
            wait(Ordered(epoch, at, _RANK[topic], topic, data))
        self._waiting.sort(key=_by_time)
        ready = len(self._waiting) if last else bisect_right(self._waiting, horizon, key=_time)
        open_tick = None if last else self._open.first(now)
        if open_tick is not None:
            ready = min(ready, bisect_left(self._waiting, open_tick, key=_time))
        done, self._waiting = self._waiting[:ready], self._waiting[ready:]
        return done

    def _horizon(self, now: float) -> tuple[int, int]:
        """Return up to which time all messages of the plant have come, or are given up."""
        received = [topic for topic in self._plant.values() if topic.received]
        if len(received) != 1:
            self._wait_start = now
        elif now - self._wait_start <= PATIENCE:
            return _BEFORE_START
        if now - self._progress_time > _SILENCE_TIMEOUT and any(
            [topic.skip() for topic in received]
        ):
            self._progress_time = now
        complete_until = min((topic.whole for topic in received), default=self.newest)
        if complete_until == self.newest or complete_until != self._complete_until:
            self._complete_until, self._progress_time = complete_until, now
        return complete_until if now - self._progress_time <= _SILENCE_TIMEOUT else self.newest

    def _is_pending(self, topic: str, at: int, data: bytes, now: float) -> bool:
        """Keep displayed messages of a new epoch until its first question; return whether kept.

        A topic with a time back at tick 0, which is always shown, may come before the question:
        from a plant over DDS, or from a log that is played.
        """
        epoch, before = self._display_times[topic]
        if topic not in self._pending:
            if at != 0 or before <= 0 or epoch < self.newest[0]:
                return False
            self._pending[topic] = _PendingMessages(now, [])
        self._pending[topic].messages.append((topic, at, data))
        return True

    def _release_pending(self, now: float, last: bool) -> list[tuple[str, int, bytes]]:
        """Return what was kept and has its epoch now, or was kept for long enough."""
        done = [
            topic
            for topic, pending in self._pending.items()
            if last
            or self.newest[0] > self._display_times[topic][0]
            or now - pending.since > PATIENCE
        ]
        self._display_times.update(dict.fromkeys(done, (self.newest[0], -1)))
        return [message for topic in done for message in self._pending.pop(topic).messages]

    def _epoch(self, topic: str, at: int, data: bytes) -> int:
        """Return the epoch to which a message belongs; the plant's newest one is known."""
        newest = self.newest[0]
        if topic in self._display_times:
            epoch, before = self._display_times[topic]
            epoch = newest if at < before or at == 0 else epoch
            self._display_times[topic] = epoch, at
            return epoch
        if topic in _OF_PLANT or topic in TRACKED_TOPICS:
            return min(newest, tick_and_epoch(data, topic)[1])
        if topic == _STATUS:  # may come before the question with which its epoch begins
            return min(newest + 1, int(cdr.decode(TOPICS[topic].type, data).epoch))
        return newest


def tick_and_epoch(data: bytes, topic: str = "/measurement") -> tuple[int, int]:
    """Return tick and epoch of a message of a topic that has them near its start.

    Raises:
        struct.error: if the data are too short.
    """
    tick, epoch = leading(TOPICS[topic].type, "tick", "epoch").unpack_from(data)
    return int(tick), int(epoch)


def of_namespace(data: bytes, namespace: str) -> bool:
    """Return whether transforms are of the bench of a namespace, by the names of their frames.

    Args:
        data: CDR of a tf2_msgs/TFMessage.
        namespace: absolute; "/" is that of frames without a slash.

    Raises:
        BadInput: if the data are no transforms.
    """
    frames = layout_of("tf2_msgs/msg/TFMessage", data).texts[1::2]  # each with its parent
    return all("/" + frame.rpartition("/")[0] == namespace for frame in frames)
