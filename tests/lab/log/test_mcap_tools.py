"""What the MCAP command lines of others say of our bags, whole and damaged."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from flexslew_lab.log.recording.bag_writer import BagWriter
from flexslew_lab.log.recover import recover

Message = tuple[str, bytes, int]
PYMCAP = Path(sys.executable).with_name("pymcap-cli")
MCAP = shutil.which("mcap")

needs_pymcap = pytest.mark.skipif(
    not PYMCAP.exists(),
    reason="no pymcap-cli, a tool under the GPL: .ci/tools installs it with others for development",
)
needs_mcap = pytest.mark.skipif(
    MCAP is None,
    reason="no mcap on PATH: take its release from the project foxglove/mcap, or build its "
    "rust/cli with cargo",
)


def mcap_file(folder: Path) -> Path:
    return next(folder.glob("*.mcap"))


def run(*words: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(list(map(str, words)), capture_output=True, text=True, check=False)


def pymcap_findings(file: Path) -> dict[str, str]:
    """Return the severity of each finding of pymcap-cli's doctor by its code."""
    lines = run(PYMCAP, "doctor", "--strict-message-order", "--format", "jsonl", file).stdout
    records = [json.loads(line) for line in lines.splitlines()]
    (summary,) = [r for r in records if r["type"] == "summary"]
    assert summary["complete"]
    return {r["code"]: r["severity"] for r in records if r["type"] == "finding"}


@pytest.fixture(scope="module")
def files(
    bag: Path, write_bag: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Path]:
    """Return bags that were closed, recovered after a cut, and closed without a message."""
    root = tmp_path_factory.mktemp("tools")
    cut = mcap_file(write_bag(root / "recovered"))
    cut.write_bytes(cut.read_bytes()[: cut.stat().st_size // 2])
    recover(cut)
    BagWriter(root / "empty", {"trial": ""}).close()
    return {
        "closed": mcap_file(bag),
        "recovered": mcap_file(root / "recovered"),
        "empty": mcap_file(root / "empty"),
    }


@pytest.mark.slow
@needs_pymcap
@pytest.mark.parametrize("name", ["closed", "recovered", "empty"])
def test_pymcap_finds_no_fault_in_our_bags(files: dict[str, Path], name: str) -> None:
    assert set(pymcap_findings(files[name]).values()) == {"info"}  # no attachments, no messages


@pytest.mark.slow
@needs_pymcap
def test_pymcap_finds_a_flipped_bit_and_a_cut(bag: Path, tmp_path: Path) -> None:
    whole = mcap_file(bag).read_bytes()
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(whole[:20_000] + bytes([whole[20_000] ^ 1]) + whole[20_001:])
    assert pymcap_findings(damaged)["DATA_SECTION_CRC_MISMATCH"] == "error"
    damaged.write_bytes(whole[:20_000])
    assert pymcap_findings(damaged)["MISSING_FOOTER"] == "error"


@needs_pymcap
def test_pymcap_counts_our_messages(bag: Path, messages: list[Message]) -> None:
    statistics = json.loads(run(PYMCAP, "info-json", mcap_file(bag)).stdout)
    assert statistics["header"] == {"library": "flexslew", "profile": "ros2"}
    counts = {c["topic"]: c["message_count"] for c in statistics["channels"]}
    topics = [topic for topic, _, _ in messages]
    assert counts == {topic: topics.count(topic) for topic in topics}


@needs_mcap
@pytest.mark.parametrize("name", ["closed", "recovered", "empty"])
def test_mcap_finds_no_fault_in_our_bags(files: dict[str, Path], name: str) -> None:
    assert MCAP
    doctor = run(MCAP, "doctor", "--strict-message-order", files[name])
    assert (doctor.returncode, doctor.stdout, doctor.stderr) == (0, "", "")


@needs_mcap
def test_mcap_counts_our_messages(bag: Path, messages: list[Message]) -> None:
    assert MCAP
    lines = run(MCAP, "info", mcap_file(bag)).stdout.splitlines()
    (counted,) = [line.split()[1] for line in lines if line.startswith("messages:")]
    assert int(counted) == len(messages)
