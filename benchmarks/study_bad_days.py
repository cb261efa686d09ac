"""Studies on bad days: killed whole, robbed of a process, out of disk, and flown again."""

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import numpy as np

from flexslew_lab.studies.finish import repeat_trial
from flexslew_lab.studies.store import Store
from flexslew_lab.studies.study import load_study

_STUDY = """
study: bad_days
trial: trial.yaml
seed: 7
sampling: {method: random, n: 400}
vary:
  testbed.parameters.bending_stiffness: {relative: {uniform: [-0.2, 0.2]}}
  sensors.joint_velocity.noise: {loguniform: [1.0e-5, 1.0e-3]}
compare: {active: [pd_feedforward, output_feedback]}
keep: {bags: none}
"""
_TRIAL = """
name: bad_day
duration: 10.0
testbed: {modes: 1}
plan: {method: none, goal: {base_yaw: 0.1, hub_pitch: 0.05}, duration: 2.0}
controllers: {pd_feedforward: {}, output_feedback: {}}
active: pd_feedforward
"""
_KILLS = 5
_FLOWN_AGAIN = 100
_SEED = 17
_SMALL, _LARGE = "400k", "64m"  # of the disk that is full, and of the same one later


def figures() -> dict[str, float]:
    """Return how often a bad day left nothing behind; every figure has to be its maximum.

    study_killed_same_table: of 5 kills of all processes at seeded moments, how many were survived
        by a table that is, byte for byte, that of an uninterrupted run after the last resume.
    study_worker_killed_same_table: 1 if a study that lost a process in the middle has that table.
    study_full_disk_same_table: 1 if a study stopped by a full disk said so, exit code 3, and has
        that table once there is room; 0 too where nobody may mount a small disk.
    study_flown_again_same_hash: of 100 random trials, by `study fly`.
    """
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "study.yaml").write_text(_STUDY)
        (folder / "trial.yaml").write_text(_TRIAL)
        started = perf_counter()
        table = _table(folder, "whole")
        seconds = perf_counter() - started
        return {
            "study_killed_same_table": _killed(folder, seconds, table),
            "study_worker_killed_same_table": _robbed(folder, seconds, table),
            "study_full_disk_same_table": _full_disk(folder, table),
            "study_flown_again_same_hash": _flown_again(folder),
        }


def _command(folder: Path, out: str) -> list[str]:
    run = [sys.executable, "-m", "flexslew_lab.cli.main", "study", "run"]
    return [*run, str(folder / "study.yaml"), "--workers", "2", "--out", str(folder / out)]


def _table(folder: Path, out: str) -> bytes:
    """Fly what is missing and return the table."""
    subprocess.run(_command(folder, out), check=True, capture_output=True)
    return (folder / out / "table.parquet").read_bytes()


def _interrupted(folder: Path, out: str, seconds: float, harm: Callable[[int], None]) -> bool:
    """Do harm to a running study after so many seconds; return whether it was still running."""
    with subprocess.Popen(
        _command(folder, out),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    ) as running:
        try:
            running.wait(seconds)
        except subprocess.TimeoutExpired:
            harm(running.pid)
            running.wait()
            return True
    return False


def _killed(folder: Path, seconds: float, table: bytes) -> float:
    rng = np.random.default_rng(_SEED)
    survived = 0
    for share in rng.uniform(0.3, 0.95, size=_KILLS):
        hit = _interrupted(
            folder, "killed", share * seconds, lambda pid: os.killpg(pid, signal.SIGKILL)
        )
        survived += hit
    return float(survived) if _table(folder, "killed") == table else 0.0


def _robbed(folder: Path, seconds: float, table: bytes) -> float:
    def rob(pid: int) -> None:
        """Kill the youngest process of the study's session, which flies."""
        listed = subprocess.run(
            ["ps", "-s", str(pid), "-o", "pid="], check=True, capture_output=True, text=True
        )
        os.kill(max(int(line) for line in listed.stdout.split()), signal.SIGKILL)

    hit = _interrupted(folder, "robbed", 0.6 * seconds, rob)
    return float(hit and _table(folder, "robbed") == table)


def _full_disk(folder: Path, table: bytes) -> float:
    """Run in a name space of mounts of its own, on a small disk that is then made larger."""
    (folder / "disk").mkdir()
    study = " ".join(_command(folder, "disk/study"))
    script = f"""
        mount -t tmpfs -o size={_SMALL} none {folder}/disk || exit 9
        {study} 2> {folder}/said; code=$?
        mount -o remount,size={_LARGE} {folder}/disk
        {study} && cp {folder}/disk/study/table.parquet {folder}/full.parquet
        exit $code
    """
    done = subprocess.run(
        ["unshare", "--mount", "--map-root-user", "sh", "-c", script], check=False
    )
    said = (folder / "said").read_text() if (folder / "said").is_file() else ""
    same = (folder / "full.parquet").is_file() and (folder / "full.parquet").read_bytes() == table
    return float(done.returncode == 3 and "no space left" in " ".join(said.split()) and same)


def _flown_again(folder: Path) -> float:
    store = Store(folder / "whole")
    study = load_study(store.folder / "study.yaml")
    numbers = store.table(["index", "trajectory_hash"]).to_pydict()
    flown = [i for i, h in zip(*numbers.values(), strict=True) if h is not None]
    rng = np.random.default_rng(_SEED)
    same = 0
    for number in rng.choice(flown, size=_FLOWN_AGAIN, replace=False).tolist():
        _, difference = repeat_trial(study, store, number, folder / "again" / str(number))
        same += not difference
    return float(same)


if __name__ == "__main__":
    for key, value in figures().items():
        print(f"{key:40s} {value:12.4g}")
