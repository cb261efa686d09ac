"""A planner of one's own over ROS 2: the planner node makes the plan, with the same bits."""

from pathlib import Path

from flexslew_lab.replay.resim import resim
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.own_code import ANY_CODE, Trust

from .flight import Flight

METHOD = f"{Path(__file__).parents[2]}/docs/examples/my_shaper.py:Shaper"
TRIAL = f"""
name: own_planner
duration: 8.0
testbed: {{kind: floating_oscillator}}
plan: {{method: "{METHOD}", goal: {{mass: 1.0}}, duration: 4.0}}
controllers:
  pd_feedforward: {{kp: 0.5, kd: 1.0}}
"""


def test_the_planner_node_runs_it_as_the_bench_in_one_process_does(tmp_path: Path) -> None:
    trial = parse_trial(TRIAL, "own.yaml", ANY_CODE)
    flight = Flight(trial, tmp_path / "ros")
    assert flight.outcome.exit_code == 0, flight.log
    there = run_trial(trial, "own.yaml", tmp_path / "here", in_process=True, report=False)
    assert flight.metrics["trajectory_hash"] == there.metrics["trajectory_hash"]
    assert flight.metrics["residual_tip_deflection"] < 0.01
    assert resim(flight.bag, trust=Trust.of([METHOD])).identical
