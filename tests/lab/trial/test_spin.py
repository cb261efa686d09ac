"""A trial that ends in a spin: rates count for its goal, and the plan lasts as the run does."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.replay.resim import resim
from flexslew_lab.reproduce.scole_flights import example_values
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import checked_trial, trial_of_values
from flexslew_plant.errors import BadInput

RATE, UP, END = 2.0 * np.pi / 40.0, 20.0, 50.0  # one whole turn in the run


def trial(**more: Any) -> Any:
    torques = {
        name: {"kind": "torque", "direction": axis, "limit": 1.0}
        for name, axis in zip(("roll", "pitch", "yaw"), np.eye(3).tolist(), strict=True)
    }
    craft = example_values("three_axes")["testbed"]
    craft |= {"appendages": {}, "wheels": {}, "actuators": torques}
    values = {
        "name": "spin",
        "duration": END,
        "period": 0.05,
        "testbed": craft,
        "plan": {
            "method": "attitude_profile",
            "spin": {"axis": [1.0, -1.0, 0.5], "rate": RATE, "duration": UP},
            "duration": END,
        },
        "controllers": {"pd_feedforward": {"kp": [12.0], "kd": [60.0]}},
        **more,
    }
    return checked_trial(trial_of_values(values, "here"), "here")


def test_a_spin_is_reached_measured_alike_from_the_log_and_flown_again(tmp_path: Path) -> None:
    result = run_trial(trial(), "here", tmp_path / "run", in_process=True, report=False)
    assert result.exit_code == 0, result.message
    assert result.metrics["goal_error"] < 1e-5
    assert metrics_of(result.folder / "bag")["goal_error"] == result.metrics["goal_error"]
    assert resim(result.folder / "bag").identical


@pytest.mark.parametrize("turns", [1.0, 1.5])
def test_a_spin_that_is_missed_fails_even_after_a_whole_turn(turns: float, tmp_path: Path) -> None:
    rate = 2.0 * np.pi * turns / (END - 0.5 * UP)
    missed = trial()
    missed = trial(
        plan={
            "method": "attitude_profile",
            "spin": {"axis": [1.0, -1.0, 0.5], "rate": rate, "duration": UP},
            "duration": END,
        },
        schedule=[
            {"at": 0.0, "until": END, "fault": {"kind": "actuator_gain", "joint": name, "gain": 0}}
            for name in missed.testbed.model().joint_names
        ],
        allow_faults=True,
    )
    result = run_trial(missed, "here", tmp_path / "run", in_process=True, report=False)
    assert result.exit_code == 1, result.message
    left = np.pi if turns == 1.5 else 1.0  # rad, or the whole rate
    assert result.metrics["goal_error"] == pytest.approx(left, rel=1e-6)


def test_a_plan_that_turns_on_lasts_until_the_run_ends() -> None:
    with pytest.raises(BadInput, match=r"plan\.duration: 50\.0 .* the run ends at 60 s") as caught:
        trial(duration=60.0)
    assert "\n" not in str(caught.value)
