"""A craft in three axes that finds its attitude itself: flown, broken, swapped, flown again."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.check import check
from flexslew_lab.replay.resim import resim
from flexslew_lab.reproduce.scole_flights import shipped_values
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import build_controllers, trial_of_values
from flexslew_plant.errors import BadInput

SENSORS: dict[str, Any] = {
    "gyro": {"kind": "gyro", "angle_random_walk": 2e-6, "bias": [1e-5, -2e-5, 1e-5]},
    "tracker": {
        "kind": "star_tracker", "across": 5e-6, "about": 4e-5, "rate_noise": 1e-3,
        "interval": 0.2, "delay": 0.1, "blind": [[3.0, 5.0]],
    },
    "sun": {"kind": "sun_sensor", "sun": [0.2, 0.1, 1.0], "noise": 1e-3, "half_angle": 0.6},
}  # fmt: skip
PD = {"kp": [30.0], "kd": [70.0], "attitude": {"initial_bias": 5e-5}}
PID = {**PD, "ki": [3.0]}


def slew(duration: float, angle: float) -> dict[str, Any]:
    goal = {"axis": [1.0, -2.0, 0.5], "angle": angle}
    return {"method": "reference_only", "goal": goal, "duration": duration}


def values(**changes: Any) -> dict[str, Any]:
    """Return a trial that turns by some degrees about an axis across the joints'."""
    return shipped_values("three_axes", {"testbed": {"sensors": SENSORS}}) | {
        "period": 0.05,
        "plan": slew(4.0, 5e-3),
        "controllers": {"pd_feedforward": PD},
        **changes,
    }


def flown(folder: Path, exit_code: int = 0, **changes: Any) -> Any:
    trial = trial_of_values(values(**changes), "here")
    result = run_trial(trial, "here", folder, in_process=True, report=False)
    assert result.exit_code == exit_code, result.message
    return result.metrics


def test_a_slew_by_gyro_and_star_tracker_ends_at_the_goal(tmp_path: Path) -> None:
    blind = flown(tmp_path / "run", plan=slew(10.0, 0.05), duration=20.0)
    seen = flown(
        tmp_path / "joints", plan=slew(10.0, 0.05), duration=20.0,
        controllers={"pd_feedforward": {**PD, "attitude": None}},
    )  # fmt: skip
    for error, exact in zip(
        blind["final_error"].values(), seen["final_error"].values(), strict=True
    ):
        assert abs(error - exact) < 4e-5  # about a boresight a star tracker sees worst
    assert blind["trajectory_hash"] != seen["trajectory_hash"]


@pytest.mark.parametrize(
    ("fault", "of", "exit_code"),
    [
        ("sensor_nan", "tracker_qy", 0),  # is no reading
        ("sensor_nan", "gyro_z", 3),  # the estimate is lost
        ("sensor_dropout", None, 0),
        ("sensor_freeze", "gyro_x", 0),
        ("sensor_bias", "gyro_y", 0),
    ],
)
def test_broken_sensors_and_swaps_fly_again_to_the_same_bits(
    fault: str, of: str | None, exit_code: int, tmp_path: Path
) -> None:
    more = {"bias": 1e-4} if fault == "sensor_bias" else {}
    struck = {"kind": fault, "channel": "tip_deflection", "of": of, **more}
    metrics = flown(
        tmp_path / "run", exit_code, duration=7.0, allow_faults=True, goal_tolerance=0.5,
        fallback=["pid"],
        controllers={"pd_feedforward": PD, "pid": {"law": "collocated_pid", **PID}},
        schedule=[{"at": 2.0, "until": 2.5, "fault": struck}, {"at": 5.5, "switch": "pid"}][
            : 2 - (exit_code == 3)
        ],
    )  # fmt: skip
    assert metrics["faults"] >= 1
    bag = tmp_path / "run" / "bag"
    assert resim(bag).identical
    assert check(bag, "pd_feedforward").ok
    state = BagReader(bag).columns("/truth", {"position"})["position"]
    assert np.linalg.norm(state[:, 3:6], axis=1).max() < 8e-3


@pytest.mark.parametrize(
    ("sensors", "attitude", "words"),
    [
        ({}, {}, r"attitude: the testbed has no star_tracker; give it one in `sensors`"),
        (
            {"t": {"kind": "star_tracker"}}, {},
            r"attitude: the testbed has no gyro; give it one in `sensors`",
        ),
        (SENSORS, {"gyro": "gyros"}, r"attitude\.gyro: 'gyros' is not allowed: one of gyro"),
        (SENSORS, {"noise": 1.0}, r"attitude\.noise"),
    ],
)  # fmt: skip
def test_a_law_without_its_sensors_is_refused(sensors: Any, attitude: Any, words: str) -> None:
    changed = values(controllers={"pd_feedforward": {**PD, "attitude": attitude}})
    changed["testbed"]["sensors"] = sensors
    trial = trial_of_values(changed, "here")
    with pytest.raises(BadInput, match=words) as error:
        build_controllers(trial, "here")
    assert "\n" not in str(error.value)


def test_only_a_craft_that_turns_in_three_axes_finds_an_attitude() -> None:
    one = shipped_values("own_spacecraft", {"controllers": {"pd_feedforward": PD}})
    trial = trial_of_values(one, "here")
    with pytest.raises(BadInput, match="attitude: the joints of this testbed do not turn it"):
        build_controllers(trial, "here")
