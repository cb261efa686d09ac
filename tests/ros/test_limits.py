"""Much of everything, and little of what a machine should have; see docs/limits.md."""

import json
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import parse_trial

from .bystander import beside, stall
from .flight import Flight, slew
from .namespace import in_a_namespace

pytestmark = pytest.mark.ros

DISPLAY = ("/clock", "/joint_states", "/appendage_states", "/tf", "/markers")
MUCH = """
name: much
duration: 0.5
period: 0.001
display_rate: 1000.0
answer_timeout: 60.0
testbed: {modes: 12}
controllers: {%s}
active: c0
schedule: [{at: 0.25, switch: c19}]
"""
TRIAL = "{name: little, duration: 2.0, controllers: {pd_feedforward: {}}}"
FLY = """
mount -t tmpfs -o size=$1 tmpfs /dev/shm && shift && exec "$@"
"""


def test_twenty_controllers_twelve_modes_and_a_display_of_one_kilohertz(tmp_path: Path) -> None:
    names = [f"c{number}" for number in range(20)]
    trial = parse_trial(MUCH % ", ".join(f"{n}: {{law: pd_feedforward}}" for n in names), "test")
    alone = run_trial(trial, "test", tmp_path / "alone", in_process=True, report=False)
    flight = Flight(trial, tmp_path / "ros")
    assert flight.outcome == (0, ""), flight.log
    assert flight.metrics["trajectory_hash"] == alone.metrics["trajectory_hash"]
    assert (flight.metrics["switches"], flight.metrics["missed_ticks"]) == (1, 0)
    assert [finding for finding in check_log(flight.bag) if not finding.ok] == []
    bag = BagReader(flight.bag)
    assert {bag.overview.counts[topic] for topic in DISPLAY} == {501}
    statuses = bag.decode_messages(("/controller_status",))
    assert {*Counter(status.controller for _, _, status in statuses)} == {*names}


@pytest.mark.parametrize(("stalled", "missed"), [(0.5, False), (3.0, True)])
def test_silence_is_missed_after_the_answer_timeout_and_not_before(
    stalled: float, missed: bool, tmp_path: Path
) -> None:
    def hold_up(pids: dict[str, int], domain: int) -> None:
        with beside(domain) as bench:
            bench.pass_by(1)
            stall(pids["pd_feedforward"], stalled)
            bench.pass_by(5)
        raise KeyboardInterrupt

    patience = {False: 30.0, True: 1.0}[missed]
    trial = replace(slew(10_000.0, extra="max_missed: 100000"), answer_timeout=patience)
    flight = Flight(trial, tmp_path, 1, hold_up)
    assert flight.outcome.exit_code == 130
    assert (flight.metrics["missed_ticks"] > 0) == missed


@pytest.mark.parametrize(("size", "code"), [("4k", 2), ("64k", 0)])
def test_a_small_shared_memory_is_enough_or_is_named(size: str, code: int, tmp_path: Path) -> None:
    trial, run = tmp_path / "little.yaml", tmp_path / "run"
    trial.write_text(TRIAL)
    command = [sys.executable, "-m", "flexslew_lab.cli.main", "trial", str(trial)]
    done = in_a_namespace(FLY, size, *command, "--no-report", "--out", str(run))
    assert done.returncode == code, done.stdout + done.stderr
    if code:
        assert "/dev/shm: 4096 bytes are free" in done.stderr
        assert done.stderr.count("\n") == 1
        assert not run.exists()
    else:
        metrics: dict[str, Any] = json.loads((run / "metrics.json").read_text())
        assert (metrics["ticks"], metrics["missed_ticks"]) == (200, 0)
        assert metrics["log_complete"]
