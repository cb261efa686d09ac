from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.present import present

from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.sources import trial_path
from flexslew_lab.trial.trial import load_trial, parse_trial, plan_of_trial
from flexslew_plant.errors import BadInput

HUB, OSCILLATOR = (trial_path(f"time_optimal_{name}") for name in ("hub", "oscillator"))
ENDS = {HUB: 6.01986708, OSCILLATOR: 5.86595844}  # [s]
JOINTS = {HUB: "hub", OSCILLATOR: "mass"}


def flown(trial: Any, folder: Any) -> Any:
    result = run_trial(trial, "trial.yaml", folder / "run", in_process=True, report=False)
    assert result.exit_code == 0, result.message
    return result.metrics


@pytest.mark.parametrize("path", ENDS)
def test_the_time_optimal_trials_end_at_rest_at_the_goal(path: Any, tmp_path: Path) -> None:
    metrics = flown(load_trial(path), tmp_path)
    joint = JOINTS[path]
    assert metrics["manoeuvre_end"] == pytest.approx(ENDS[path], abs=1e-6)
    assert metrics["residual_tip_deflection"] < 1e-5
    assert metrics["residual_attitude_error"][joint] < 1e-5
    assert list(metrics["peak_effort"]) == [joint]
    assert metrics["missed_ticks"] == 0


@pytest.mark.slow
def test_the_robust_slew_keeps_its_promise_under_feedback(tmp_path: Path) -> None:
    text = OSCILLATOR.read_text().replace(
        "kind: floating_oscillator   #",
        "kind: floating_oscillator\n  parameters: {stiffness: 1.1} #",
    )
    robust: Any = parse_trial(text, "trial.yaml")
    assert robust.testbed.parameters.stiffness == 1.1
    plain = replace(robust, plan=replace(robust.plan, robust=False))
    residual = [
        flown(trial, tmp_path / name)["residual_tip_deflection"]
        for name, trial in (("robust", robust), ("plain", plain))
    ]
    assert residual[0] < 0.3 * residual[1]


def test_a_robust_hub_slew_flies_too(tmp_path: Path) -> None:
    trial: Any = load_trial(HUB)
    metrics = flown(replace(trial, plan=replace(trial.plan, robust=True)), tmp_path)
    assert metrics["manoeuvre_end"] == pytest.approx(6.38158246, abs=1e-6)
    assert metrics["residual_tip_deflection"] < 1e-5


def test_a_plan_for_other_joints_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    trial = replace(load_trial(HUB), plan=load_trial(OSCILLATOR).plan)
    with pytest.raises(BadInput, match="mass"):
        flown(trial, tmp_path)
    assert not list(tmp_path.iterdir())


def test_the_drive_limits_what_is_planned() -> None:
    trial: Any = load_trial(HUB)
    plan = present(plan_of_trial(trial))
    assert np.abs(plan.effort).max() == pytest.approx(trial.testbed.effort_limit[0])
    more = replace(trial, plan=replace(trial.plan, amplitude=3.0))
    with pytest.raises(BadInput, match="amplitude: 3 is above the drive's limit"):
        plan_of_trial(more)
