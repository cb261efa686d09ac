"""A craft in three axes that finds its attitude itself: flown, broken, swapped, flown again."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.representatives import representatives

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.check import check
from flexslew_lab.replay.resim import resim
from flexslew_lab.report.run_data import read_run
from flexslew_lab.reproduce.scole_flights import example_values
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import build_controllers, plan_of_trial, trial_of_values
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement

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
    return example_values("three_axes", {"testbed": {"sensors": SENSORS}}) | {
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


def knowledge_error(folder: Path, seed: int, modes: Any) -> float:
    """Return how far off attitudes are at a slew that shakes the panels, root mean square [rad]."""
    noisy = {"kind": "gyro", "angle_random_walk": 2e-4, "bias_spread": 5e-5}
    attitude = {"initial_bias": 5e-5, "modes": modes}
    changed = values(
        seed=seed, plan=slew(8.0, 0.05), duration=16.0,
        controllers={"pd_feedforward": {**PD, "attitude": attitude}},
    )  # fmt: skip
    changed["testbed"]["sensors"] = {**SENSORS, "gyro": noisy}
    trial = trial_of_values(changed, "here")
    run_trial(trial, "here", folder, in_process=True, report=False)
    bag = BagReader(folder / "bag")
    answers = bag.columns("/controller_state", {"tick", "estimate_orientation"})
    ticks = np.asarray(answers["tick"], dtype=int)
    true = bag.columns("/truth", {"position"})["position"][ticks, 3:7]
    believed = Rotation.from_quat(answers["estimate_orientation"])
    off = (believed.inv() * Rotation.from_quat(true)).magnitude()
    return float(np.sqrt(np.mean(np.asarray(off)[40:] ** 2)))  # from 2 s on


@pytest.mark.slow
def test_with_appendage_modes_the_attitude_of_a_flight_is_known_better(tmp_path: Path) -> None:
    """Slewing through a dropout of the star tracker, with a gyro that is noisy."""
    chosen: list[dict[str, Any] | None] = [{}, None]
    off = [
        [knowledge_error(tmp_path / f"{seed}_{k}", seed, modes) for seed in (1, 2)]
        for k, modes in enumerate(chosen)
    ]
    assert np.mean(off[0]) < 0.3 * np.mean(off[1])
    bag = tmp_path / "1_0" / "bag"
    assert resim(bag).identical
    assert check(bag, "pd_feedforward").ok


def test_a_report_says_how_far_off_an_attitude_is_by_the_rotation_between(tmp_path: Path) -> None:
    changed = values(plan=None, duration=6.0)  # holds where it is
    changed["testbed"]["initial"] = {"roll": 0.9, "pitch": -0.4, "yaw": 1.6}
    run_trial(trial_of_values(changed, "here"), "here", tmp_path, in_process=True, report=False)
    bag = BagReader(tmp_path / "bag")
    answers = bag.columns("/controller_state", {"estimate_orientation"})
    true = bag.columns("/truth", {"position"})["position"][: len(answers["estimate_orientation"])]
    believed = Rotation.from_quat(answers["estimate_orientation"])
    off = (Rotation.from_quat(true[:, 3:7]).inv() * believed).as_rotvec()
    shown = read_run(bag).traces["estimate_error"].value
    assert len(shown) == len(off)
    assert np.abs(shown[:, :3] - off).max() < 1e-9
    assert np.abs(off).max() > 1e-5


def test_modes_that_are_tuned_in_flight_start_the_filter_afresh(tmp_path: Path) -> None:
    with_modes = {**PD, "attitude": {"initial_bias": 5e-5, "modes": {}}}
    trials = [trial_of_values(values(controllers={"pd_feedforward": one}), "here")
              for one in (PD, with_modes)]  # fmt: skip
    older, newer = (build_controllers(trial, "here")["pd_feedforward"] for trial in trials)
    plan = plan_of_trial(trials[0])
    assert plan is not None
    older.adopt(plan)
    none, tips = np.zeros(3), np.zeros(len(trials[0].testbed.model().appendages.names))
    for tick in range(6):
        if tick == 3:
            newer.take_over(older)
            older = newer
        seen = Measurement(
            tick, 0, 0.05 * tick, "pd_feedforward", none, none, tips, 0.0 * tips, none
        )
        answer = older.observe(seen)
        assert answer is not None
        assert np.isfinite(answer.command.effort).all()


@pytest.mark.parametrize(
    ("fault", "of", "exit_code"),
    representatives(
        [
            ("sensor_nan", "tracker_qy", 0),  # is no reading
            ("sensor_nan", "gyro_z", 3),  # the estimate is lost
            ("sensor_dropout", None, 0),
            ("sensor_freeze", "gyro_x", 0),
            ("sensor_bias", "gyro_y", 0),
        ],
        ("sensor_nan", "tracker_qy", 0),
        ("sensor_nan", "gyro_z", 3),
    ),
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
    one = example_values("own_spacecraft", {"controllers": {"pd_feedforward": PD}})
    trial = trial_of_values(one, "here")
    with pytest.raises(BadInput, match="attitude: the joints of this testbed do not turn it"):
        build_controllers(trial, "here")
