"""Spacecraft over ROS 2: swaps and faults on them, the same bits as in process, flown again."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.check import check
from flexslew_lab.replay.resim import resim
from flexslew_lab.reproduce.scole_flights import example_values
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import SavedPlan, Trial, trial_of_values

from .flight import Flight

pytestmark = pytest.mark.ros

# one per joint: x, y, z, roll, pitch, yaw, torques at the tip
HOLD = {
    "kp": [4000.0, 4000.0, 4000.0, 400.0, 2400.0, 2400.0, 0.0, 0.0, 0.0],
    "kd": [3000.0, 3000.0, 3000.0, 290.0, 1700.0, 1700.0, 0.0, 0.0, 0.0],
}
TRIALS: dict[str, dict[str, Any]] = {
    "scole_s_a": {
        "duration": 1.2,
        "controllers": {"pd_feedforward": HOLD},
        "schedule": [
            {"at": 0.2, "until": 0.4, "fault": {"kind": "actuator_stuck", "joint": "mast_tip_x"}},
            {
                "at": 0.3,
                "until": 0.5,
                "fault": {"kind": "sensor_dropout", "channel": "tip_deflection", "of": "mast_y"},
            },
            {"at": 0.8, "switch": "pd_feedforward"},
        ],
    },
    "three_axes": {
        "duration": 6.0,
        "goal_tolerance": 3.0,  # it has only begun to turn
        "controllers": {"lqr": {}, "pi": {"law": "proportional_integral"}},
        "active": "lqr",
        "schedule": [
            {
                "at": 1.0,
                "until": 1.5,
                "fault": {"kind": "actuator_gain", "joint": "yaw", "gain": 0.0},
            },
            {
                "at": 2.0,
                "until": 2.2,
                "fault": {"kind": "sensor_dropout", "channel": "joint_position"},
            },
            {"at": 4.0, "switch": "pi"},
        ],
    },
}


def with_plan_of(flight: Flight, trial: Trial) -> Trial:
    """Return the trial with the plan that a flight has been given, if it has any."""
    if trial.plan is None:
        return trial
    return replace(trial, plan=SavedPlan(file=str(flight.folder / "plan.yaml")))


@pytest.mark.parametrize("name", TRIALS)
def test_a_spacecraft_flies_over_ros_as_in_process(name: str, tmp_path: Path) -> None:
    values = example_values(name, TRIALS[name]) | {"allow_faults": True}
    trial = trial_of_values(values, name)
    flight = Flight(trial, tmp_path / "ros")
    assert flight.outcome.exit_code == 0, flight.log
    here = run_trial(
        with_plan_of(flight, trial), name, tmp_path / "here", in_process=True, report=False
    )
    assert flight.metrics["trajectory_hash"] == here.metrics["trajectory_hash"]
    assert flight.metrics["switches"] == 1
    assert flight.metrics["faults"] >= 1
    assert resim(flight.bag).identical
    assert check(flight.bag, trial.active).ok
    assert BagReader(flight.bag).overview.cut is None
    shown = platform_poses(flight.bag, trial.period)
    truth = BagReader(flight.bag).columns("/truth", {"tick", "position"})
    assert len(shown) > 10
    for tick, pose in shown.items():
        row = truth["position"][np.searchsorted(truth["tick"], tick)]
        np.testing.assert_allclose(pose, row[:7], atol=1e-12)


def platform_poses(bag: Path, period: float) -> dict[int, list[float]]:
    """Return the platform's place and quaternion in /tf by tick; all frames lead to the world."""
    found = {}
    with next(bag.glob("*.mcap")).open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, _, _, ros in reader.iter_decoded_messages(topics=["/tf"]):
            parents = {t.child_frame_id: t.header.frame_id for t in ros.transforms}
            assert {*parents.values()} - {*parents} == {"world"}
            (platform,) = [t for t in ros.transforms if t.child_frame_id == "platform"]
            at, pose = platform.header.stamp, platform.transform
            place = [getattr(pose.translation, axis) for axis in "xyz"]
            turn = [getattr(pose.rotation, axis) for axis in "xyzw"]
            found[round((at.sec + 1e-9 * at.nanosec) / period)] = place + turn
    return found
