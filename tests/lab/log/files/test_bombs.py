"""Files that claim, or unpack to, more than a reader has: one line, and little memory."""

import json
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from contextvars import copy_context
from typing import Any

import numpy as np
import pytest
import zstandard
from mcap.records import Channel, Metadata, Schema

from flexslew_lab.log.bag_layout import TOPICS, with_checksum
from flexslew_lab.log.files.mcap_file import McapFile, record_bytes
from flexslew_lab.log.files.mcap_scan import chunk_content
from flexslew_lab.log.files.read_limits import read_at_most
from flexslew_lab.log.messages.cdr import encode
from flexslew_lab.log.messages.logged_text import logged_yaml
from flexslew_lab.log.messages.schemas import schema_text
from flexslew_plant.errors import BadInput

MIB = 1 << 20
pytestmark = pytest.mark.timeout(900)  # where many share the processors
MOST = 500 * MIB  # of a process that reads any file

READ = """
import json, sys
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.log.export import export_log
from flexslew_lab.log.info import log_info
from flexslew_lab.log.recover import recover
from flexslew_lab.replay.player import Player, PlaySettings
from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.report.run_data import read_run
from flexslew_plant.errors import FlexslewError
from pathlib import Path

said = {}
for path in map(Path, sys.argv[1:]):
    out = path.parent / path.stem
    for action in (
        check_log, metrics_of, log_info, read_run,
        lambda path: Player(PlaySettings(bag=str(path))),
        lambda path: export_log(path, out / "tables"),
        lambda path: recover(path, out / "recovered"),
    )[: 2 if path.stem.startswith("many_") else None]:
        try:
            found = action(path)
            if action is check_log:
                said[path.stem] = [finding.detail for finding in found if not finding.ok][0]
        except FlexslewError as error:
            assert len(str(error).splitlines()) == 1
words = Path("/proc/self/status").read_text().split()
print(json.dumps({"said": said, "peak": int(words[words.index("VmHWM:") + 1]) * 1024}))
"""


def announced(topic: str) -> bytes:
    kind = TOPICS[topic].type
    schema = Schema(id=1, name=kind, encoding="ros2msg", data=schema_text(kind).encode())
    channel = Channel(id=1, topic=topic, message_encoding="cdr", metadata={}, schema_id=1)
    return record_bytes(schema) + record_bytes(channel)


def message(data: bytes, number: int) -> bytes:
    return struct.pack("<BQHIQQ", 5, 22 + len(data), 1, number, number, number) + data


def chunk_of(raw: bytes, claimed: int | None = None, frame: bytes = b"") -> bytes:
    """Return a chunk record; `claimed` is the size that it says its content has."""
    data = frame or zstandard.ZstdCompressor(write_content_size=claimed is None).compress(raw)
    size = len(raw) if claimed is None else claimed
    body = struct.pack("<QQQI", 1, 1 << 40, size, zlib.crc32(raw))
    body += struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(data)) + data
    return struct.pack("<BQ", 6, len(body)) + body


def many(topic: str, data: bytes, count: int, before: int = 0) -> bytes:
    numbers = range(before + 1, before + count + 1)
    return announced(topic) + b"".join(message(data, n) for n in numbers)


def event(kind: str = "missed", data: str = "{}") -> bytes:
    return encode(TOPICS["/events"].type, {"kind": kind, "data": data})


HUGE_FRAME = struct.pack("<IBQ", 0xFD2FB528, 0xE0, 8 << 30) + b"\x01\x00\x00"
LONG = event("other", f'{{"a": [{"[]," * 80_000}0]}}')
BOMBS: dict[str, tuple[Callable[[], bytes], str]] = {
    "claims": (lambda: chunk_of(b"x", 3 << 30), "a chunk of 3072.0 MiB, the limit is 64"),
    "frame": (lambda: chunk_of(b"x", frame=HUGE_FRAME), "it claims 1 bytes and 8589934592"),
    "honest": (lambda: chunk_of(bytes(256 * MIB)), "a chunk of 256.0 MiB, the limit is 64"),
    "many_empty": (lambda: chunk_of(many("/events", b"", 400_000)), "0 bytes are not a"),
    "many_truths": (
        lambda: chunk_of(many("/truth", encode(TOPICS["/truth"].type, {}), 100_000)),
        "the file ends between two records",
    ),
    "long_truth": (
        lambda: chunk_of(
            many("/truth", encode(TOPICS["/truth"].type, {"position": np.zeros(3 * MIB // 4)}), 1)
        ),
        "the file ends between two records",
    ),
    "many_events": (
        lambda: b"".join(chunk_of(many("/events", event(), 50_000, 50_000 * n)) for n in range(6)),
        "events, plans and statuses of 64.0 MiB, the limit is 64",
    ),
    "long_events": (
        lambda: b"".join(chunk_of(many("/events", LONG, 20, 20 * n)) for n in range(3)),
        "unpacks to more than 8.3 MiB, 64 times its size",
    ),
    "metadata": (
        lambda: record_bytes(
            Metadata(name="flexslew_run", metadata={f"{k:x}": "" for k in range(300_000)})
        ),
        "a metadata record of 3.",
    ),
    "definition": (
        lambda: record_bytes(
            Schema(id=1, name="x/msg/X", encoding="ros2msg", data=b"int8 a\n" * MIB)
        ),
        "a message definition of 7.0 MiB, the limit is 1",
    ),
    "topics": (
        lambda: b"".join(
            record_bytes(
                Channel(id=k, topic=f"/{k}", message_encoding="", metadata={}, schema_id=0)
            )
            for k in range(1, 500)
        ),
        "more than 256 topics",
    ),
    "record": (lambda: struct.pack("<BQ", 9, 5 << 30), "a record of 5368709120 bytes is cut"),
}


@pytest.mark.slow
def test_no_file_takes_much_memory_and_each_is_refused_in_one_line(tmp_path: Any) -> None:
    for name, (records, _) in BOMBS.items():
        file = McapFile(tmp_path / f"{name}.mcap")
        file.add_metadata("flexslew", with_checksum({"trial": "name: bomb"}))
        file._write(records())
        file.close()
    words = [sys.executable, "-c", READ, *map(str, tmp_path.glob("*.mcap"))]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    for name, (_, expected) in BOMBS.items():
        assert expected in found["said"][name]
    assert found["peak"] < MOST


def test_the_limit_is_an_option() -> None:
    raw = chunk_of(bytes(80 * MIB))[9:]
    with pytest.raises(BadInput, match=r"a chunk of 80\.0 MiB, the limit is 64; .*--largest-chunk"):
        chunk_content(raw, "test")

    def read() -> int:
        read_at_most(100 * MIB)
        return len(chunk_content(raw, "test"))

    assert copy_context().run(read) == 80 * MIB


def test_the_limit_of_a_text_grows_with_that_of_a_chunk() -> None:
    text = f"a: {'x' * MIB}"
    with pytest.raises(BadInput, match=r"a YAML or JSON text of 1\.0 MiB, the limit is 1; "):
        logged_yaml(text, "log")

    def with_larger_limit() -> dict[str, Any]:
        read_at_most(128 * MIB)
        return logged_yaml(text, "log")

    assert len(copy_context().run(with_larger_limit)["a"]) == MIB
