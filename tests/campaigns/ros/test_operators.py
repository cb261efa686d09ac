"""An operator at a bench that flies, who does anything: the answers, the log, the flight again."""

import re
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexslew_lab.log.checks.check import check_log
from flexslew_lab.replay.resim import resim
from flexslew_lab.trial.trial import parse_trial
from tests.ros.flight import Flight

from .operators.bench import operated
from .operators.desk import Habits
from .operators.random_operator import RandomOperator

pytestmark = pytest.mark.ros

ACTS = 40  # of a case
FLIGHT = """
name: operated
duration: 100000.0
rate_factor: 3.0
answer_timeout: 0.5
allow_faults: true
fallback: [lqr, pd_feedforward]
"""
TWO_MOTORS = """
plan: {method: reference_only, goal: {base_yaw: 0.1, hub_pitch: 0.05}, duration: 5.0}
controllers:
  pd_feedforward: {kp: [460.0, 460.0], kd: [920.0, 920.0]}
  lqr: {}
  output_feedback: {}
"""
ANTENNA = """
testbed:
  kind: spacecraft
  platform: {mass: 200.0, inertia: {xx: 35.0, yy: 30.0, zz: 32.0}}
  appendages:
    dish:
      hinge:
        place: [0.0, 0.0, 0.6]
        axis: [1.0, 0.0, 0.0]
        motion: {to: 0.2, duration: 2.0, profile: smooth}
        range: [-0.6, 0.6]
      shape:
        kind: beam
        length: 2.0
        linear_density: 1.0
        bending_stiffness: 40.0
        modes_across: 0
        modes_third: 1
  actuators:
    roll: {kind: torque, direction: [1.0, 0.0, 0.0], limit: 20.0}
plan: {method: reference_only, goal: {roll: 0.05}, duration: 5.0}
controllers:
  pd_feedforward: {kp: [12.0], kd: [60.0]}
  lqr: {}
  output_feedback: {}
"""
FAULTS: list[dict[str, Any]] = [
    {"kind": "command_lost", "probability": 0.5},
    {"kind": "command_late", "probability": 0.3},
    {"kind": "controller_silent", "controller": "lqr"},
    {"kind": "sensor_dropout", "channel": "joint_position", "probability": 0.3},
    {"kind": "sensor_nan", "channel": "joint_position"},
]
SETTINGS: dict[str, list[dict[str, Any]]] = {
    "lqr": [{"weights.joint": 60.0}, {"handover_time": 0.3}],
    "output_feedback": [{"reaching_rate": 3.0}, {"weight_frequency": 0.4}],
}
BENCHES = {
    "two motors": (
        TWO_MOTORS,
        Habits(
            {"base_yaw": 0.2, "hub_pitch": 0.1},
            {"pd_feedforward": [{"kp": [500.0, 500.0]}, {"kd": [900.0, 900.0]}], **SETTINGS},
            [*FAULTS, {"disturbance": {"base_yaw": 5.0}}],
            [],
        ),
    ),
    "antenna": (
        ANTENNA,
        Habits(
            {"roll": 0.1},
            {"pd_feedforward": [{"kp": [14.0]}, {"kd": [55.0]}], **SETTINGS},
            [*FAULTS, {"disturbance": {"roll": 0.5}}],
            [
                {"appendage": "dish", "to": 0.5, "duration": 1.0},
                {"appendage": "dish", "to": -0.3, "duration": 3.0},
                {"appendage": "dish", "to": 2.0, "duration": 3.0},
                {"appendage": "boom", "to": 0.1, "duration": 1.0},
            ],
        ),
    ),
}


@pytest.mark.share(0.1)
@pytest.mark.parametrize("name", BENCHES)
def test_whatever_an_operator_does_is_answered_logged_and_flies_again(
    tmp_path: Path, case: np.random.Generator, name: str
) -> None:
    text, habits = BENCHES[name]
    codes: dict[str, int] = {}

    def operate(pids: dict[str, int], domain: int) -> None:
        with operated(pids, tmp_path, domain) as bench:
            operator = RandomOperator(bench, habits, case)
            try:
                operator.work(ACTS)
                operator.tidy_up()
            finally:
                print(*operator.diary, sep="\n")
            codes.update(bench.end())
        raise KeyboardInterrupt

    flight = Flight(parse_trial(FLIGHT + text, "test"), tmp_path, 20, operate)
    assert flight.outcome.exit_code == 130, flight.log
    assert codes.pop("plant") == 130
    again = tmp_path / "again.log"
    log_of_restarted = again.read_text() if again.exists() else ""
    held = {name for name, code in codes.items() if code == -signal.SIGALRM}
    assert {*codes.values()} <= {0, -signal.SIGALRM}, codes
    # DDS may hold a node that leaves (see Loop.leave): the exit code that it reported before counts
    assert {flight.exit_codes[name] for name in held} <= {0, -signal.SIGKILL}, flight.exit_codes
    assert {*re.findall(r"leaves with exit code (\d+)", log_of_restarted)} <= {"0"}
    assert "Traceback" not in flight.log + log_of_restarted, flight.log + log_of_restarted
    assert [finding for finding in check_log(flight.bag) if not finding.ok] == []
    flown = resim(flight.bag)
    assert flown.identical, flown.first_difference
