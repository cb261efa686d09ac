"""A linear plant of 270 states from a file over ROS 2: the same bits as in process."""

from pathlib import Path

import numpy as np
import pytest

from flexslew_lab.replay.resim import resim
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.own_code import ANY_CODE
from tests.linear_plants import SPACE_STATION, drawn_plant

from .flight import Flight, patient
from .lines import alone

pytestmark = pytest.mark.ros
TRIAL = """
name: linear_plant
duration: 2.0
testbed: {{kind: linear, file: {file}, effort_limit: [10.0, 10.0, 10.0]}}
plan: {{method: reference_only, goal: {{joint_1: 0.001}}, duration: 1.0, model: {{kept_modes: 3}}}}
controllers:
  pd_feedforward: {{kp: 1.0, kd: 0.5}}
"""


def test_a_plant_of_many_states_flies_over_ros_as_in_process(tmp_path: Path) -> None:
    plant = drawn_plant(*SPACE_STATION)
    np.savez(tmp_path / "station.npz", A=plant.a, B=plant.b, C=plant.c)
    text = TRIAL.format(file=tmp_path / "station.npz")
    trial = patient(parse_trial(text, "station.yaml", ANY_CODE))
    flight = Flight(trial, tmp_path / "ros")
    assert flight.outcome.exit_code == 0, flight.log
    assert flight.metrics["trajectory_hash"] == alone(trial, tmp_path)
    (tmp_path / "station.npz").unlink()
    assert resim(flight.bag).identical
