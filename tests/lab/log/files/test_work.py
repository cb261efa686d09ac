"""Small files that cost much time: what they unpack to is bounded by their size."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from time import process_time

import numpy as np
import pytest
from tests.present import present

from flexslew_lab.log.bag_index import BagIndex
from flexslew_lab.log.bag_layout import TOPICS, with_checksum
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.log.export import export_log
from flexslew_lab.log.files.mcap_file import McapFile
from flexslew_lab.log.files.mcap_scan import CHUNK_INDEX, chunk_records
from flexslew_lab.log.files.mcap_summary import Summary, find_summary, summary_records
from flexslew_lab.log.info import log_info
from flexslew_lab.log.messages.cdr import encode
from flexslew_lab.log.recording.bag_writer import BagWriter
from flexslew_lab.log.recover import recover
from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.replay.player import Player, PlaySettings
from flexslew_lab.report.run_data import read_run
from flexslew_plant.errors import BadInput, FlexslewError

from .test_bombs import announced, chunk_of, event, many, message

MIB = 1 << 20
SMALL = 100_000  # of a file [B]
PATIENCE = 30.0  # with all that reads a small file, together [s of processor time]


def encoded(topic: str, **fields: object) -> bytes:
    return encode(TOPICS[topic].type, fields)


def sizes() -> bytes:
    """Truths whose arrays change size with every message."""
    rows = [encoded("/truth", position=np.zeros(n)) for n in range(50)]
    return announced("/truth") + b"".join(message(rows[n % 50], n + 1) for n in range(9_000))


def numbered(first: int, count: int, topic: str, **fields: object) -> bytes:
    return many(topic, encoded(topic, **fields), count, first)


DENSE = f"a: [{'1,' * 100_000}]"
ZEROS = chunk_of(bytes(60 * MIB))
BOMBS: dict[str, Callable[[], bytes]] = {
    "zeros": lambda: ZEROS * (SMALL // len(ZEROS)),
    "empty messages": lambda: chunk_of(many("/events", b"", 20_000)),
    "empty ticks": lambda: chunk_of(numbered(0, 12_000, "/measurement")),
    "events": lambda: chunk_of(many("/events", event(), 6_000)),
    "sizes": lambda: chunk_of(sizes()),
    "statuses": lambda: b"".join(
        chunk_of(numbered(20 * n, 20, "/controller_status", settings=f"{DENSE}  # {n}"))
        for n in range(50)
    ),
    "plans": lambda: b"".join(
        chunk_of(numbered(20 * n, 20, "/plan", request=DENSE, hash=str(n))) for n in range(50)
    ),
    "tiny chunks": lambda: chunk_of(b"") * (SMALL // len(chunk_of(b"")) - 10),
    "tiny records": lambda: b"\x09\0\0\0\0\0\0\0\0" * (SMALL // 9 - 100),
}


def file_of(path: Path, records: bytes) -> Path:
    file = McapFile(path)
    file.add_metadata("flexslew", with_checksum({"trial": "name: bomb"}))
    file._write(records)
    file.close()
    return path


READERS: tuple[Callable[[Path, Path], object], ...] = (
    lambda bag, out: log_info(bag),
    lambda bag, out: check_log(bag),
    lambda bag, out: metrics_of(bag),
    lambda bag, out: read_run(bag),
    lambda bag, out: Player(PlaySettings(bag=str(bag))),
    lambda bag, out: export_log(bag, out / "tables"),
    lambda bag, out: recover(bag, out / "recovered"),
)


@pytest.mark.first(3)
@pytest.mark.parametrize("bomb", BOMBS)
def test_a_small_file_takes_no_minute(tmp_path: Path, bomb: str) -> None:
    bag = file_of(tmp_path / "bomb.mcap", BOMBS[bomb]())
    assert bag.stat().st_size < 1.2 * SMALL
    began = process_time()
    for read in READERS:
        with suppress(FlexslewError):
            read(bag, tmp_path)
    assert process_time() - began < PATIENCE


@pytest.mark.parametrize("kind", [0, 2, 6, 7, 15, 0x80])
def test_a_chunk_holds_schemas_channels_and_messages_alone(kind: int) -> None:
    with pytest.raises(BadInput, match=f"it holds a record of kind {kind}"):
        list(chunk_records(bytes([kind]) + bytes(8 + 40), "test"))


def test_an_index_names_no_chunk_twice(tmp_path: Path) -> None:
    """Else a few bytes for each of them would be a pass over all of its messages."""
    with BagWriter(tmp_path / "bag", {"trial": "name: bomb"}, chunk_size=1 << 10) as writer:
        for n in range(100):
            writer.write("/events", TOPICS["/events"].type, event(), n)
    BagIndex(tmp_path / "bag")
    path = writer.path
    content = bytearray(path.read_bytes())
    start = present(find_summary(path)).start
    at = [r.offset for r in summary_records(Summary(path, start, len(content) - 37, 0))]
    entries = [k for k in at if content[k] == CHUNK_INDEX]
    size = entries[1] - entries[0]
    content[entries[1] : entries[1] + size] = content[entries[0] : entries[0] + size]
    content[-12:-8] = bytes(4)  # a summary without a checksum
    path.write_bytes(content)
    with pytest.raises(BadInput, match="its index names a chunk twice"):
        BagIndex(path)
