"""The log read back: streaming, checked, and as arrays where the messages allow it."""

import json
from collections.abc import Collection, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flexslew_lab.log import cdr
from flexslew_lab.log.bag_columns import Block, blocks_of, widened
from flexslew_lab.log.bag_layout import FORMAT, METADATA_FILE, RUN_RECORD, TRIAL_RECORD, checksum
from flexslew_lab.log.cdr_layout import Layout
from flexslew_lab.log.mcap_scan import (
    CHANNEL,
    CHUNK,
    HEADER,
    METADATA,
    SCHEMA,
    Cut,
    RawMessage,
    Record,
    RecordStream,
    chunk_content,
    chunk_records,
    read_header,
    read_metadata,
)
from flexslew_lab.log.topic_lookup import Lookup
from flexslew_plant.errors import BadInput

RARE = ("/events", "/plan", "/testbed", "/controller_status")
LEVELS = ("info", "warning", "fault")


class BagMessage(NamedTuple):
    """One message as it lies in the bag."""

    topic: str
    type: str
    stamp: int  # log time [ns]
    sequence: int  # counted from 1 on its topic by the recorder
    data: bytes  # CDR


class LoggedEvent(NamedTuple):
    """An entry of `events`."""

    time: float  # simulated [s]
    tick: int
    epoch: int
    level: str  # info, warning or fault
    source: str
    kind: str
    message: str
    data: Any  # what its JSON holds


class Overview(NamedTuple):
    """All that is rare in a bag, from one pass over it."""

    counts: dict[str, int]  # messages by topic
    types: dict[str, str]  # by topic
    first: int  # log time [ns]
    last: int  # log time [ns]
    events: tuple[LoggedEvent, ...]
    plans: tuple[Any, ...]  # decoded flexslew_msgs/msg/Plan, oldest first
    testbed: Any  # decoded flexslew_msgs/msg/Testbed, the last one; None without
    statuses: dict[str, Any]  # the last ControllerStatus of every controller
    metadata: dict[str, dict[str, str]]  # the records by name
    cut: Cut | None


class BagReader:
    """A bag, read from its start each time it is asked. Memory does not grow with its length.

    Args:
        path: the rosbag2 folder, or the .mcap file.
        foreign: also read bags that this project has not written.

    Raises:
        BadInput: there is no bag, it is damaged, foreign, or of another version; also while
            reading.

    """

    def __init__(self, path: Path, foreign: bool = False) -> None:
        self.path = find_mcap(Path(path))
        self._foreign = foreign
        self.cut: Cut | None = None  # known after a whole pass
        self.metadata = self._leading_metadata()

    @property
    def trial_text(self) -> str:
        """The validated trial as YAML."""
        return self.metadata.get("trial", "")

    def messages(self, topics: Collection[str] | None = None) -> Iterator[BagMessage]:
        """Yield the messages of the topics (default: all) in the order of their log times."""
        for block, lookup in self._chunks():
            for m in chunk_records(block, str(self.path)):
                if isinstance(m, Record):
                    lookup.take(m)
                    continue
                topic, kind = lookup.topic(m.channel)
                lookup.follow(m.channel, m.sequence, m.sequence, 1)
                if topics is None or topic in topics:
                    yield BagMessage(topic, kind, m.stamp, m.sequence, m.data)

    def decoded(self, topics: Collection[str] | None = None) -> Iterator[tuple[str, int, Any]]:
        """Yield (topic, log time [ns], message); a message has its fields as attributes."""
        for topic, kind, stamp, _, data in self.messages(topics):
            yield topic, stamp, cdr.decode(kind, data)

    def blocks(self, topics: Collection[str]) -> Iterator[Block]:
        """Yield arrays, chunk by chunk; within a topic in the order of the bag.

        Args:
            topics: of types without sequences of nested types, such as /truth.

        """
        layouts: dict[tuple[str, int], list[Layout]] = {}
        for data, lookup in self._chunks():
            found: dict[int, list[RawMessage]] = {}
            for m in chunk_records(data, str(self.path)):
                if isinstance(m, Record):
                    lookup.take(m)
                elif m.channel in found:
                    found[m.channel].append(m)
                else:
                    found[m.channel] = [m]
            for channel, messages in found.items():
                topic, kind = lookup.topic(channel)
                lookup.follow(channel, messages[0].sequence, messages[-1].sequence, len(messages))
                if topic in topics:
                    yield from blocks_of(topic, kind, messages, layouts)

    def columns(self, topic: str, fields: Collection[str] | None = None) -> dict[str, np.ndarray]:
        """Return a whole topic as arrays by field, and `stamp` [s]; for figures, not for 24 h.

        Sequences whose length changes in the course of the run are filled with NaN.
        """
        blocks = list(self.blocks([topic]))
        if not blocks:
            return {}
        result = {"stamp": np.concatenate([b.stamp for b in blocks]) * 1e-9}
        for name in blocks[0].columns:
            if fields is None or name in fields:
                parts = [b.columns[name] for b in blocks]
                widest = max((p.shape[1] for p in parts if p.ndim == 2), default=0)
                parts = [widened(p, widest) for p in parts]
                result[name] = np.concatenate(parts)
        return result

    @cached_property
    def overview(self) -> Overview:
        """All that is rare, from one pass."""
        counts: dict[str, int] = {}
        types: dict[str, str] = {}
        events: list[LoggedEvent] = []
        plans: dict[str, Any] = {}
        statuses: dict[str, Any] = {}
        testbed = None
        first, last = -1, 0
        for topic, kind, stamp, _, data in self.messages():
            counts[topic] = counts.get(topic, 0) + 1
            types[topic] = kind
            first, last = (stamp if first < 0 else first), stamp
            if topic not in RARE:
                continue
            message = cdr.decode(kind, data)
            if topic == "/events":
                events.append(_event(message))
            elif topic == "/plan":
                plans.pop(message.hash, None)
                plans[message.hash] = message
            elif topic == "/testbed":
                testbed = message
            else:
                statuses[message.controller] = message
        records = {TRIAL_RECORD: self.metadata, **self._records}
        return Overview(
            counts, types, max(first, 0), last, tuple(events), tuple(plans.values()), testbed,
            statuses, records, self.cut,
        )  # fmt: skip

    def _leading_metadata(self) -> dict[str, str]:
        """Return the trial's record; every bag of this project starts with it."""
        for record in RecordStream(self.path):
            if record.opcode == HEADER:
                self._check_header(record.body)
            elif record.opcode == METADATA:
                name, data = self._metadata(record.body)
                if name == TRIAL_RECORD:
                    return data
            elif record.opcode == CHUNK:
                break
        if self._foreign:
            return {}
        raise BadInput(f"{self.path}: not a flexslew bag (it holds no {TRIAL_RECORD!r} record)")

    def _chunks(self) -> Iterator[tuple[bytes, Lookup]]:
        stream = RecordStream(self.path)
        lookup = Lookup(self.path, counted=not self._foreign)
        self._records: dict[str, dict[str, str]] = {}
        for record in stream:
            if record.opcode == CHUNK:
                yield chunk_content(record.body, f"{self.path}: byte {record.offset}"), lookup
            elif record.opcode in (SCHEMA, CHANNEL):
                lookup.take(record)
            elif record.opcode == METADATA:
                name, data = self._metadata(record.body)
                self._records[name] = data
        self.cut = stream.cut

    def _check_header(self, body: bytes) -> None:
        try:
            profile, _ = read_header(body)
        except ValueError as error:
            raise BadInput(f"{self.path}: damaged header: {error}") from None
        if profile != "ros2":
            raise BadInput(f"{self.path}: profile {profile!r}, not 'ros2': a foreign bag")

    def _metadata(self, body: bytes) -> tuple[str, dict[str, str]]:
        try:
            name, data = read_metadata(body)
        except ValueError as error:
            raise BadInput(f"{self.path}: damaged metadata: {error}") from None
        if name in (TRIAL_RECORD, RUN_RECORD):
            if data.get("checksum") != checksum(data):
                raise BadInput(
                    f"{self.path}: damaged metadata {name!r}: its checksum does not match"
                )
            if data["format"] != FORMAT:
                raise BadInput(
                    f"{self.path}: written in format {data['format']}, this version reads {FORMAT}"
                )
        return name, data


def find_mcap(path: Path) -> Path:
    """Return the .mcap file of a bag.

    Args:
        path: the file, the rosbag2 folder, or a folder with one of these inside.

    Raises:
        BadInput: there is none, or more than one.

    """
    if path.is_file():
        return path
    if not path.is_dir():
        raise BadInput(f"{path}: no such bag")
    files = sorted(path.glob("*.mcap")) or sorted(path.glob("*/*.mcap"))
    if len(files) != 1:
        found = ", ".join(f.name for f in files) or "none"
        what = METADATA_FILE if (path / METADATA_FILE).exists() else "no metadata.yaml"
        raise BadInput(f"{path}: needs one .mcap file, has {found} (and {what})")
    return files[0]


def _event(message: Any) -> LoggedEvent:
    try:
        data = json.loads(message.data) if message.data else {}
    except json.JSONDecodeError:
        data = message.data
    level = LEVELS[message.level] if message.level < len(LEVELS) else str(message.level)
    return LoggedEvent(
        message.stamp.sec + message.stamp.nanosec * 1e-9, message.tick, message.epoch, level,
        message.source, message.kind, message.message, data,
    )  # fmt: skip
