"""Attitudes in plans and answers are quaternions, from any start, measured or estimated."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.representatives import representatives

from flexslew_control.message_fields import plan_of
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.column_names import column_name
from flexslew_lab.log.messages.cdr import decode
from flexslew_lab.replay.check import check
from flexslew_lab.reproduce.scole_flights import example_values
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import parse_trial, plant_of, trial_of_values
from flexslew_plant.arrays import Matrix
from flexslew_plant.testbeds.contract import HasSky

SENSORS = {
    "gyro": {"kind": "gyro", "angle_random_walk": 2e-6},
    "tracker": {"kind": "star_tracker", "across": 5e-6, "about": 5e-6, "interval": 0.2},
}
LAWS: dict[str, tuple[dict[str, Any], float]] = {  # settings; how far an estimate may be off [rad]
    "pd_feedforward": ({"kp": [12.0], "kd": [60.0]}, 1e-9),  # as measured: rounding
    "lqr": ({}, 1e-5),  # its filter predicts by equations that are linear about the plan
    "found": ({"law": "pd_feedforward", "kp": [12.0], "kd": [60.0], "attitude": {}}, 1e-4),
}


def flown(law: str, seed: int, folder: Path) -> Any:
    """Return the bag of a turn to some attitude from another one, and its testbed."""
    start, goal = Rotation.random(2, random_state=seed)
    roll, pitch, yaw = start.as_rotvec().tolist()
    initial = {"roll": roll, "pitch": pitch, "yaw": yaw}
    there = {"quaternion": goal.as_quat().tolist()}
    gains = {"kp": [12.0], "kd": [60.0]}
    values = example_values("three_axes", {"testbed": {"sensors": SENSORS, "initial": initial}}) | {
        "plan": {"method": "reference_only", "goal": there, "duration": 60.0, "feedback": gains},
        "controllers": {law: LAWS[law][0]},
        "active": law,
        "period": 0.1,
        "duration": 4.0,
        "goal_tolerance": 4.0,  # it has only begun to turn
    }
    trial = trial_of_values(values, "t")
    run_trial(trial, "t", folder, in_process=True, report=False)
    return BagReader(folder / "bag"), plant_of(trial).testbed


def apart(one: Matrix, other: Matrix) -> float:
    """Return the largest angle between attitudes [rad]."""
    a, b = Rotation.from_quat(one), Rotation.from_quat(other)
    return float((a.inv() * b).magnitude().max())


@pytest.mark.slow
@pytest.mark.parametrize("law", representatives(LAWS, "lqr", "found"))
def test_plan_reference_and_estimate_are_quaternions(law: str, tmp_path: Path) -> None:
    bag, testbed = flown(law, 7, tmp_path)
    (message,) = bag.overview.plans
    plan = plan_of(message, "the log")
    planned = np.reshape(message.orientation, (-1, 4))
    assert len(planned) == len(plan.position)
    assert apart(planned, Rotation.from_rotvec(plan.position.copy()).as_quat()) < 1e-12
    np.testing.assert_allclose(np.linalg.norm(planned, axis=1), 1.0, rtol=1e-14)
    rows = bag.columns(
        "/controller_state", {"tick", "reference_orientation", "estimate_orientation"}
    )
    np.testing.assert_array_equal(rows["reference_orientation"], planned[rows["tick"].astype(int)])
    assert isinstance(testbed, HasSky)
    true = testbed.attitudes(bag.columns("/truth", {"position"})["position"])
    late = rows["tick"].astype(int)[5:]  # before that no star tracker has been read
    assert apart(rows["estimate_orientation"][5:], true[late]) < LAWS[law][1]
    found = check(bag.path, law)
    assert found.ok
    compared = {row.field: row.compared for row in found.rows}
    assert (
        compared["reference_orientation"] == compared["estimate_orientation"] == len(rows["tick"])
    )


def test_a_column_of_a_quaternion_has_the_name_of_its_part(tmp_path: Path) -> None:
    bag, _ = flown("pd_feedforward", 3, tmp_path)
    names = [
        column_name(bag.overview, "/controller_state", "estimate_orientation", k) for k in range(4)
    ]
    assert names == [f"estimate_orientation.{part}" for part in "xyzw"]


def test_a_bench_without_an_attitude_has_none_in_plan_and_answer(tmp_path: Path) -> None:
    text = "{duration: 1.0, plan: {method: none, goal: {base_yaw: 0.1}}}"
    run_trial(parse_trial(text, "t"), "t", tmp_path, in_process=True, report=False)
    bag = BagReader(tmp_path / "bag")
    assert [len(plan.orientation) for plan in bag.overview.plans] == [0]
    for _, kind, _, _, data in bag.messages(("/controller_state",)):
        answer = decode(kind, data)
        assert len(answer.reference_orientation) == len(answer.estimate_orientation) == 0
