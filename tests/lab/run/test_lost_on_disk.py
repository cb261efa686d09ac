"""What is not on the disk at the end of a run is said, with exit code 3."""

import errno
import os
import resource
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from flexslew_lab.cli.main import main
from flexslew_lab.log.recording.bag_observer import BagObserver
from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.run.run_trial import Result, RunFeedback, run_trial
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.bench.bench import Truth

TRIAL = """
name: short
duration: 20.0
plan: {method: none, goal: {base_yaw: 0.01}, duration: 1.0}
"""


def flown(tmp_path: Path, then: Callable[[], None], report: bool = False) -> Result:
    """Fly 2000 ticks; in the middle of them, something happens."""
    trial = parse_trial(TRIAL, "test")

    def progress(tick: int, last: int) -> None:
        if tick == 1000:
            then()

    return run_trial(trial, "test", tmp_path / "run", True, report, RunFeedback(progress))


def test_a_folder_that_is_removed_in_flight_is_a_fault(tmp_path: Path) -> None:
    result = flown(tmp_path, lambda: shutil.rmtree(tmp_path / "run"), report=True)
    assert result.exit_code == 3
    assert "bag_0.mcap: recording stopped: No such file or directory" in result.message
    assert result.metrics == {}


@pytest.mark.parametrize("again", [False, True])
def test_a_file_that_is_removed_in_flight_is_a_fault(tmp_path: Path, again: bool) -> None:
    bag = tmp_path / "run" / "bag" / "bag_0.mcap"

    def replace() -> None:
        bag.unlink()
        if again:
            bag.write_bytes(b"")

    result = flown(tmp_path, replace)
    assert result.exit_code == 3
    words = "another file has taken its place" if again else "No such file or directory"
    assert f"bag_0.mcap: recording stopped: {words}" in result.message


def test_a_folder_that_is_moved_in_flight_is_a_fault_and_loses_no_tick(tmp_path: Path) -> None:
    def move() -> None:
        (tmp_path / "run").rename(tmp_path / "moved")

    result = flown(tmp_path, move)
    assert result.exit_code == 3
    assert metrics_of(tmp_path / "moved" / "bag")["missing_ticks"] == 0


def test_the_command_line_says_what_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "trial.yaml", tmp_path / "run"
    file.write_text(TRIAL)
    truth = BagObserver.truth

    def removing(observer: BagObserver, seen: Truth) -> None:
        truth(observer, seen)
        if seen.tick == 1000:
            shutil.rmtree(out)

    monkeypatch.setattr(BagObserver, "truth", removing)
    words = ["trial", str(file), "--in-process", "--no-report", "--json", "--out", str(out)]
    monkeypatch.setattr(sys, "argv", ["flexslew", *words])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 3
    assert "recording stopped: No such file or directory" in capsys.readouterr().err


def test_a_full_disk_ends_the_recording_and_not_the_run(tmp_path: Path) -> None:
    """No file may grow beyond 100 kB: to the recorder the same as a disk that is full."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    ticks: list[int] = []
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
        trial = parse_trial(TRIAL, "test")
        result = run_trial(
            trial,
            "test",
            tmp_path / "run",
            True,
            True,
            RunFeedback(lambda tick, last: ticks.append(tick)),
        )
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert result.exit_code == 3
    assert ticks[-1] == 2000
    assert f"recording stopped: {os.strerror(errno.EFBIG)}" in result.message
    assert 100 < result.metrics["ticks"] < 1900
    assert not result.metrics["log_complete"]
