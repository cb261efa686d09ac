"""A recorder on a small disk that is full in the middle of the run."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from flexslew_msgs.msg import Event

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.log.recording.bag_writer import RecordingStopped
from flexslew_lab.log.recover import recover
from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.run.run_trial import run_trial
from flexslew_plant.graph.topics import EVENTS, TOPICS
from flexslew_plant.ros.offers import qos

from .flight import Flight, slew

TICKS = 30000  # some seconds, in which DDS finds who listens
SIZE = 300 * 1024  # of the disk [B], about a third of what the run would record
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


def hear(kind: str, pid: int, domain: int) -> list[str]:
    """Return what the events of this kind say, as soon as there is one, or when the pid is gone."""
    rclpy.init(domain_id=domain)
    node = rclpy.create_node("bystander")
    found: list[str] = []
    try:
        events = qos(TOPICS[EVENTS])

        def listen(event: Event) -> None:
            if event.kind == kind:
                found.append(event.message)

        node.create_subscription(Event, "/events", listen, events)
        while not found and Path(f"/proc/{pid}").exists():
            rclpy.spin_once(node, timeout_sec=0.2)
        return found
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def wrong(bag: Path) -> dict[str, str]:
    """Return what is wrong with a log."""
    return {f.what: f.detail for f in check_log(bag) if not f.ok}


def test_a_full_disk_ends_the_recording_and_not_the_run(small_disk: Any, tmp_path: Path) -> None:
    def listen(pids: Any, domain: int) -> None:
        heard.extend(hear("recording_stopped", pids["recorder"], domain))

    heard: list[str] = []
    flight = Flight(slew(duration=0.01 * TICKS), small_disk.parent, 1, listen)
    assert len(heard) == 1
    assert "recording stopped: No space left on device" in heard[0]
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


def test_a_run_folder_that_is_removed_in_flight_is_a_fault(tmp_path: Path) -> None:
    trial = slew(duration=0.01 * TICKS)
    ticks: list[int] = []

    def progress(tick: int, last: int) -> None:
        if not ticks:
            shutil.rmtree(tmp_path / "run")
        ticks.append(tick)

    result = run_trial(trial, "test", tmp_path / "run", report=False, progress=progress)
    assert result.exit_code == 3
    assert "recorder ended during the run" in result.message
    assert "bag_0.mcap: recording stopped: No such file or directory" in result.message
    assert ticks[-1] == TICKS
