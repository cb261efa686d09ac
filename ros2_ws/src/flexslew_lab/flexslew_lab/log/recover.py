"""A bag made whole again after a kill, a full disk, a cut or damage, and what is missing in it."""

import os
import shutil
import tempfile
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from mcap.records import Metadata

from flexslew_lab.log.bag_layout import METADATA_FILE, RUN_RECORD, TRIAL_RECORD
from flexslew_lab.log.bag_reader import BagReader, find_mcap
from flexslew_lab.log.files.bag_lock import LOCK_FILE, lock_folder, release_folder
from flexslew_lab.log.files.mcap_scan import (
    CHANNEL,
    CHUNK,
    METADATA,
    SCHEMA,
    McapRecord,
    RecordStream,
    chunk_content,
    chunk_records,
    has_checksum,
    read_record,
)
from flexslew_lab.log.files.read_limits import SizeCheck
from flexslew_lab.log.files.whole_file import write_whole
from flexslew_lab.log.messages import cdr
from flexslew_lab.log.messages.logged_text import logged_yaml
from flexslew_lab.log.messages.topic_lookup import Lookup
from flexslew_lab.log.recording.bag_writer import BagWriter, RecordingStopped
from flexslew_plant.counted import count_text
from flexslew_plant.errors import BadInput

_WHOLE = "the file was whole"


class Recovery(NamedTuple):
    """What was kept and what is missing."""

    source: Path
    out: Path
    kept: dict[str, int]  # messages by topic
    lost: dict[str, int]  # messages by topic that were recorded in between and are damaged
    reason: str  # why the file was not whole; empty if it was
    bytes_lost: int  # that could not be read
    chunks_lost: int  # damaged ones, left out
    last_time: float  # simulated time of the last truth [s]
    last_tick: int
    missing_ticks: int  # that the truth skips, before the first one, too
    unverified: int  # chunks without a checksum, kept as they are
    unrecorded_ticks: int | None  # from the last tick to the trial's end; None: unknown

    @property
    def statement(self) -> str:
        """The same in words."""
        kept = sum(self.kept.values())
        parts = [
            f"{count_text(kept, 'message')} kept, up to tick {self.last_tick} ({self.last_time:g} "
            "s)"
        ]
        lost = sum(self.lost.values())
        if not self.reason and not self.chunks_lost:
            parts.append("every record was whole" if lost or self.missing_ticks else _WHOLE)
        if self.reason:
            parts.append(f"{self.reason}: {count_text(self.bytes_lost, 'byte')} not readable")
        if self.chunks_lost:
            parts.append(f"{count_text(self.chunks_lost, 'damaged chunk')} left out")
        if lost:
            parts.append(f"{count_text(lost, 'message')} missing before the last")
        if self.unverified:
            parts.append(f"{count_text(self.unverified, 'chunk')} kept without a checksum")
        if self.missing_ticks:
            parts.append(f"{count_text(self.missing_ticks, 'tick')} missing before the last")
        if self.unrecorded_ticks:
            parts.append(
                f"{count_text(self.unrecorded_ticks, 'tick')} of the trial missing at the end"
            )
        return "; ".join(parts)


def recover(source: Path, out: Path | None = None) -> Recovery:
    """Return what became of a bag that was not finished or is damaged.

    Args:
        source: the bag's folder or file.
        out: folder of the new bag; default: in place, with the old file kept as `*.damaged`.

    Raises:
        BadInput: there is nothing to recover, another recorder still writes, it is foreign, or its
            folder cannot be written.
    """
    path = find_mcap(Path(source))
    metadata_path = path.parent / METADATA_FILE
    if out is None and metadata_path.is_dir():
        raise BadInput(f"{metadata_path}: is a folder; give another place with --out")
    if (path.parent / LOCK_FILE).exists():  # refuses while a recorder lives
        release_folder(lock_folder(path.parent), path.parent)
    BagReader(path)  # refuses what is foreign before anything is written
    # a name of its own: one that is known could be a link to elsewhere in a bag of a stranger
    try:
        temporary = tempfile.mkdtemp(dir=path.parent, prefix=".recovering.") if out is None else out
    except OSError as error:
        words = f"cannot be written: {error.strerror}; give another place with --out"
        raise BadInput(words, path.parent) from None
    target = Path(temporary)
    try:
        result = _copy(path, target)
    except BaseException:
        if out is None:
            shutil.rmtree(target, ignore_errors=True)
        raise
    if out is None:
        new = find_mcap(target)
        os.replace(path, path.with_suffix(".mcap.damaged"))
        os.replace(new, path)
        text = (target / METADATA_FILE).read_text(encoding="utf-8")
        write_whole(path.parent / METADATA_FILE, text.replace(new.name, path.name))
        shutil.rmtree(target)
        result = result._replace(out=path.parent)
    return result


class _MessageCounts:
    """Counts while messages are copied."""

    def __init__(self) -> None:
        self.kept: Counter[str] = Counter()
        self.lost: Counter[str] = Counter()
        self.sequence: dict[str, int] = {}
        self.tick, self.time = -1, 0.0
        self.missing, self.epoch = 0, 0

    def add(self, topic: str, sequence: int, data: bytes) -> None:
        self.kept[topic] += 1
        before = self.sequence.get(topic, 0)
        self.lost[topic] += max(sequence - before - 1, 0)
        self.sequence[topic] = sequence
        if topic != "/truth":
            return
        truth = cdr.decode("flexslew_msgs/msg/PlantState", data)
        if truth.epoch != self.epoch:
            self.epoch, self.tick = truth.epoch, -1
        self.missing += max(truth.tick - self.tick - 1, 0)
        self.tick = truth.tick
        self.time = truth.header.stamp.sec + truth.header.stamp.nanosec * 1e-9


def _copy(path: Path, target: Path) -> Recovery:
    """Write every message that is whole to a new bag."""
    stream, lookup, counts = RecordStream(path), Lookup(path, counted=False), _MessageCounts()
    writer: BagWriter | None = None
    trial: dict[str, str] = {}
    run: dict[str, str] = {}
    chunks_lost, reason, bytes_lost = 0, "", 0
    bare, size_check = 0, SizeCheck(path)  # chunks without a checksum; all of them
    try:
        for record in stream:
            if record.opcode == METADATA:
                found = read_record(Metadata, record.body, path)
                kept = found.metadata.items()
                plain = {k: v for k, v in kept if k not in ("format", "checksum")}
                if found.name == TRIAL_RECORD:
                    trial = plain
                elif found.name == RUN_RECORD:
                    run = plain
            elif record.opcode in (SCHEMA, CHANNEL):
                lookup.take(record)
            elif record.opcode == CHUNK:
                writer = writer or BagWriter(target, trial)
                bare += not has_checksum(record.body)
                try:
                    content = chunk_content(record.body, str(path))
                except BadInput:
                    chunks_lost += 1
                    continue
                size_check.add(len(content))
                _copy_chunk(content, lookup, writer, counts)
    except RecordingStopped:  # the new file has no room
        if writer is not None:
            with suppress(RecordingStopped):
                writer.close()
        raise
    except BadInput as error:  # damage that hides where the next record starts
        reason = error.refusal.why
        bytes_lost = path.stat().st_size - stream.at
    if stream.cut:
        reason, bytes_lost = stream.cut.reason, stream.cut.lost
    if writer is None:
        raise BadInput(f"nothing to recover: {reason or 'it holds no message'}", path)
    result = Recovery(
        path, target, dict(counts.kept), dict(+counts.lost), reason, bytes_lost, chunks_lost,
        counts.time, counts.tick, counts.missing, 0 if stream.checksum_valid else bare,
        _missing_ticks(trial, counts.tick),
    )  # fmt: skip
    unverified = {"unverified": str(result.unverified)} if result.unverified else {}
    writer.close({**run, **unverified, "recovered": result.statement})
    return result


def _copy_chunk(content: bytes, lookup: Lookup, writer: BagWriter, counts: _MessageCounts) -> None:
    for m in chunk_records(content, str(writer.path)):
        if isinstance(m, McapRecord):
            lookup.take(m)
        elif m.channel in lookup.channels:  # else its announcement was in a damaged chunk
            topic, kind = lookup.topic(m.channel)
            data = lookup.current(m)
            writer.write(topic, kind, data, m.stamp)
            counts.add(topic, m.sequence, data)


def _missing_ticks(trial: dict[str, str], tick: int) -> int | None:
    """Return how many ticks of the trial are behind the last one in the log."""
    try:
        settings = logged_yaml(trial.get("trial", ""), "trial")
        ticks = float(settings["duration"]) / float(settings.get("period", 0.01))
        return max(round(ticks) - tick, 0)
    except (BadInput, KeyError, TypeError, ValueError, ArithmeticError):
        return None
