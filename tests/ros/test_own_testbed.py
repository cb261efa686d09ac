"""A testbed of one's own over ROS 2: the same bits as in process."""

from pathlib import Path

from flexslew_lab.replay.resim import resim
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.own_code import ANY_CODE, Trust

from .flight import Flight

ROOT = Path(__file__).parents[2]
TRIAL = f"""
name: three_joints
duration: 8.0
testbed: {{kind: "{ROOT}/docs/examples/three_joints.py:ThreeJoints"}}
plan: {{method: optimized_feedforward, duration: 6.0, goal: {{base: 0.3, arm: -0.2, wrist: 0.2}}}}
controllers:
  pd_feedforward: {{kp: 40.0, kd: 60.0}}
  lqr: {{weights: {{deflection: 1.0}}}}
schedule:
  - {{at: 3.0, switch: lqr}}
"""


def test_three_joints_fly_over_ros_as_in_process(tmp_path: Path) -> None:
    trial = parse_trial(TRIAL, "own.yaml", ANY_CODE)
    flight = Flight(trial, tmp_path / "ros")
    assert flight.outcome.exit_code == 0, flight.log
    there = run_trial(trial, "own.yaml", tmp_path / "here", in_process=True, report=False)
    assert flight.metrics["trajectory_hash"] == there.metrics["trajectory_hash"]
    assert flight.metrics["switches"] == 1
    assert resim(flight.bag, trust=Trust.of(["all"])).identical
