"""The log while it is written: an MCAP file in a rosbag2 folder, whole up to its last chunk."""

import fcntl
import os
import struct
import tempfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import yaml
import zstandard
from flexslew_plant.errors import BadInput, FlexslewError
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from flexslew_lab.bag_layout import (
    LOCK_FILE,
    MAGIC,
    METADATA_FILE,
    ROSBAG_RECORD,
    RUN_RECORD,
    TRIAL_RECORD,
    qos_profile,
    sealed,
)
from flexslew_lab.schemas import schema_text, type_hash

CHUNK_SIZE = 64 * 1024  # uncompressed [B]; what a kill -9 may cost
_MESSAGE = struct.Struct("<BQHIQQ")
_ENTRY = struct.Struct("<QQ")


class RecordingStopped(FlexslewError):  # noqa: N818 (a state, as rosbag2 has it)
    """The log cannot be written any more; everything up to the last chunk is safe."""


class _Track(NamedTuple):
    id: int
    topic: str
    type: str


class BagWriter:
    """Writes messages that are already CDR bytes. Memory does not grow with the log.

    Args:
        folder: becomes the rosbag2 folder; made where it is missing.
        metadata: of the run, all text: trial, trial_file, versions, ...
        chunk_size: bytes of messages before they are compressed and handed to the system [B].
        distribution: of ROS, for metadata.yaml.

    Raises:
        BadInput: another recorder writes to this folder, or it holds a bag already.
        RecordingStopped: the folder cannot be written.

    """

    def __init__(
        self,
        folder: Path,
        metadata: Mapping[str, str],
        chunk_size: int = CHUNK_SIZE,
        distribution: str = "",
    ) -> None:
        self.folder = Path(folder)
        self.path = self.folder / f"{self.folder.resolve().name}_0.mcap"
        self.messages = 0
        self.last = -1  # log time of the last message [ns]
        self._distribution = distribution or os.environ.get("ROS_DISTRO", "unknown")
        self._chunk_size = chunk_size
        self._compressor = zstandard.ZstdCompressor()
        self._tracks: dict[str, _Track] = {}
        self._sequence: dict[str, list[Any]] = {}  # id, messages so far, index of this chunk
        self._records: list[McapRecord] = []  # schemas and channels, again in the summary
        self._metadata_index: list[MetadataIndex] = []
        self._buffer = bytearray()
        self._chunk_start = 0
        self._first: int | None = None
        self._chunks = 0
        self._at = 0
        self._crc = 0
        self._failed: RecordingStopped | None = None
        self._closed = False
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._lock = lock_folder(self.folder)
            if self.path.exists() or (self.folder / METADATA_FILE).exists():
                unlock_folder(self._lock, self.folder)
                raise BadInput(f"{self.folder}: holds a bag already; choose another folder")
            self._stream = open(self.path, "xb", buffering=0)  # noqa: SIM115
            self._index: BinaryIO = tempfile.TemporaryFile(dir=self.folder)  # noqa: SIM115
        except OSError as error:
            raise RecordingStopped(f"{self.folder}: cannot be written: {error.strerror}") from None
        self._write(MAGIC)
        self._put(Header("ros2", "flexslew"))
        self._annotate(TRIAL_RECORD, metadata)

    def add_topic(self, topic: str, type_name: str) -> None:
        """Announce a topic; `write` does it by itself at the first message.

        Args:
            topic: absolute name.
            type_name: `package/msg/Type`.

        """
        if topic in self._tracks:
            return
        schema = next(
            (s.id for s in self._records if isinstance(s, Schema) and s.name == type_name), 0
        )
        if not schema:
            schema = 1 + sum(isinstance(r, Schema) for r in self._records)
            record = Schema(
                id=schema, data=schema_text(type_name).encode(), encoding="ros2msg", name=type_name
            )
            self._records.append(record)
            self._buffer += _bytes(record)
        number = len(self._tracks) + 1
        channel = Channel(
            id=number,
            topic=topic,
            message_encoding="cdr",
            schema_id=schema,
            metadata={
                "offered_qos_profiles": _yaml([qos_profile(topic)]),
                "topic_type_hash": type_hash(type_name),
            },
        )
        self._records.append(channel)
        self._buffer += _bytes(channel)
        self._tracks[topic] = _Track(number, topic, type_name)
        self._sequence[topic] = [number, 0, bytearray()]

    def write(self, topic: str, type_name: str, data: bytes, stamp: int) -> None:
        """Append one message.

        Args:
            topic: absolute name.
            type_name: `package/msg/Type`.
            data: CDR bytes.
            stamp: simulated time [ns]; the log time is this, or one more than the last one where
                that is later, so log times are unique and rise.

        Raises:
            RecordingStopped: the disk is full, or another failure of the system; the same again
                at every later call.

        """
        track = self._sequence.get(topic)
        if track is None:
            self.add_topic(topic, type_name)
            track = self._sequence[topic]
        if stamp <= self.last:
            stamp = self.last + 1
        self.last = stamp
        buffer = self._buffer
        if not self._chunk_start:
            self._chunk_start = stamp + 1
        track[1] += 1
        track[2] += _ENTRY.pack(stamp, len(buffer))
        buffer += _MESSAGE.pack(5, 22 + len(data), track[0], track[1], stamp, stamp)
        buffer += data
        self.messages += 1
        if len(buffer) > self._chunk_size:
            self.flush()

    def flush(self) -> None:
        """Hand the chunk in progress to the system, so that no end of this process loses it.

        Raises:
            RecordingStopped: as `write`.

        """
        if self._failed:
            raise self._failed
        if not self._chunk_start:
            return
        raw = bytes(self._buffer)
        start, end = self._chunk_start - 1, self.last
        data = self._compressor.compress(raw)
        head = struct.pack("<QQQI", start, end, len(raw), zlib.crc32(raw))
        chunk = _record(Opcode.CHUNK, head + _text("zstd") + struct.pack("<Q", len(data)) + data)
        chunk_at, index_at, offsets = self._at, self._at + len(chunk), b""
        index = bytearray()
        for number, _, entries in self._sequence.values():
            if entries:
                offsets += struct.pack("<HQ", number, index_at + len(index))
                body = struct.pack("<HI", number, len(entries)) + entries
                index += _record(Opcode.MESSAGE_INDEX, body)
        self._write(chunk + index)
        entry = struct.pack("<QQQQI", start, end, chunk_at, len(chunk), len(offsets)) + offsets
        entry += struct.pack("<Q", len(index)) + _text("zstd")
        entry += struct.pack("<QQ", len(data), len(raw))
        self._guarded(self._index.write, _record(Opcode.CHUNK_INDEX, entry))
        self._first = start if self._first is None else self._first
        self._chunks += 1
        self._chunk_start = 0
        self._buffer.clear()
        for track in self._sequence.values():
            track[2] = bytearray()

    def close(self, run: Mapping[str, str] | None = None) -> None:
        """Finish the file: index, statistics, metadata.yaml. A second call does nothing.

        Args:
            run: how the run ended, all text: wall_time, exit_code, ...

        Raises:
            RecordingStopped: the end could not be written; `recover` makes the bag whole.

        """
        if self._closed:
            return
        self._closed = True
        try:
            self.flush()
            if run is not None:
                self._annotate(RUN_RECORD, run)
            information = self._information()
            self._metadata(ROSBAG_RECORD, {"serialized_metadata": _yaml(information)})
            self._finish()
            text = _yaml({"rosbag2_bagfile_information": information})
            self._guarded(_replace, self.folder / METADATA_FILE, text)
        finally:
            self._stream.close()
            self._index.close()
            unlock_folder(self._lock, self.folder)

    def __enter__(self) -> "BagWriter":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _annotate(self, name: str, data: Mapping[str, str]) -> None:
        self._metadata(name, sealed({key: str(value) for key, value in data.items()}))

    def _metadata(self, name: str, data: dict[str, str]) -> None:
        at = self._at
        length = self._put(Metadata(name=name, metadata=data))
        self._metadata_index.append(MetadataIndex(offset=at, length=length, name=name))

    def _put(self, record: McapRecord) -> int:
        data = _bytes(record)
        self._write(data)
        return len(data)

    def _write(self, data: bytes) -> None:
        """Hand bytes to the system; after a failure the file ends with its last whole record."""
        if self._failed:
            raise self._failed
        self._guarded(self._write_all, data)
        self._at += len(data)
        self._crc = zlib.crc32(data, self._crc)

    def _write_all(self, data: bytes) -> None:
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._stream.write(rest) :]
        except OSError:
            self._stream.truncate(self._at)
            raise

    def _guarded(self, action: Any, *arguments: Any) -> None:
        try:
            action(*arguments)
        except OSError as error:
            self._failed = RecordingStopped(
                f"{self.path}: recording stopped after {self.messages} messages: {error.strerror}"
            )
            raise self._failed from None

    def _finish(self) -> None:
        self._put(DataEnd(self._crc))
        groups: list[tuple[Opcode, bytes]] = []
        schemas = [_bytes(r) for r in self._records if isinstance(r, Schema)]
        channels = [_bytes(r) for r in self._records if isinstance(r, Channel)]
        groups.append((Opcode.SCHEMA, b"".join(schemas)))
        groups.append((Opcode.CHANNEL, b"".join(channels)))
        counts = {number: count for number, count, _ in self._sequence.values() if count}
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._tracks),
            channel_message_counts=counts,
            chunk_count=self._chunks,
            message_count=self.messages,
            metadata_count=len(self._metadata_index),
            message_start_time=self._first or 0,
            message_end_time=max(self.last, 0),
            schema_count=sum(isinstance(r, Schema) for r in self._records),
        )
        groups.append((Opcode.STATISTICS, _bytes(statistics)))
        start, self._crc = self._at, 0
        offsets = b""
        for opcode, data in groups:
            offsets += self._group(opcode, data)
        chunks_at = self._at
        self._index.seek(0)
        while block := self._index.read(1 << 20):
            self._write(block)
        if self._at > chunks_at:
            offsets += _bytes(SummaryOffset(Opcode.CHUNK_INDEX, self._at - chunks_at, chunks_at))
        offsets += self._group(
            Opcode.METADATA_INDEX, b"".join(_bytes(r) for r in self._metadata_index)
        )
        offsets_at = self._at
        self._write(offsets)
        footer = _bytes(Footer(summary_start=start, summary_offset_start=offsets_at, summary_crc=0))
        crc = zlib.crc32(footer[:-4], self._crc)
        self._write(footer[:-4] + struct.pack("<I", crc) + MAGIC)

    def _group(self, opcode: Opcode, data: bytes) -> bytes:
        """Write records of one kind; return the entry that says where they are."""
        at = self._at
        self._write(data)
        if not data:
            return b""
        return _bytes(SummaryOffset(opcode, len(data), at))

    def _information(self) -> dict[str, Any]:
        start = self._first or 0
        duration = {"nanoseconds": max(self.last - start, 0)}
        starting = {"nanoseconds_since_epoch": start}
        return {
            "version": 9,
            "storage_identifier": "mcap",
            "duration": duration,
            "starting_time": starting,
            "message_count": self.messages,
            "topics_with_message_count": [
                {
                    "topic_metadata": {
                        "name": track.topic,
                        "type": track.type,
                        "serialization_format": "cdr",
                        "offered_qos_profiles": [qos_profile(track.topic)],
                        "type_description_hash": type_hash(track.type),
                    },
                    "message_count": self._sequence[track.topic][1],
                }
                for track in self._tracks.values()
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [self.path.name],
            "files": [
                {
                    "path": self.path.name,
                    "starting_time": starting,
                    "duration": duration,
                    "message_count": self.messages,
                }
            ],
            "custom_data": None,
            "ros_distro": self._distribution,
        }


class _Plain(yaml.SafeDumper):
    """YAML without anchors, which rosbag2's reader does not know."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _yaml(data: Any) -> str:
    return str(yaml.dump(data, Dumper=_Plain, sort_keys=False, default_flow_style=False))


def _bytes(record: McapRecord) -> bytes:
    builder: Any = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())


def _record(opcode: int, body: bytes | bytearray) -> bytes:
    return struct.pack("<BQ", opcode, len(body)) + body


def _text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def _replace(path: Path, text: str) -> None:
    """Write a file such that it is there whole or not at all."""
    draft = path.with_suffix(".tmp")
    draft.write_text(text, encoding="utf-8")
    draft.replace(path)


def lock_folder(folder: Path) -> int:
    """Return the descriptor of the lock that the system drops when this process ends."""
    handle = os.open(folder / LOCK_FILE, os.O_CREAT | os.O_RDWR, 0o644)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        raise BadInput(
            f"{folder}: another recorder writes here; choose another folder or end it first"
        ) from None
    return handle


def unlock_folder(handle: int, folder: Path) -> None:
    """Give the folder free for another recorder."""
    (folder / LOCK_FILE).unlink(missing_ok=True)
    os.close(handle)
