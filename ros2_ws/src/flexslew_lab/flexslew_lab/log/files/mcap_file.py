"""The MCAP file while it is written: whole records only, checksums, and the index at its end."""

import errno
import os
import struct
import tempfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

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

from flexslew_lab.log.bag_layout import MAGIC
from flexslew_plant.errors import FlexslewError


class RecordingStopped(FlexslewError):
    """The log cannot be written any more; everything up to the last chunk is safe."""


class Chunk(NamedTuple):
    """Messages that are written at once."""

    start: int  # first log time [ns]
    end: int  # last log time [ns]
    raw: bytes  # records, not compressed
    data: bytes  # the same with zstd
    entries: Mapping[int, bytes]  # message index by channel: pairs of log time and offset


class McapFile:
    """Every record is handed to the system when it is made; nothing waits in this process.

    The chunk index waits in a file of its own, so memory does not grow with the log.

    Raises:
        OSError: the file cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._stream = open(path, "xb", buffering=0)  # noqa: SIM115
        self._index: BinaryIO = tempfile.TemporaryFile(dir=path.parent)  # noqa: SIM115
        self._metadata: list[MetadataIndex] = []
        self._at = 0
        self._crc = 0
        self.chunks = 0
        self.failed: RecordingStopped | None = None
        self._write(MAGIC)
        self._write(record_bytes(Header(profile="ros2", library="flexslew")))

    def add_metadata(self, name: str, data: dict[str, str]) -> None:
        """Write a metadata record."""
        record = record_bytes(Metadata(name=name, metadata=data))
        self._metadata.append(MetadataIndex(offset=self._at, length=len(record), name=name))
        self._write(record)

    def add_chunk(self, chunk: Chunk) -> None:
        """Write a chunk with its message index.

        Raises:
            RecordingStopped: the system takes no more bytes; the same again at every later call.
        """
        head = struct.pack("<QQQI", chunk.start, chunk.end, len(chunk.raw), zlib.crc32(chunk.raw))
        body = head + _text("zstd") + struct.pack("<Q", len(chunk.data)) + chunk.data
        record = _record(Opcode.CHUNK, body)
        chunk_at, index_at = self._at, self._at + len(record)
        offsets, index = b"", bytearray()
        for channel, entries in chunk.entries.items():
            offsets += struct.pack("<HQ", channel, index_at + len(index))
            body = struct.pack("<HI", channel, len(entries)) + entries
            index += _record(Opcode.MESSAGE_INDEX, body)
        self._write(record + index)
        entry = struct.pack("<QQQQI", chunk.start, chunk.end, chunk_at, len(record), len(offsets))
        entry += offsets + struct.pack("<Q", len(index)) + _text("zstd")
        entry += struct.pack("<QQ", len(chunk.data), len(chunk.raw))
        self.call_system(self._index.write, _record(Opcode.CHUNK_INDEX, entry))
        self.chunks += 1

    def finish(
        self, records: Sequence[McapRecord], counts: dict[int, int], start: int, end: int
    ) -> None:
        """Write the end: schemas and channels again, statistics, the index.

        Args:
            records: schemas and channels.
            counts: messages by channel.
            start: first log time [ns].
            end: last log time [ns].

        Raises:
            RecordingStopped: as add_chunk.
        """
        self._write(record_bytes(DataEnd(self._crc)))
        schemas = [r for r in records if isinstance(r, Schema)]
        channels = [r for r in records if isinstance(r, Channel)]
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(channels),
            channel_message_counts=counts,
            chunk_count=self.chunks,
            message_count=sum(counts.values()),
            metadata_count=len(self._metadata),
            message_start_time=start,
            message_end_time=end,
            schema_count=len(schemas),
        )
        summary_at, self._crc = self._at, 0
        offsets = self._group(Opcode.SCHEMA, schemas)
        offsets += self._group(Opcode.CHANNEL, channels)
        offsets += self._group(Opcode.STATISTICS, [statistics])
        offsets += self._chunk_index()
        offsets += self._group(Opcode.METADATA_INDEX, self._metadata)
        offsets_at = self._at
        self._write(offsets)
        footer = record_bytes(
            Footer(summary_start=summary_at, summary_offset_start=offsets_at, summary_crc=0)
        )
        crc = zlib.crc32(footer[:-4], self._crc)
        self._write(footer[:-4] + struct.pack("<I", crc) + MAGIC)

    def check_path(self) -> None:
        """Check that the file that was written is the one that is found by its name.

        Raises:
            OSError: if it was removed or moved in the meantime.
        """
        named, written = os.stat(self.path), os.fstat(self._stream.fileno())
        if (named.st_dev, named.st_ino) != (written.st_dev, written.st_ino):
            raise FileNotFoundError(errno.ENOENT, "another file has taken its place")

    def close(self) -> None:
        """Give the files back to the system."""
        self._stream.close()
        with suppress(OSError):  # on a full disk, where the rest of the index has no room
            self._index.close()

    def call_system(self, action: Callable[..., Any], *arguments: Any) -> None:
        """Do something with the system; its failure ends the recording."""
        if self.failed:
            raise self.failed
        try:
            action(*arguments)
        except OSError as error:
            self.failed = RecordingStopped(f"{self.path}: recording stopped: {error.strerror}")
            raise self.failed from None

    def _write(self, data: bytes) -> None:
        self.call_system(self._write_all, data)
        self._at += len(data)
        self._crc = zlib.crc32(data, self._crc)

    def _write_all(self, data: bytes) -> None:
        """Write all bytes, or leave the file as it was: it ends with a whole record."""
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._stream.write(rest) :]
        except OSError:
            self._stream.truncate(self._at)
            raise

    def _group(self, opcode: Opcode, records: Sequence[McapRecord]) -> bytes:
        """Write records of one kind; return the summary entry with their place."""
        at, data = self._at, b"".join(map(record_bytes, records))
        self._write(data)
        return (
            record_bytes(SummaryOffset(group_opcode=opcode, group_length=len(data), group_start=at))
            if data
            else b""
        )

    def _chunk_index(self) -> bytes:
        at = self._at
        self._index.seek(0)
        while block := self._index.read(1 << 20):
            self._write(block)
        if self._at == at:
            return b""
        return record_bytes(
            SummaryOffset(
                group_opcode=Opcode.CHUNK_INDEX, group_length=self._at - at, group_start=at
            )
        )


def record_bytes(record: McapRecord) -> bytes:
    """Return a record as it stands in the file."""
    builder: Any = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())


def _record(opcode: int, body: bytes | bytearray) -> bytes:
    return struct.pack("<BQ", opcode, len(body)) + body


def _text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()
