"""The log read back: streaming, checked, and as arrays where the messages allow it."""

import os
from collections.abc import Collection, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.records import Header, Metadata

from flexslew_lab.log.bag_columns import ColumnBlock, blocks_of, pad_columns
from flexslew_lab.log.bag_layout import (
    FORMAT,
    METADATA_FILE,
    ROSBAG_RECORD,
    RUN_RECORD,
    TRIAL_RECORD,
    checksum,
)
from flexslew_lab.log.files.mcap_scan import (
    CHANNEL,
    CHUNK,
    HEADER,
    METADATA,
    SCHEMA,
    Cut,
    McapRecord,
    RawMessage,
    RecordStream,
    chunk_content,
    chunk_records,
    has_checksum,
    read_record,
)
from flexslew_lab.log.files.read_limits import TEXT, SizeCheck, check_size
from flexslew_lab.log.messages import cdr
from flexslew_lab.log.messages.logged_event import logged_event
from flexslew_lab.log.messages.record_schema import (
    Sizes,
    check_one_run,
    check_record,
    check_run_record,
    check_truth,
    new_yaml,
)
from flexslew_lab.log.messages.topic_lookup import Lookup
from flexslew_lab.log.trial_from_messages import trial_from_messages
from flexslew_plant.errors import BadInput
from flexslew_plant.events import Event
from flexslew_plant.own_code import NO_CODE, Trust

STATUS_TOPICS = ("/events", "/plan", "/testbed", "/controller_status")
# What a decoded event takes in memory [B], at most, and each byte of its JSON
_EVENT_SIZE, _TEXT_SIZE = 300, 12
BATCH = 1 << 14  # messages of a chunk that become arrays at once


class BagMessage(NamedTuple):
    """One message as stored in the bag."""

    topic: str
    type: str
    stamp: int  # log time [ns]
    sequence: int  # counted from 1 on its topic by the recorder
    data: bytes  # CDR


class Overview(NamedTuple):
    """All that is rare in a bag, from one pass over it."""

    counts: dict[str, int]  # messages by topic
    types: dict[str, str]  # by topic
    first: int  # log time [ns]
    last: int  # log time [ns]
    events: tuple[Event, ...]
    plans: tuple[Any, ...]  # decoded flexslew_msgs/msg/Plan, oldest first
    testbed: Any  # decoded flexslew_msgs/msg/Testbed, the last one; None without
    statuses: dict[str, Any]  # the last ControllerStatus of every controller
    metadata: dict[str, dict[str, str]]  # the records by name
    cut: Cut | None
    without_checksum: tuple[str, ...]  # parts without a checksum over their numbers, as text


class BagReader:
    """A bag, read from its start by every call. Memory does not grow with its length.

    Args:
        path: rosbag2 folder or .mcap file.
        external: also read bags that this project has not written.
        trust: classes named by the log that its readers may load, and files that they may read;
            none by default.

    Raises:
        BadInput: if there is no bag, or it is damaged, foreign, or of another version; also while
            reading.

    """

    def __init__(self, path: Path, external: bool = False, trust: Trust = NO_CODE) -> None:
        self.path = find_mcap(Path(path))
        self.trust = trust.for_log()
        self._external = external
        self.cut: Cut | None = None  # known after a whole pass
        self.metadata = self._leading_metadata()

    @property
    def trial_text(self) -> str:
        """The validated trial as YAML; a log without one describes it by its bench."""
        named = self.metadata.get("trial", "")
        if named or self._external:
            return named
        seen = self.overview
        return trial_from_messages(seen.testbed, seen.statuses, seen.last * 1e-9, str(self.path))

    def messages(self, topics: Collection[str] | None = None) -> Iterator[BagMessage]:
        """Yield the messages of the topics (default: all) in the order of their log times."""
        for block, lookup in self._chunks():
            for m in chunk_records(block, str(self.path)):
                if isinstance(m, McapRecord):
                    lookup.take(m)
                    continue
                topic, kind = lookup.topic(m.channel)
                lookup.track(m.channel, m.sequence, m.sequence, 1)
                if topics is None or topic in topics:
                    yield BagMessage(topic, kind, m.stamp, m.sequence, lookup.current(m))

    def decode_messages(
        self, topics: Collection[str] | None = None
    ) -> Iterator[tuple[str, int, Any]]:
        """Yield (topic, log time [ns], message); a message has its fields as attributes."""
        for topic, kind, stamp, _, data in self.messages(topics):
            yield topic, stamp, cdr.decode(kind, data)

    def blocks(self, topics: Collection[str], checked: bool = True) -> Iterator[ColumnBlock]:
        """Yield arrays, chunk by chunk; within a topic in the order of the bag.

        Args:
            topics: topics with types without sequences of nested types, such as /truth.
            checked: refuse a truth that is not finite, changes its sizes or starts again; else the
                caller has to check this.

        """
        sizes: Sizes = {}  # of the truth
        newest = 0, -1  # epoch and tick of the truth
        for data, lookup in self._chunks():
            for batch in self._batches(data, lookup):
                for channel, messages in batch.items():
                    topic, kind = lookup.topic(channel)
                    first, last = messages[0].sequence, messages[-1].sequence
                    lookup.track(channel, first, last, len(messages))
                    if topic not in topics:
                        continue
                    if channel in lookup.previous:
                        messages = [m._replace(data=lookup.current(m)) for m in messages]
                    for block in blocks_of(topic, kind, messages):
                        if checked and topic == "/truth":
                            sizes = check_truth(block.columns, str(self.path), sizes)
                            newest = check_one_run(block.columns, str(self.path), newest)
                        yield block

    def _batches(self, data: bytes, lookup: Lookup) -> Iterator[dict[int, list[RawMessage]]]:
        """Yield the messages of a chunk by channel; a crafted one may hold millions."""
        found: dict[int, list[RawMessage]] = {}
        count = 0
        for m in chunk_records(data, str(self.path)):
            if isinstance(m, McapRecord):
                lookup.take(m)
                continue
            found.setdefault(m.channel, []).append(m)
            count += 1
            if count == BATCH:
                yield found
                found, count = {}, 0
        yield found

    def columns(self, topic: str, fields: Collection[str] | None = None) -> dict[str, np.ndarray]:
        """Return a whole topic as arrays by field, and `stamp` [s]; for figures, not for 24 h.

        Sequences of varying length are filled with NaN up to the longest.
        """
        blocks = list(self.blocks([topic]))
        if not blocks:
            return {}
        result = {"stamp": np.concatenate([b.stamp for b in blocks]) * 1e-9}
        for name in blocks[0].columns:
            if fields is None or name in fields:
                parts = [b.columns[name] for b in blocks]
                max_width = max((p.shape[1] for p in parts if p.ndim == 2), default=0)
                parts = [pad_columns(p, max_width) for p in parts]
                result[name] = np.concatenate(parts)
        return result

    @cached_property
    def overview(self) -> Overview:
        """All that is rare, from one pass."""
        counts: dict[str, int] = {}
        types: dict[str, str] = {}
        events: list[Event] = []
        plans: dict[str, Any] = {}
        statuses: dict[str, Any] = {}
        testbed = None
        first, last, status_bytes = -1, 0, 0
        for topic, kind, stamp, _, data in self.messages():
            counts[topic] = counts.get(topic, 0) + 1
            types[topic] = kind
            first, last = (stamp if first < 0 else first), stamp
            if topic not in STATUS_TOPICS:
                continue
            message = cdr.decode(kind, data)
            if topic == "/events":
                status_bytes += _EVENT_SIZE + _TEXT_SIZE * len(message.data)
                events.append(logged_event(message, str(self.path)))
            else:
                before = statuses.get(getattr(message, "controller", ""))
                self._size_check.add(TEXT * sum(map(len, new_yaml(message, before))))
                check_record(topic, message, str(self.path))
            if topic == "/plan" and message.hash not in plans:
                status_bytes += len(data)
            check_size("events, plans and statuses", status_bytes, str(self.path))
            if topic == "/plan":
                plans.pop(message.hash, None)
                plans[message.hash] = message
            elif topic == "/testbed":
                testbed = message
            elif topic == "/controller_status":
                status_bytes += len(data) * (message.controller not in statuses)
                statuses[message.controller] = message
        records = {TRIAL_RECORD: self.metadata, **self._records}
        return Overview(
            counts, types, max(first, 0), last, tuple(events), tuple(plans.values()), testbed,
            statuses, records, self.cut, self._without_checksum(),
        )  # fmt: skip

    def _without_checksum(self) -> tuple[str, ...]:
        """Return the parts without a checksum, after a whole pass."""
        found = []
        if self._bare and not self._checksum_valid:
            where = f"the first at byte {self._bare[0]}"
            found.append(f"{len(self._bare)} chunks without a checksum, {where}")
        if self.cut is None and not self._checksum_valid:
            found.append("the data section has no checksum over all of it")
        kept = self._records.get(RUN_RECORD, {}).get("unverified")
        if kept:
            found.append(
                f"{kept} chunks without a checksum in the log that this was recovered from"
            )
        return tuple(found)

    def _leading_metadata(self) -> dict[str, str]:
        """Return the trial's record; every bag of this project starts with it."""
        stream = RecordStream(self.path)
        for record in stream:
            if record.opcode == HEADER:
                self._check_header(record.body)
            elif record.opcode == METADATA:
                name, data = self._metadata(record.body)
                if name == TRIAL_RECORD:
                    return data
            elif record.opcode == CHUNK:
                break
        if self._external:
            return {}
        if stream.cut is not None:
            words = f"a flexslew bag without a message: {stream.cut.reason}"
            raise BadInput(words, self.path)
        raise BadInput(
            f"not a flexslew bag (it holds no {TRIAL_RECORD!r} record): of what another recorder "
            "wrote nothing can be flown again; record with the bench's own, flexslew_lab recorder",
            self.path,
        )

    def _chunks(self) -> Iterator[tuple[bytes, Lookup]]:
        stream = RecordStream(self.path)
        self._size_check = SizeCheck(self.path)
        lookup = Lookup(self.path, counted=not self._external)
        self._records: dict[str, dict[str, str]] = {}
        self._bare: list[int] = []  # where chunks without a checksum are
        for record in stream:
            if record.opcode == CHUNK:
                if not has_checksum(record.body):
                    self._bare.append(record.offset)
                content = chunk_content(record.body, f"{self.path}: byte {record.offset}")
                self._size_check.add(len(content))
                yield content, lookup
            elif record.opcode in (SCHEMA, CHANNEL):
                lookup.take(record)
            elif record.opcode == METADATA:
                name, data = self._metadata(record.body)
                if name in (RUN_RECORD, ROSBAG_RECORD):
                    self._records[name] = data
        self.cut, self._checksum_valid = stream.cut, stream.checksum_valid

    def _check_header(self, body: bytes) -> None:
        profile = read_record(Header, body, self.path).profile
        if profile != "ros2":
            raise BadInput(f"profile {profile!r}, not 'ros2': a foreign bag", self.path)

    def _metadata(self, body: bytes) -> tuple[str, dict[str, str]]:
        record = read_record(Metadata, body, self.path)
        name, data = record.name, record.metadata
        if name in (TRIAL_RECORD, RUN_RECORD):
            if data.get("checksum") != checksum(data):
                raise BadInput(f"damaged metadata {name!r}: its checksum does not match", self.path)
            form = data.get("format")
            if form != FORMAT:
                raise BadInput(f"written in format {form}, this version reads {FORMAT}", self.path)
        if name == RUN_RECORD:
            check_run_record(data, str(self.path))
        return name, data


def find_mcap(path: Path) -> Path:
    """Return the .mcap file of a bag.

    Args:
        path: the file, the rosbag2 folder, or a folder with one of these inside.

    Raises:
        BadInput: there is none, or more than one.

    """
    if os.path.isfile(path):  # also of a name that is too long for one
        return path
    if not os.path.isdir(path):
        raise BadInput("no such bag", path)
    files = sorted(path.glob("*.mcap")) or sorted(path.glob("*/*.mcap"))
    if len(files) != 1:
        found = ", ".join(f.name for f in files) or "none"
        what = METADATA_FILE if (path / METADATA_FILE).exists() else "no metadata.yaml"
        raise BadInput(f"needs one .mcap file, has {found} (and {what}); give one of them", path)
    return files[0]
