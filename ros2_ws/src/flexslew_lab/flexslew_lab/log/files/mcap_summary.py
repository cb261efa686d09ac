"""The summary section at the end of a finished MCAP file: schemas, channels, index, statistics."""

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from flexslew_lab.log.bag_layout import MAGIC
from flexslew_lab.log.files.mcap_scan import FOOTER, McapRecord
from flexslew_lab.log.files.read_limits import check_size
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import open_given

STATISTICS = 0x0B
_HEAD = struct.Struct("<BQ")
_FOOTER = struct.Struct("<BQQQI")
_PIECE = 1 << 20  # read at once [B]


class Summary(NamedTuple):
    """The place of the summary in a file."""

    path: Path
    start: int
    end: int  # of its last record; the footer follows
    crc: int  # 0: it has none


def find_summary(path: Path) -> Summary | None:
    """Return the place of the summary, its checksum right; None if the file was not finished.

    Raises:
        BadInput: the footer or the summary is damaged.
    """
    end = path.stat().st_size - len(MAGIC) - _FOOTER.size
    with open_given(path) as file:
        file.seek(max(end, 0))
        foot = file.read()
        if len(foot) != _FOOTER.size + len(MAGIC) or not foot.endswith(MAGIC):
            return None
        opcode, length, start, _, crc = _FOOTER.unpack_from(foot)
        if opcode != FOOTER or length != _FOOTER.size - _HEAD.size or not 0 < start <= end:
            raise BadInput("damaged: no footer; `log recover` makes it again", path)
        if crc and _crc(file, start, end + _FOOTER.size - 4) != crc:
            raise BadInput(
                "damaged: the checksum of the summary does not match; `log recover` makes it again",
                path,
            )
    return Summary(path, start, end, crc)


def summary_records(summary: Summary) -> Iterator[McapRecord]:
    """Yield the records of a summary.

    Raises:
        BadInput: a record is cut or too large.
    """
    at = summary.start
    with open_given(summary.path) as file:
        file.seek(at)
        while at < summary.end:
            head = file.read(_HEAD.size)
            opcode, length = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, summary.end)
            if at + _HEAD.size + length > summary.end:
                raise BadInput(f"damaged at byte {at}: a record is cut", summary.path)
            check_size("a record", length, f"{summary.path}: byte {at}")
            yield McapRecord(opcode, file.read(length), at)
            at += _HEAD.size + length


def _crc(file: BinaryIO, start: int, end: int) -> int:
    """Return the checksum of a part of a file, read piece by piece."""
    crc = 0
    file.seek(start)
    while start < end:
        piece = file.read(min(end - start, _PIECE))
        if not piece:
            break
        crc = zlib.crc32(piece, crc)
        start += len(piece)
    return crc
