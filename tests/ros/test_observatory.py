"""The observatory over ROS 2: allocation and handover are the same bits as in process."""

from pathlib import Path

import pytest

from flexslew_lab.replay.resim import resim
from flexslew_lab.reproduce.scole_flights import example_values
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import trial_of_values

from .flight import Flight, patient

pytestmark = pytest.mark.ros


def test_thrusters_and_wheels_take_turns_to_the_same_bits(tmp_path: Path) -> None:
    goal = {"axis": [1.0, -2.0, 0.5], "angle": 2e-3}
    values = example_values("observatory", {}) | {
        "duration": 10.0,
        "goal_tolerance": 0.1,
        "plan": {"method": "reference_only", "goal": goal, "duration": 4.0},
        "schedule": [{"at": 5.0, "switch": "settling"}, {"at": 8.0, "switch": "pointing"}],
    }
    trial = trial_of_values(values, "t")
    flight = Flight(patient(trial), tmp_path / "ros")
    assert flight.outcome.exit_code == 0, flight.log
    here = run_trial(trial, "t", tmp_path / "here", in_process=True, report=False)
    assert flight.metrics["trajectory_hash"] == here.metrics["trajectory_hash"]
    assert flight.metrics["switches"] == 2
    assert resim(flight.bag).identical
