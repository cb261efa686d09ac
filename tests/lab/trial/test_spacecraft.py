"""Laws, faults, swaps and replays on a free platform: all that the bench does for any testbed."""

from pathlib import Path
from typing import Any

import pytest
from tests.representatives import representatives

from flexslew_lab.replay.check import check
from flexslew_lab.replay.resim import resim
from flexslew_lab.reproduce.scole_flights import example_values
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import build_controllers, trial_of_values
from flexslew_plant.errors import BadInput
from flexslew_plant.faults import FAULTS

# one per joint: x, y, z, roll, pitch, yaw, torques at the tip
GAINS = {
    "kp": [4000.0, 4000.0, 4000.0, 400.0, 2400.0, 2400.0, 0.0, 0.0, 0.0],
    "kd": [3000.0, 3000.0, 3000.0, 290.0, 1700.0, 1700.0, 0.0, 0.0, 0.0],
}
WEIGHTS = {"mode": 1.0, "mode_rate": 1.0, "effort": 0.01, "deflection": 1.0, "time": 1.0}
AS_MANY_AS_EFFORTS = {"appendages": {"mast": {"shape": {"modes": 3}}}}
LAWS: dict[str, Any] = {
    "pd_feedforward": GAINS,
    "collocated_pid": {**GAINS, "ki": [0.0, 0.0, 0.0, 20.0, 20.0, 20.0, 0.0, 0.0, 0.0]},
    "lqr": {"weights": WEIGHTS},
    "proportional_integral": {"weights": WEIGHTS, "model": AS_MANY_AS_EFFORTS},
}
FAULT: dict[str, dict[str, Any]] = {
    "actuator_stuck": {"joint": "mast_tip_y"},
    "actuator_gain": {"joint": "roll", "gain": 0.5},
    "command_delay": {"ticks": 2},
    "command_lost": {"probability": 0.3},
    "command_late": {"probability": 0.3, "ticks": 2},
    "command_duplicated": {"probability": 0.3},
    "command_reordered": {"probability": 0.3},
    "controller_silent": {"controller": "output_feedback"},
    "sensor_dropout": {"channel": "tip_deflection", "of": "mast_rate_x"},
    "sensor_bias": {"channel": "joint_position", "of": "yaw", "bias": 1e-3},
    "sensor_freeze": {"channel": "tip_deflection", "of": "mast_y"},
    "sensor_nan": {"channel": "joint_velocity", "of": "pitch"},
}


ENDING = {"controller_silent", "sensor_nan"}  # another takes over, or the brake


def flown(values: dict[str, Any], folder: Path, exit_code: int = 0) -> Any:
    result = run_trial(
        trial_of_values(values, "here"), "here", folder, in_process=True, report=False
    )
    assert result.exit_code == exit_code, result.message
    return result.metrics


@pytest.mark.slow
@pytest.mark.parametrize("law", representatives(LAWS, "lqr"))
def test_every_law_turns_a_free_platform(law: str, tmp_path: Path) -> None:
    values = example_values("scole_s_a") | {
        "duration": 8.0,
        "plan": {"method": "reference_only", "goal": {"roll": 0.05}, "duration": 2.0},
        "controllers": {law: LAWS[law]},
        "active": law,
    }
    errors = flown(values, tmp_path / "run")["final_error"]
    assert max(abs(errors[name]) for name in ("roll", "pitch", "yaw")) < 2e-3
    assert max(abs(errors[name]) for name in "xyz") < 1e-3


@pytest.mark.parametrize("law", LAWS)
def test_a_law_that_is_unstable_at_the_period_is_refused_with_one_that_works(law: str) -> None:
    feedback = LAWS[law]
    if "kd" in feedback:
        feedback = feedback | {"kp": [4e5] * 9, "kd": [9e4] * 9}
    values = example_values("scole_s_a") | {
        "period": 0.5,
        "controllers": {law: feedback},
        "active": law,
        "plan": {"method": "none"},
    }
    trial = trial_of_values(values, "here")
    with pytest.raises(BadInput, match=rf"{law}.* spectral radius of one tick is .*; ") as error:
        build_controllers(trial, "here")
    assert "\n" not in str(error.value)


def test_the_matrix_holds_every_fault() -> None:
    assert set(FAULT) == set(FAULTS)


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind",
    representatives(FAULT, "actuator_stuck"),
)
def test_every_fault_strikes_a_spacecraft_and_flies_again(kind: str, tmp_path: Path) -> None:
    struck = {"at": 0.4, "until": 0.8, "fault": {"kind": kind, **FAULT[kind]}}
    values = example_values("scole_s_a", {"controllers": {"pd_feedforward": GAINS}}) | {
        "duration": 1.2,
        "allow_faults": True,
        "fallback": ["pd_feedforward"],
        "schedule": [struck, {"at": 1.0, "switch": "pd_feedforward"}],
    }
    metrics = flown(values, tmp_path / "run", 3 if kind in ENDING else 0)
    assert metrics["faults"] >= 1
    assert resim(tmp_path / "run" / "bag").identical
    assert check(tmp_path / "run" / "bag", "pd_feedforward").ok


@pytest.mark.parametrize(
    ("fault", "known"),
    [
        ({"kind": "actuator_stuck", "joint": "base"}, "x, y, z, roll, pitch, yaw, mast_tip_x"),
        (
            {"kind": "sensor_dropout", "channel": "tip_deflection", "of": "tip"},
            "mast_x, mast_y, mast_z, mast_rate_x",
        ),
    ],
)
def test_faults_on_what_a_spacecraft_lacks_are_refused(fault: dict[str, Any], known: str) -> None:
    values = example_values("scole_s_a") | {
        "allow_faults": True,
        "schedule": [{"at": 0.4, "fault": fault}],
    }
    with pytest.raises(BadInput, match=known) as error:
        run_trial(trial_of_values(values, "here"), "here", None, in_process=True, report=False)
    assert "\n" not in str(error.value)


@pytest.mark.slow
def test_the_full_scale_spacecraft_flies_to_its_end(tmp_path: Path) -> None:
    metrics = flown(example_values("scole_full"), tmp_path / "run")
    assert abs(metrics["final_error"]["roll"]) < 1e-5
    assert max(metrics["pointing_error"]["mast"]) < 0.02
    assert metrics["saturated_time"] == 0.0


@pytest.mark.slow
def test_a_wheel_keeps_to_its_momentum(tmp_path: Path) -> None:
    values = example_values("own_spacecraft") | {"duration": 45.0}
    free = flown(values, tmp_path / "free")["peak_wheel_momentum"]["roll"]
    values["testbed"]["wheels"]["roll"]["momentum_limit"] = 0.5 * free
    # half of the momentum does not take it to its goal, which is a failed check
    tied = flown(values, tmp_path / "tied", exit_code=1)["peak_wheel_momentum"]["roll"]
    # and what the turn of the platform, of 35 kg m^2, changes the speed of its .02 kg m^2 by
    assert 0.5 * free < tied <= 0.5 * free * (1.0 + 0.02 / 35.0)
