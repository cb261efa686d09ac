"""What is wrong with a log, if anything: damage, gaps, time, definitions, index."""

import json
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
import yaml

from flexslew_lab.bag_columns import Block
from flexslew_lab.bag_layout import MAGIC, METADATA_FILE, RUN_RECORD
from flexslew_lab.bag_reader import BagReader
from flexslew_lab.mcap_scan import RecordStream
from flexslew_plant.errors import BadInput

TICKED = ("/truth", "/measurement", "/effort_command", "/controller_state")
_HEAD = struct.Struct("<BQ")
_FOOTER = struct.Struct("<BQQQI")


class Finding(NamedTuple):
    """One thing that was looked at."""

    ok: bool
    what: str
    detail: str


class _Topic:
    """Ticks and times of a topic, block after block."""

    def __init__(self) -> None:
        self.messages, self.gaps, self.missing, self.repeated = 0, 0, 0, 0
        self.first_gap = ""
        self.backwards = 0
        self.not_finite = 0
        self.last: tuple[int, int, float] | None = None  # epoch, tick, time

    def add(self, block: Block) -> None:
        columns = block.columns
        tick = columns["tick"].astype(np.int64)
        epoch = columns["epoch"].astype(np.int64)
        prefix = "header.stamp." if "header.stamp.sec" in columns else "stamp."
        time = columns[prefix + "sec"] + columns[prefix + "nanosec"] * 1e-9
        if self.last is not None:
            tick, epoch = np.append(self.last[1], tick), np.append(self.last[0], epoch)
            time = np.append(self.last[2], time)
        step, same = np.diff(tick), np.diff(epoch) == 0
        gap = same & (step > 1)
        if gap.any() and not self.first_gap:
            k = int(np.argmax(gap))
            self.first_gap = f"first between tick {tick[k]} and {tick[k + 1]}"
        self.gaps += int(gap.sum())
        self.missing += int((step[gap] - 1).sum())
        self.repeated += int((same & (step == 0)).sum())
        self.backwards += int((same & (np.diff(time) < 0)).sum())
        floats = (c for c in columns.values() if c.dtype.kind == "f")
        self.not_finite += sum(int((~np.isfinite(c)).sum()) for c in floats)
        self.messages += len(block.stamp)
        self.last = int(epoch[-1]), int(tick[-1]), float(time[-1])


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
    findings += _ticks(bag)
    drops = [e for e in overview.events if e.kind in ("dropped", "recording_stopped")]
    words = "; ".join(f"{e.time:g} s: {e.message}" for e in drops[:5]) or "none reported"
    findings.append(Finding(not drops, "drops", words))
    return findings


def _ticks(bag: BagReader) -> Iterator[Finding]:
    topics = {name: _Topic() for name in TICKED}
    rising, last = True, -1
    clock = _Clock()
    for block in bag.blocks([*TICKED, "/clock"]):
        if block.topic == "/clock":
            clock.add(block)
        else:
            topics[block.topic].add(block)
    for message in bag.messages():
        rising, last = rising and message.stamp > last, message.stamp
    yield Finding(rising, "log times", "unique and rising" if rising else "not rising")
    if clock.messages:
        detail = f"{clock.backwards} steps back" if clock.backwards else "never steps back"
        yield Finding(clock.backwards <= clock.resets(topics), "/clock", detail)
    for name, topic in topics.items():
        if not topic.messages:
            if name in ("/truth", "/measurement"):
                yield Finding(False, name, "not in the log")
            continue
        bad = {
            f"{topic.missing} ticks missing in {topic.gaps} gaps, {topic.first_gap}": topic.gaps,
            f"{topic.repeated} ticks twice": topic.repeated,
            f"{topic.backwards} times the stamp steps back": topic.backwards,
            f"{topic.not_finite} numbers are not finite": topic.not_finite,
        }
        words = "; ".join(text for text, count in bad.items() if count)
        optional = name in ("/effort_command", "/controller_state") and not (
            topic.repeated or topic.backwards or topic.not_finite
        )
        yield Finding(not words or optional, name, words or f"{topic.messages} ticks without a gap")


class _Clock:
    def __init__(self) -> None:
        self.messages, self.backwards, self.last = 0, 0, -1

    def add(self, block: Block) -> None:
        sec, nanosec = block.columns["clock.sec"], block.columns["clock.nanosec"]
        time = np.append(self.last, sec.astype(np.int64) * 10**9 + nanosec)
        self.backwards += int((np.diff(time) < 0).sum())
        self.messages += len(sec)
        self.last = int(time[-1])

    @staticmethod
    def resets(topics: dict[str, _Topic]) -> int:
        """Return how often time may start again."""
        last = topics["/truth"].last
        return last[0] if last else 0


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
