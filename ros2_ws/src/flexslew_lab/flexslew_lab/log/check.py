"""What is wrong with a log, if anything: damage, gaps, time, definitions, index."""

import json
import struct
import zlib
from pathlib import Path
from typing import Any, BinaryIO

import yaml

from flexslew_lab.log.bag_layout import MAGIC, METADATA_FILE, RUN_RECORD
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.mcap_scan import RecordStream
from flexslew_lab.log.tick_check import Finding, check_ticks
from flexslew_plant.errors import BadInput

_HEAD = struct.Struct("<BQ")
_FOOTER = struct.Struct("<BQQQI")


def check_log(path: Path) -> list[Finding]:
    """Return what was looked at, good or bad. The log is sound if every finding is ok.

    Args:
        path: the bag's folder or file.

    Raises:
        BadInput: there is no bag of this project.

    """
    bag = BagReader(path)
    findings: list[Finding] = []
    try:
        overview = bag.overview
    except BadInput as error:
        return [Finding(False, "checksums, schemas and sequence", _after(error, bag.path))]
    words = f"{sum(overview.counts.values())} messages on {len(overview.counts)} topics"
    findings.append(Finding(True, "checksums, schemas and sequence", words))
    whole = overview.cut is None
    detail = (
        "whole"
        if overview.cut is None
        else f"cut at byte {overview.cut.offset}: " + (overview.cut.reason)
    )
    findings.append(Finding(whole, "end of the file", detail))
    if whole:
        findings.append(_index(bag.path, sum(overview.counts.values())))
        findings.append(_folder(bag.path, overview.counts))
    ended = overview.metadata.get(RUN_RECORD, {})
    findings.append(
        Finding(
            bool(ended) and "recovered" not in ended,
            "end of the run",
            ended.get("recovered", "") or ("recorded" if ended else "the recorder did not say it"),
        )
    )
    findings += check_ticks(bag)
    drops = [e for e in overview.events if e.kind in ("dropped", "recording_stopped")]
    words = "; ".join(f"{e.time:g} s: {e.message}" for e in drops[:5]) or "none reported"
    findings.append(Finding(not drops, "drops", words))
    return findings


def _index(path: Path, messages: int) -> Finding:
    """Check the summary section against its CRC and against what was read."""
    data_end = RecordStream(path)
    for _ in data_end:
        pass
    start = data_end.at + _HEAD.size + 4  # behind the data section's end record
    foot = path.stat().st_size - len(MAGIC) - _FOOTER.size
    with path.open("rb") as file:
        try:
            file.seek(foot)
            opcode, length, summary, _, crc = _FOOTER.unpack(file.read(_FOOTER.size))
            if opcode != 2 or length != 20 or summary != start:
                raise ValueError("the footer is damaged")
            if crc and _crc(file, start, foot + _FOOTER.size - 4) != crc:
                raise ValueError("the checksum of the summary does not match")
            count = _statistics(file, start, foot)
            if count != messages:
                raise ValueError(f"it counts {count} messages, the file has {messages}")
        except (struct.error, ValueError) as error:
            return Finding(False, "index", f"{error}; `log recover` makes it again")
    return Finding(True, "index", f"checksum right, {messages} messages")


def _crc(file: BinaryIO, start: int, end: int) -> int:
    """Return the checksum of a part of a file, read piece by piece."""
    crc = 0
    file.seek(start)
    while start < end:
        piece = file.read(min(end - start, 1 << 20))
        if not piece:
            raise ValueError("the summary is cut")
        crc = zlib.crc32(piece, crc)
        start += len(piece)
    return crc


def _statistics(file: BinaryIO, at: int, end: int) -> int:
    """Return how many messages the summary counts."""
    while at + _HEAD.size <= end:
        file.seek(at)
        opcode, length = _HEAD.unpack(file.read(_HEAD.size))
        if opcode == 0x0B:
            return int(struct.unpack("<Q", file.read(8))[0])
        at += _HEAD.size + length
    raise ValueError("it has no statistics")


def _folder(path: Path, counts: dict[str, int]) -> Finding:
    """Check metadata.yaml against the file."""
    described = path.parent / METADATA_FILE
    if not described.exists():
        return Finding(False, METADATA_FILE, "missing; `log recover` makes it again")
    try:
        information: Any = yaml.safe_load(described.read_text(encoding="utf-8"))
        information = information["rosbag2_bagfile_information"]
        listed = {
            t["topic_metadata"]["name"]: t["message_count"]
            for t in information["topics_with_message_count"]
            if t["message_count"]
        }
        if information["relative_file_paths"] != [path.name]:
            return Finding(False, METADATA_FILE, f"names another file than {path.name}")
    except (yaml.YAMLError, UnicodeDecodeError, KeyError, TypeError) as error:
        return Finding(False, METADATA_FILE, f"not readable: {json.dumps(str(error))[:80]}")
    ok = listed == counts
    return Finding(ok, METADATA_FILE, "fits the file" if ok else "counts other messages")


def _after(error: BadInput, path: Path) -> str:
    return str(error).removeprefix(f"{path}: ")
