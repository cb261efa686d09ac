"""A recorder on a small disk that is full in the middle of the run."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from flexslew_msgs.msg import Event
from flexslew_msgs.srv import SetRate

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.log.recording.bag_writer import RecordingStopped
from flexslew_lab.log.recover import recover
from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.run.run_trial import RunFeedback, run_trial
from flexslew_plant.graph.topics import EVENTS, TOPICS
from flexslew_plant.ros.offers import qos

from .bystander import beside
from .flight import Flight, slew

TICKS = 6000
SIZE = 300 * 1024  # of the disk [B], less than half of what the run would record
INSIDE = "FLEXSLEW_TEST_IN_NAMESPACE"


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Any]:
    """A file system of SIZE bytes; without the right to mount one, the test in a namespace."""
    folder = tmp_path / "run" / "bag"
    folder.mkdir(parents=True)
    mount = ["mount", "-t", "tmpfs", "-o", f"size={SIZE}", "tmpfs", str(folder)]
    done = subprocess.run(mount, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"no right to mount a tmpfs here: {done.stderr.strip()}")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)  # whoever is still in it


@pytest.fixture(autouse=True)
def _in_a_namespace(request: pytest.FixtureRequest) -> None:
    """Run the test again as root of a namespace of its own where it is not root."""
    if os.geteuid() == 0 or INSIDE in os.environ:
        return
    namespace = ["unshare", "--user", "--map-root-user", "--mount"]
    if subprocess.run([*namespace, "true"], capture_output=True, check=False).returncode:
        pytest.skip("neither root nor user namespaces: no right to mount a tmpfs here")
    test = f"{request.path}::{request.node.name}"
    again = [*namespace, sys.executable, "-m", "pytest", test]
    done = subprocess.run(
        again, env=os.environ | {INSIDE: "1"}, cwd=request.config.rootpath,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    pytest.skip("passed in a namespace of its own")


def wrong(bag: Path) -> dict[str, str]:
    """Return what is wrong with a log."""
    return {f.what: f.detail for f in check_log(bag) if not f.ok}


@pytest.mark.slow
def test_a_full_disk_ends_the_recording_and_not_the_run(small_disk: Any, tmp_path: Path) -> None:
    def listen(pids: Any, domain: int) -> None:
        with beside(domain) as bench:
            profile = qos(TOPICS[EVENTS])
            bench.node.create_subscription(Event, EVENTS, events.append, profile)
            bench.until(lambda: "recording_stopped" in [event.kind for event in events])
            assert bench.ask(SetRate, "set_rate", rate_factor=0.0).ok

    events: list[Event] = []
    trial = slew(0.01 * TICKS, 5.0, extra="max_missed: 100000")  # slow until DDS has found all
    flight = Flight(trial, small_disk.parent, 1, listen)
    (stopped,) = (event for event in events if event.kind == "recording_stopped")
    assert "recording stopped: No space left on device" in stopped.message
    assert f"{TICKS} ticks in" in flight.log  # the plant's last words
    assert flight.outcome.exit_code == 3
    assert "recorder ended during the run" in flight.outcome.message

    written = {path.name: path.read_bytes() for path in small_disk.iterdir()}
    assert {*written} == {"bag_0.mcap"}
    assert wrong(small_disk) == {
        "end of the file": "cut at byte "
        f"{len(written['bag_0.mcap'])}: the file ends between two records",
        "end of the run": "not written by the recorder",
    }
    metrics = metrics_of(small_disk)
    assert not metrics["log_complete"]
    assert 100 < metrics["ticks"] < 2500
    assert metrics["missing_ticks"] == 0

    with pytest.raises(RecordingStopped, match="No space left on device"):
        recover(small_disk)  # in place there is no room for it
    assert {path.name: path.read_bytes() for path in small_disk.iterdir()} == written
    recovery = recover(small_disk, tmp_path / "whole")
    assert recovery.last_tick == metrics["ticks"]
    assert recovery.unrecorded_ticks == TICKS - metrics["ticks"]
    assert list(BagReader(tmp_path / "whole").messages()) == list(BagReader(small_disk).messages())
    assert wrong(tmp_path / "whole") == {"end of the run": recovery.statement}


@pytest.mark.ros
def test_a_run_folder_that_is_removed_in_flight_is_a_fault(tmp_path: Path) -> None:
    trial = slew(30.0, 10.0, extra="max_missed: 100000")
    ticks: list[int] = []

    def progress(tick: int, last: int) -> None:
        if not ticks:
            shutil.rmtree(tmp_path / "run")
        ticks.append(tick)

    result = run_trial(
        trial, "test", tmp_path / "run", report=False, feedback=RunFeedback(progress)
    )
    assert result.exit_code == 3
    assert "recorder ended during the run" in result.message
    assert "bag_0.mcap: recording stopped: No such file or directory" in result.message
    assert ticks[-1] == 3000
