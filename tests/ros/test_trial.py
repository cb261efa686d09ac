"""A trial over ROS 2 with other names, against the clock, and with a recorder that is held up."""

import os
import signal
from collections import defaultdict
from pathlib import Path
from threading import Timer
from typing import Any

import pytest

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.log.messages.cdr import stamp_of
from flexslew_lab.replay.resim import resim
from flexslew_lab.run.run_trial import run_trial

from .flight import Flight, kill, slew

pytestmark = pytest.mark.ros

DISPLAY = ("/clock", "/joint_states", "/appendage_states", "/tf", "/markers")


@pytest.fixture(scope="module")
def in_process_hash(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("in_process") / "run"
    result = run_trial(slew(), "test", folder, in_process=True, report=False)
    return result.metrics["trajectory_hash"]


def test_nodes_by_any_other_name_fly_the_same(tmp_path: Path, in_process_hash: Any) -> None:
    names = {"plant": "testbed", "planner": "strategist", "recorder": "scribe"}
    flight = Flight(slew(), tmp_path, names=names)
    assert flight.outcome == (0, ""), flight.log
    assert flight.metrics["trajectory_hash"] == in_process_hash
    assert [finding for finding in check_log(flight.bag) if not finding.ok] == []


def test_a_paced_run_without_a_miss_is_bit_identical_too(
    tmp_path: Path, in_process_hash: Any
) -> None:
    flight = Flight(slew(rate=1.0), tmp_path)
    again = resim(flight.bag)  # what was missed is missed again
    assert again.identical
    assert flight.metrics["trajectory_hash"] == again.hash
    # a missed tick holds the last effort, which may be that of the answer
    assert flight.metrics["missed_ticks"] or again.hash == in_process_hash


def displayed(flight: Any) -> Any:
    """Return the stamps of all display messages by topic [ns]."""
    stamps = defaultdict(list)
    for m in BagReader(flight.bag).messages(DISPLAY):
        stamps[m.topic].append(stamp_of(TOPICS[m.topic].type, m.data, 0))
    return dict(stamps)


def test_a_recorder_that_was_held_up_has_every_display_message(tmp_path: Path) -> None:
    class Holding(Flight):
        """Stops the recorder from one report of progress to the next, half a second later."""

        def _progress(self, tick: int, last: int) -> None:
            if tick >= 100 and self._reports < 2:
                self._reports += 1
                kill("recorder", (signal.SIGSTOP, signal.SIGCONT)[self._reports - 1])(
                    self._supervisor.pids, self._domain
                )

        _reports = 0

    flight = Holding(slew(duration=30.0, rate=10.0), tmp_path)
    assert flight._reports == 2
    assert displayed(flight) == {topic: [k * 20_000_000 for k in range(1501)] for topic in DISPLAY}


def test_a_recorder_that_is_held_up_until_after_the_end_has_every_message(tmp_path: Path) -> None:
    def hold_up(pids: Any, domain: int) -> None:
        os.kill(pids["recorder"], signal.SIGSTOP)
        Timer(2.5, os.kill, (pids["recorder"], signal.SIGCONT)).start()

    trial = slew(duration=12.0, rate=10.0, extra="max_missed: 10000")
    flight = Flight(trial, tmp_path, 1, hold_up)
    assert displayed(flight) == {topic: [k * 20_000_000 for k in range(601)] for topic in DISPLAY}
    ticks = {
        topic: set(BagReader(flight.bag).columns(topic, {"tick"})["tick"].tolist())
        for topic in ("/truth", "/measurement", "/effort_command", "/controller_state")
    }
    assert ticks.pop("/truth") == set(range(1201))
    assert ticks == {topic: set(range(1200)) for topic in ticks}
