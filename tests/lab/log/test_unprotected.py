"""Checksums that are zero: MCAP allows them, and then a changed number shows nowhere."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.log.recover import recover
from flexslew_lab.metrics.from_bag import metrics_of

Write = Callable[..., Path]


def without_checksums(path: Path, chunks: bool, data_section: bool) -> Path:
    """Set checksums of a bag to zero, and keep that over all data right unless it is zero too."""
    data, at = bytearray(path.read_bytes()), 8
    while data[at] != 0x0F:
        length = int.from_bytes(data[at + 1 : at + 9], "little")
        if data[at] == 6 and chunks:
            data[at + 9 + 24 : at + 9 + 28] = bytes(4)
        at += 9 + length
    crc = 0 if data_section else zlib.crc32(data[:at])
    data[at + 9 : at + 13] = struct.pack("<I", crc)
    path.write_bytes(data)
    return path


def wrong(path: Path) -> dict[str, str]:
    return {f.what: f.detail for f in check_log(path) if not f.ok}


@pytest.fixture
def file(tmp_path: Path, write_bag: Write) -> Path:
    return next(write_bag(tmp_path / "run").glob("*.mcap"))


def test_a_whole_bag_is_protected(file: Path) -> None:
    assert wrong(file) == {}
    assert metrics_of(file)["warnings"] == []


def test_chunks_and_data_without_a_checksum_are_named_and_the_metrics_warn(file: Path) -> None:
    without_checksums(file, chunks=True, data_section=True)
    found = wrong(file)["protected by checksums"]
    count = BagReader(file).overview.without_checksum[0].split()[0]
    assert int(count) > 3
    assert f"{count} chunks without a checksum, the first at byte " in found
    assert "the data section has no checksum" in found
    warnings = metrics_of(file)["warnings"]
    assert len(warnings) == 2
    assert all(words.startswith("changes go undetected: ") for words in warnings)


def test_chunks_without_one_are_protected_by_that_of_the_data_section(file: Path) -> None:
    without_checksums(file, chunks=True, data_section=False)
    assert wrong(file) == {}
    assert metrics_of(file)["warnings"] == []


def test_a_recovered_bag_does_not_forget_that_its_source_was_not_protected(
    file: Path, tmp_path: Path
) -> None:
    without_checksums(file, chunks=True, data_section=True)
    file.write_bytes(file.read_bytes()[:-200])
    recovery = recover(file, tmp_path / "new")
    assert recovery.unverified > 3
    assert f"{recovery.unverified} chunks kept without a checksum" in recovery.statement
    assert "protected by checksums" in wrong(tmp_path / "new")
    assert len(metrics_of(tmp_path / "new")["warnings"]) == 1


def test_the_summary_without_a_checksum_is_named(file: Path) -> None:
    data = bytearray(file.read_bytes())
    data[-12:-8] = bytes(4)
    file.write_bytes(data)
    assert "no checksum" in wrong(file)["index"]
