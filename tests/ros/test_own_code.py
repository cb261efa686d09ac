"""A testbed and a planner of one's own over ROS 2: the same bits as in process."""

from pathlib import Path

from flexslew_lab.replay.resim import resim
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.own_code import ANY_CODE, Trust

from .flight import Flight, patient
from .lines import alone

EXAMPLES = Path(__file__).parents[2] / "docs/examples"
TRIAL = f"""
name: own_code
duration: 8.0
testbed: {{kind: "{EXAMPLES}/three_joints.py:ThreeJoints"}}
plan:
  method: "{EXAMPLES}/my_shaper.py:Shaper"
  goal: {{base: 0.3, arm: -0.2, wrist: 0.2}}
  duration: 4.0
controllers:
  pd_feedforward: {{kp: 40.0, kd: 60.0}}
  lqr: {{weights: {{deflection: 1.0}}}}
schedule:
  - {{at: 3.0, switch: lqr}}
"""


def test_three_joints_fly_a_plan_of_an_own_planner_over_ros_as_in_process(tmp_path: Path) -> None:
    trial = patient(parse_trial(TRIAL, "own.yaml", ANY_CODE))
    flight = Flight(trial, tmp_path / "ros")
    assert flight.outcome.exit_code == 0, flight.log
    assert flight.metrics["trajectory_hash"] == alone(trial, tmp_path)
    assert flight.metrics["switches"] == 1
    assert resim(flight.bag, trust=Trust.of(["all"])).identical
