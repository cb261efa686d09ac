"""The log read back: streaming, checked, and as arrays where the messages allow it."""

import json
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from flexslew_plant.errors import BadInput

from flexslew_lab import cdr
from flexslew_lab.bag_layout import (
    FORMAT,
    METADATA_FILE,
    RUN_RECORD,
    TOPICS,
    TRIAL_RECORD,
    checksum,
)
from flexslew_lab.mcap_scan import (
    CHANNEL,
    CHUNK,
    HEADER,
    METADATA,
    SCHEMA,
    ChannelRecord,
    Cut,
    RawMessage,
    Record,
    RecordStream,
    SchemaRecord,
    chunk_content,
    chunk_records,
    read_channel,
    read_header,
    read_metadata,
    read_schema,
)
from flexslew_lab.schemas import MESSAGES, hash_of_schema, type_hash

RARE = ("/events", "/plan", "/testbed", "/controller_status")
LEVELS = ("info", "warning", "fault")


class BagMessage(NamedTuple):
    """One message as it lies in the bag."""

    topic: str
    type: str
    stamp: int  # log time [ns]
    sequence: int  # counted from 1 on its topic by the recorder
    data: bytes  # CDR


class Block(NamedTuple):
    """Messages of one topic that follow one another, as arrays.

    `columns` maps a field (nested names joined by dots) to one value a message, shape (messages,)
    or (messages, length); texts are objects.
    """

    topic: str
    stamp: np.ndarray  # log times, (messages,) [ns]
    columns: dict[str, Any]


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


@dataclass
class Lookup:
    """What a file says about its channels while it is read."""

    path: Path
    schemas: dict[int, SchemaRecord] = field(default_factory=dict)
    channels: dict[int, ChannelRecord] = field(default_factory=dict)
    checked: dict[int, tuple[str, str]] = field(default_factory=dict)  # channel -> topic, type
    sequence: dict[int, int] = field(default_factory=dict)  # channel -> last one seen
    counted: bool = True  # the recorder has numbered the messages of each topic

    def take(self, record: Record) -> None:
        """Take a schema or a channel."""
        try:
            if record.opcode == SCHEMA:
                schema = read_schema(record.body)
                self.schemas[schema.id] = schema
            else:
                channel = read_channel(record.body)
                self.channels[channel.id] = channel
        except ValueError as error:
            raise BadInput(f"{self.path}: damaged schema or channel: {error}") from None

    def topic(self, number: int) -> tuple[str, str]:
        """Return topic and type of a channel, once its definition is known to be ours."""
        if number not in self.checked:
            self.checked[number] = self._check(number)
        return self.checked[number]

    def follow(self, channel: int, first: int, last: int, count: int) -> None:
        """Take messages of a channel; refuse a file in which some are missing in between."""
        before = self.sequence.get(channel, 0)
        if self.counted and (first != before + 1 or last != before + count):
            raise BadInput(
                f"{self.path}: damaged: messages of {self.topic(channel)[0]} are missing after "
                f"number {before}; `log recover` keeps what is whole"
            )
        self.sequence[channel] = last

    def _check(self, number: int) -> tuple[str, str]:
        channel = self.channels.get(number)
        schema = self.schemas.get(channel.schema) if channel else None
        if channel is None or schema is None:
            raise BadInput(f"{self.path}: damaged: a message of an unknown channel {number}")
        where = f"{self.path}: {channel.topic}"
        if channel.encoding != "cdr" or schema.encoding != "ros2msg":
            raise BadInput(
                f"{where}: {channel.encoding!r} messages with a {schema.encoding!r} schema; "
                "only cdr with ros2msg is read"
            )
        known = TOPICS.get(channel.topic)
        if known and known.type != schema.name:
            raise BadInput(f"{where}: is a {schema.name}, not a {known.type}: a foreign bag")
        if schema.name.startswith(f"{MESSAGES}/"):
            recorded, ours = hash_of_schema(schema.name, schema.text), type_hash(schema.name)
            stated = channel.metadata.get("topic_type_hash", recorded)
            if recorded != ours or stated != ours:
                raise BadInput(
                    f"{where}: recorded with another definition of {schema.name} "
                    f"({recorded[:15]}, here {ours[:15]}); read it with the version that wrote it"
                )
        return channel.topic, schema.name


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
        layouts: dict[tuple[str, int], list[cdr.Layout]] = {}
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
                    yield from _runs(topic, kind, messages, layouts)

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
                parts = [_widened(p, widest) for p in parts]
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


def _runs(
    topic: str,
    kind: str,
    messages: list[RawMessage],
    layouts: dict[tuple[str, int], list[cdr.Layout]],
) -> Iterator[Block]:
    """Yield the messages as blocks of one layout each, in order."""
    start = 0
    while start < len(messages):
        size = len(messages[start].data)
        stop = next(
            (i for i in range(start, len(messages)) if len(messages[i].data) != size),
            len(messages),
        )
        rows = np.frombuffer(
            b"".join([m.data for m in messages[start:stop]]), dtype=np.uint8
        ).reshape(stop - start, size)
        stamps = np.array([m.stamp for m in messages[start:stop]], dtype=np.int64)
        while len(rows):
            layout = _layout_of(kind, rows[0], layouts.setdefault((kind, size), []))
            places = list(layout.shape)
            same = (rows[:, places] == rows[0, places]).all(axis=1)
            n = len(rows) if same.all() else int(np.argmin(same))
            columns = {
                name: np.full(n, value) if isinstance(value, str) else _texts(value, n)
                for name, value in cdr.gather(layout, rows[:n])
            }
            yield Block(topic, stamps[:n], columns)
            rows, stamps = rows[n:], stamps[n:]
        start = stop


def _layout_of(kind: str, row: np.ndarray, known: list[cdr.Layout]) -> cdr.Layout:
    """Return the layout of a message, from those met before where one fits."""
    data = row.tobytes()
    for layout, template in ((k, k.template) for k in known):
        if all(data[i] == template[i] for i in layout.shape):
            return layout
    layout = cdr.layout(kind, data)
    if len(known) < 64:
        known.append(layout)
    return layout


def _texts(value: Any, n: int) -> np.ndarray:
    """Return a column as an array; a tuple of texts is repeated for every message."""
    if isinstance(value, tuple):
        column = np.empty((n, len(value)), dtype=object)
        column[:] = value
        return column
    return np.asarray(value)


def _widened(part: np.ndarray, width: int) -> np.ndarray:
    if part.ndim == 1 or part.shape[1] == width:
        return part
    filler: Any = "" if part.dtype == object else np.nan
    wide = np.full((len(part), width), filler, dtype=part.dtype if part.dtype == object else float)
    wide[:, : part.shape[1]] = part
    return wide


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
