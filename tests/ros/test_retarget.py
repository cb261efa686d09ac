"""An antenna that gets a new target by service flies as one whose schedule says so."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.replay.resim import resim
from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_lab.ros.operator import connected
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import SavedPlan

from .bystander import PATIENCE
from .flight import Flight

SHORT: dict[str, Any] = {"duration": 6.0, "answer_timeout": 20.0, "display_rate": 0.0}
MAST = "{appendage: mast, to: 0.1, duration: 1.0}"
TURN = {"appendage": "beam", "to": 1.2, "duration": 0.5}
SIGHT = {"appendage": "beam", "line_of_sight": [0.0, 0.6, 0.8], "duration": 0.4}


@pytest.mark.slow
def test_targets_by_service_are_those_of_a_schedule_and_fly_again(tmp_path: Path) -> None:
    def by_hand(pids: Any, domain: int) -> None:
        with connected(domain, patience=PATIENCE) as bench:
            answers.append(bench.retarget(MAST, 4.0))
            answers.append(bench.retarget(str(TURN), 4.0))
            answers.append(bench.retarget(str(SIGHT), 4.2))
            answers.append(bench.retarget(str(SIGHT), 4.5))
            answers.append(bench.act("start"))

    answers: list[Any] = []
    flight = Flight(example_trial("antenna_4", SHORT), tmp_path, begin=by_hand)
    assert flight.outcome == (0, "")
    assert [reply.ok for reply in answers] == [False, True, False, True, True], answers
    assert "appendage: mast is not allowed" in answers[0].message
    assert "before the last one ends" in answers[2].message
    told = [e.data for e in BagReader(flight.bag).overview.events if e.kind == "retargeted"]
    assert [data["start"] for data in told] == [2000, 2250]
    assert all(data["who"] for data in told)
    again = resim(flight.bag)
    assert again.replayed["retargeted"] == 2
    assert again.first_difference is None
    assert [finding for finding in check_log(flight.bag) if not finding.ok] == []
    entries = [{"at": 4.0, "retarget": TURN}, {"at": 4.5, "retarget": SIGHT}]
    plan = SavedPlan(file=str(flight.folder / "plan.yaml"))  # as made before anybody knew
    known = replace(example_trial("antenna_4", {**SHORT, "schedule": entries}), plan=plan)
    metrics = run_trial(known, "test", tmp_path / "known", in_process=True, report=False).metrics
    assert metrics["trajectory_hash"] == flight.metrics["trajectory_hash"] == again.hash
