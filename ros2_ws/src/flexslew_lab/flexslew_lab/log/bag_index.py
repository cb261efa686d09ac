"""The place of a time in a bag, by its chunk index: a jump costs no reading from the start."""

import struct
from array import array
from collections import deque
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.bag_reader import BagMessage, BagReader
from flexslew_lab.log.files.mcap_scan import (
    CHANNEL,
    CHUNK,
    CHUNK_INDEX,
    SCHEMA,
    McapRecord,
    RawMessage,
    RecordStream,
    chunk_content,
    chunk_records,
)
from flexslew_lab.log.files.mcap_summary import Summary, find_summary, summary_records
from flexslew_lab.log.files.read_limits import CHANNELS, SizeCheck, check_size, most_chunks
from flexslew_lab.log.messages import cdr
from flexslew_lab.log.messages.topic_lookup import Lookup
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import open_given

# Every controller on the graph repeats its status more often than this
STATUS_EVERY = 20_000_000_000  # simulated [ns]
MAX_GROUPS = 1024  # groups of topics that chunks hold; a bag of the bench has a dozen
_LATEST = (1 << 63) - 1
_HEAD = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQQI")
_CHANNELS = np.dtype([("channel", "<u2"), ("offset", "<u8")])
_ROW = struct.Struct("<qqqq")  # as _ROWS
_ROWS = np.dtype([("start", "i8"), ("end", "i8"), ("at", "i8"), ("length", "i8")])


class _Place(NamedTuple):
    """A chunk in the file."""

    start: int  # first log time [ns]
    end: int  # last log time [ns]
    at: int  # of its record
    length: int  # of its record
    channels: frozenset[int]


class BagIndex:
    """A bag, read from any time on. Its memory is 32 bytes a chunk (64 KiB of messages).

    A bag that was not finished has no index; it is made by one pass.

    Args:
        path: the rosbag2 folder, or the .mcap file.

    Raises:
        BadInput: there is no bag, it is damaged, foreign, or of another version; also while
            reading.
    """

    def __init__(self, path: Path) -> None:
        bag = BagReader(path)
        self.path = bag.path
        self._lookup = Lookup(self.path)
        self._channel_groups: dict[
            frozenset[int], int
        ] = {}  # of channels; most chunks hold the same ones
        summary = find_summary(self.path)
        rows, kinds, whole = bytearray(), array("H"), 0
        for place in self._indexed(summary) if summary else self._scan():
            if place.at < whole:
                words = "damaged: its index names a chunk twice; `log recover` makes it again"
                raise BadInput(words, self.path)
            whole = place.at + place.length
            rows += _ROW.pack(*place[:4])
            kinds.append(self._channel_groups.setdefault(place.channels, len(self._channel_groups)))
            if len(kinds) > most_chunks() or len(self._channel_groups) > MAX_GROUPS:
                raise BadInput(
                    f"an index of more than {len(kinds) - 1} chunks or of {MAX_GROUPS} groups of "
                    "topics, which no bag has",
                    self.path,
                )
        self._rows = np.frombuffer(rows, dtype=_ROWS)
        self._kinds = np.frombuffer(kinds, dtype=np.uint16)
        self.types = dict(map(self._lookup.topic, self._lookup.channels))
        self.first = int(self._rows["start"][0]) if kinds else 0
        self.last = int(self._rows["end"][-1]) if kinds else 0

    def messages(self, topics: Collection[str], start: int = 0) -> Iterator[BagMessage]:
        """Yield the messages of the topics from a log time [ns] on, in their order."""
        size_check = SizeCheck(self.path)
        for place in self._places(topics, self._rows["end"] >= start):
            for message in self._chunk(place, topics, size_check):
                if message.stamp >= start:
                    yield message

    def stored_messages(self, topic: str, before: int) -> list[BagMessage]:
        """Return the latched messages that a listener joining at a log time [ns] receives.

        These are the last messages before it, as many as the topic's publisher keeps; of
        /controller_status, which every controller publishes, the last one of each.
        """
        all_controllers = topic == "/controller_status"
        depth = 1 << 62 if all_controllers else TOPICS[topic].depth
        found: deque[BagMessage] = deque()
        names: set[str] = set()
        size_check = SizeCheck(self.path)
        for place in self._places([topic], self._rows["start"] < before, reverse=True):
            chunk = [m for m in self._chunk(place, [topic], size_check) if m.stamp < before]
            for message in reversed(chunk):
                if all_controllers:
                    if found and message.stamp < found[-1].stamp - STATUS_EVERY:
                        return list(found)
                    name = cdr.decode(message.type, message.data).controller
                    if name in names:
                        continue
                    names.add(name)
                found.appendleft(message)
                if len(found) == depth:
                    return list(found)
        return list(found)

    def _places(
        self, topics: Collection[str], mask: Any, reverse: bool = False
    ) -> Iterator[tuple[int, int]]:
        """Yield position and length of the chunks that hold these topics."""
        channels = {n for n in self._lookup.channels if self._lookup.topic(n)[0] in topics}
        requested = [number for kinds, number in self._channel_groups.items() if kinds & channels]
        rows = self._rows[mask & np.isin(self._kinds, requested)]
        for row in rows[::-1] if reverse else rows:
            yield int(row["at"]), int(row["length"])

    def _chunk(
        self, place: tuple[int, int], topics: Collection[str], size_check: SizeCheck
    ) -> Iterator[BagMessage]:
        at, length = place
        with open_given(self.path) as file:
            record = _record(file, at, self.path)
        if record.opcode != CHUNK or len(record.body) + _HEAD.size != length:
            raise BadInput(f"damaged at byte {at}: its index names another record", self.path)
        data = chunk_content(record.body, f"{self.path}: byte {at}")
        size_check.add(len(data))
        for m in chunk_records(data, str(self.path)):
            if isinstance(m, RawMessage):
                topic, kind = self._lookup.topic(m.channel)
                if topic in topics:
                    yield BagMessage(topic, kind, m.stamp, m.sequence, self._lookup.current(m))

    def _indexed(self, summary: Summary) -> Iterator[_Place]:
        for record in summary_records(summary):
            if record.opcode in (SCHEMA, CHANNEL):
                self._lookup.take(record)
            elif record.opcode == CHUNK_INDEX:
                try:
                    start, end, place, size, index_size = _CHUNK.unpack_from(record.body)
                    count = index_size // _CHANNELS.itemsize
                    channel_entries = np.frombuffer(record.body, _CHANNELS, count, _CHUNK.size)[
                        "channel"
                    ]
                except (struct.error, ValueError):
                    raise BadInput(
                        f"damaged at byte {record.offset}: its index is cut", self.path
                    ) from None
                if max(start, end, place, size) > _LATEST:
                    raise BadInput("damaged: its index names an impossible place", self.path)
                channels = frozenset(channel_entries[: CHANNELS + 1].tolist())
                yield _Place(start, end, place, size, channels)

    def _scan(self) -> Iterator[_Place]:
        size_check = SizeCheck(self.path)
        for record in RecordStream(self.path):
            if record.opcode in (SCHEMA, CHANNEL):
                self._lookup.take(record)
            elif record.opcode == CHUNK:
                channels = set()
                data = chunk_content(record.body, f"{self.path}: byte {record.offset}")
                size_check.add(len(data))
                for m in chunk_records(data, str(self.path)):
                    if isinstance(m, RawMessage):
                        channels.add(m.channel)
                    else:
                        self._lookup.take(m)
                start, end = struct.unpack_from("<QQ", record.body)
                length = _HEAD.size + len(record.body)
                yield _Place(start, end, record.offset, length, frozenset(channels))


def _record(file: BinaryIO, at: int, path: Path) -> McapRecord:
    file.seek(at)
    head = file.read(_HEAD.size)
    opcode, length = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, 0)
    check_size("a record", length, f"{path}: byte {at}")
    return McapRecord(opcode, file.read(min(length, path.stat().st_size)), at)
