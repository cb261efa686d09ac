"""MCAP records one after another, each checked before anyone sees it."""

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple, TypeVar

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile

from flexslew_lab.log.bag_layout import MAGIC
from flexslew_lab.log.files.read_limits import check_size
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import open_given

HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX = 1, 2, 3, 4, 5, 6, 7
CHUNK_INDEX, METADATA, DATA_END = 0x08, 0x0C, 0x0F
_SCHEMA_LIKE = frozenset({SCHEMA, CHANNEL})
_DATA_RECORDS = frozenset({1, 3, 4, 5, 6, 7, 9, 0x0C, 0x0F})
_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<BQHIQQ")
_Record = TypeVar("_Record")


class McapRecord(NamedTuple):
    """One record of the data section."""

    opcode: int
    body: bytes
    offset: int  # in the file


class RawMessage(NamedTuple):
    """A message inside a chunk, not decoded."""

    channel: int
    sequence: int
    stamp: int  # log time [ns]
    data: bytes


class Cut(NamedTuple):
    """Where a file stops that was never finished."""

    offset: int  # first byte that is not part of a whole record
    lost: int  # bytes behind it
    reason: str


class RecordStream:
    """The data section of one file. After the iteration, `cut` shows whether the file is whole.

    A file without its end (killed recorder, full disk) is read up to its last whole record. A
    file with an end must be right to the last bit of the data section, by the CRC over it.

    Raises:
        BadInput: while iterating: the file is no MCAP file, or damaged.

    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.cut: Cut | None = None
        self.checksum_valid = False  # a checksum over the whole data section was there, and right
        self.at = 0  # where the last whole record ends
        self._file: BinaryIO = open_given(path)
        self._size = path.stat().st_size

    def __iter__(self) -> Iterator[McapRecord]:
        """Yield the records in their order."""
        with self._file as file:
            file.seek(max(self._size - len(MAGIC), 0))
            finished = file.read() == MAGIC and self._size > 2 * len(MAGIC)
            file.seek(0)
            magic = file.read(len(MAGIC))
            if magic != MAGIC:
                raise BadInput("not an MCAP file", self.path)
            at, crc = len(magic), zlib.crc32(magic)
            while True:
                head = file.read(_HEAD.size)
                opcode, length = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, 0)
                remaining = self._size - at - _HEAD.size
                if len(head) < _HEAD.size or opcode not in _DATA_RECORDS or length > remaining:
                    known = len(head) < _HEAD.size or opcode in _DATA_RECORDS
                    self._stop(at, finished, known, self._why(head, opcode, length, remaining))
                    return
                what = "a metadata record" if opcode == METADATA else "a record"
                check_size(what, length, f"{self.path}: byte {at}")
                body = file.read(length)
                if opcode == DATA_END:
                    self._check_end(at, body, crc)
                    if not finished:
                        self.cut = Cut(at, self._size - at, "the summary is not finished")
                    return
                crc = zlib.crc32(body, zlib.crc32(head, crc))
                self.at = at + _HEAD.size + length
                yield McapRecord(opcode, body, at)
                at = self.at

    def _stop(self, at: int, finished: bool, known: bool, why: str) -> None:
        """Note where the file is cut; damage, where it was finished or holds what no log has."""
        if finished or not known:
            raise self._file_error(at, why)
        self.cut = Cut(at, self._size - at, why)

    def _check_end(self, at: int, body: bytes, crc: int) -> None:
        if len(body) != 4:
            raise self._file_error(at, "its data section has no proper end")
        (expected,) = struct.unpack("<I", body)
        if expected and expected != crc:
            raise self._file_error(at, "the checksum over all data does not match")
        self.checksum_valid = expected != 0

    def _file_error(self, at: int, why: str) -> BadInput:
        return BadInput(f"damaged at byte {at}: {why}; take a copy or `log recover` it", self.path)

    @staticmethod
    def _why(head: bytes, opcode: int, length: int, remaining: int) -> str:
        if len(head) < _HEAD.size:
            return "the file ends between two records" if not head else "a record's head is cut"
        if opcode not in _DATA_RECORDS:
            return f"unknown kind of record {opcode}"
        return f"a record of {length} bytes is cut after {remaining}"


def has_checksum(body: bytes) -> bool:
    """Return whether a chunk brings a checksum of its content; zero stands for none."""
    return len(body) >= 28 and body[24:28] != b"\x00\x00\x00\x00"


def chunk_content(body: bytes, where: str) -> bytes:
    """Return the uncompressed records of a chunk, CRC checked.

    Raises:
        BadInput: the chunk is damaged or compressed in another way.

    """
    try:
        start, end, size, crc, n = struct.unpack_from("<QQQII", body)
        compression = body[32 : 32 + n].decode()
        (length,) = struct.unpack_from("<Q", body, 32 + n)
        packed = memoryview(body)[40 + n :]
        if len(packed) != length or end < start:
            raise ValueError("its lengths contradict each other")
        check_size("a chunk", size, where)
        if compression == "zstd":
            data = _decompress(packed, size)
        elif compression == "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size)
        elif compression:
            raise ValueError(f"compressed with {compression!r}, neither zstd nor lz4")
        else:
            data = bytes(packed)
        if len(data) != size or (crc and zlib.crc32(data) != crc):
            raise ValueError("its checksum does not match")
    except (struct.error, ValueError, RuntimeError, zstandard.ZstdError) as error:
        raise BadInput(f"damaged chunk: {error}", where) from None
    return data


def _decompress(packed: memoryview, size: int) -> bytes:
    """Return the content of a zstd frame; its header must give the same length, `size`."""
    frame = zstandard.get_frame_parameters(packed)
    if frame.content_size not in (size, zstandard.CONTENTSIZE_UNKNOWN):
        raise ValueError(f"it claims {size} bytes and {frame.content_size}")
    if frame.window_size > max(size, 1 << 23):
        raise ValueError(f"a window of {frame.window_size} bytes")
    return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)


def chunk_records(data: bytes, where: str) -> Iterator[McapRecord | RawMessage]:
    """Yield schemas and channels (as records) and messages of an unpacked chunk.

    Raises:
        BadInput: the records do not fill the chunk, or are none that a chunk may hold.

    """
    at, end = 0, len(data)
    unpack, head, message = _MESSAGE_HEAD.unpack_from, _HEAD.size, _MESSAGE_HEAD.size
    while at < end:
        try:
            opcode, length, channel, sequence, stamp, _ = unpack(data, at)
        except struct.error:  # a short record at the very end
            if at + head > end:
                raise BadInput("damaged chunk: a record is cut", where) from None
            opcode, length = _HEAD.unpack_from(data, at)
            channel = sequence = stamp = 0
        stop = at + head + length
        if stop > end or (opcode == MESSAGE and length < message - head):
            raise BadInput("damaged chunk: a record is cut", where)
        if opcode == MESSAGE:
            yield RawMessage(channel, sequence, stamp, data[at + message : stop])
        elif opcode in _SCHEMA_LIKE:
            yield McapRecord(opcode, data[at + head : stop], at)
        else:  # zeros, for example: records without content, a ninth of them as many
            raise BadInput(f"damaged chunk: it holds a record of kind {opcode}", where)
        at = stop


class _Fields(ReadDataStream):
    """The bytes of a record, which must not end within a field."""

    def read(self, length: int) -> bytes:
        data = super().read(length)
        if len(data) < length:
            raise EndOfFile
        return data


def read_record(kind: type[_Record], body: bytes, source: object) -> _Record:
    """Return a header, schema, channel or metadata record.

    Raises:
        BadInput: it is damaged.

    """
    try:
        record: _Record = kind.read(_Fields(BytesIO(body)))  # type: ignore[attr-defined]
    except (EndOfFile, struct.error, ValueError) as error:
        words = str(error) or "it ends within a field"
        raise BadInput(f"damaged {kind.__name__.lower()}: {words}", source) from None
    return record
