"""What is wrong with a log, if anything: damage, gaps, time, definitions, index."""

import json
import struct
from pathlib import Path
from typing import Any

from flexslew_lab.log.bag_layout import METADATA_FILE, RUN_RECORD
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.tick_check import Finding, check_ticks
from flexslew_lab.log.files.mcap_scan import RecordStream
from flexslew_lab.log.files.mcap_summary import STATISTICS, find_summary, summary_records
from flexslew_lab.log.files.read_limits import TEXT_KIND, most
from flexslew_lab.log.messages.logged_text import logged_yaml
from flexslew_plant.counted import count_text
from flexslew_plant.errors import BadInput
from flexslew_plant.events import RecordingEnded
from flexslew_plant.given_file import given_text

_DATA_END = 9 + 4  # bytes of the record that ends the data section


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
        return [Finding(False, "checksums, schemas and sequence", error.refusal.why)]
    counts = overview.counts
    words = f"{count_text(sum(counts.values()), 'message')} on {count_text(len(counts), 'topic')}"
    findings.append(Finding(True, "checksums, schemas and sequence", words))
    bare = overview.without_checksum
    words = f"changes there go undetected: {'; '.join(bare)}" if bare else "all of it"
    findings.append(Finding(not bare, "protected by checksums", words))
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
    run_record = overview.metadata.get(RUN_RECORD, {})
    findings.append(
        Finding(
            bool(run_record) and "recovered" not in run_record,
            "end of the run",
            run_record.get("recovered", "")
            or ("recorded" if run_record else "not written by the recorder"),
        )
    )
    try:
        findings += check_ticks(bag)
    except BadInput as error:
        findings.append(Finding(False, "ticks", error.refusal.why))
    drops = [e for e in overview.events if isinstance(e.what, RecordingEnded)]
    words = "; ".join(f"{e.time:g} s: {e.message}" for e in drops[:5]) or "none reported"
    findings.append(Finding(not drops, "drops", words))
    return findings


def _index(path: Path, messages: int) -> Finding:
    """Check the summary section against its CRC and against what was read."""
    data = RecordStream(path)
    for _ in data:
        pass
    try:
        summary = find_summary(path)
        if summary is None or summary.start != data.at + _DATA_END:
            return Finding(False, "index", "the footer is damaged; `log recover` makes it again")
        counts = [r.body for r in summary_records(summary) if r.opcode == STATISTICS]
        count = struct.unpack_from("<Q", counts[0])[0] if counts else 0
    except (BadInput, struct.error) as error:
        why = error.refusal.why if isinstance(error, BadInput) else str(error)
        return Finding(False, "index", why)
    if count != messages:
        words = f"it counts {count} messages, the file has {messages}"
        return Finding(False, "index", f"{words}; `log recover` makes it again")
    checksum_text = "checksum right" if summary.crc else "no checksum"
    return Finding(bool(summary.crc), "index", f"{checksum_text}, {messages} messages")


def _folder(path: Path, counts: dict[str, int]) -> Finding:
    """Check metadata.yaml against the file."""
    metadata_path = path.parent / METADATA_FILE
    if not metadata_path.exists():
        return Finding(False, METADATA_FILE, "missing; `log recover` makes it again")
    try:
        text = given_text(metadata_path, most(TEXT_KIND) + 1)
        information: Any = logged_yaml(text, METADATA_FILE)["rosbag2_bagfile_information"]
        metadata_counts = {
            t["topic_metadata"]["name"]: t["message_count"]
            for t in information["topics_with_message_count"]
            if t["message_count"]
        }
        if information["relative_file_paths"] != [path.name]:
            return Finding(False, METADATA_FILE, f"names another file than {path.name}")
    except (OSError, BadInput, LookupError, TypeError, AttributeError, ValueError) as error:
        return Finding(False, METADATA_FILE, f"not readable: {json.dumps(str(error))[:80]}")
    ok = metadata_counts == counts
    return Finding(ok, METADATA_FILE, "fits the file" if ok else "counts other messages")
