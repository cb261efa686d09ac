"""A start in motion is flown, predicted, recorded, repeated and studied."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.present import present

import flexslew as fs
from flexslew_lab.replay.resim import resim
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.assumed_rest import assumed_rest
from flexslew_lab.trial.sources import read_trial
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import read_testbed, starts_in_motion, with_changes

PLUCKED = {"testbed.initial_motion": {"plucked": {"beam_positive": 0.5}}}


def momentum(flight: Any, inertia: Any, wheel_inertia: float) -> Any:
    """Return the angular momentum of a rigid spacecraft with wheels in inertial axes, (k, 3)."""
    rate = np.array([flight[f"coordinate_rate.body_rate_{axis}"] for axis in "xyz"]).T
    wheels = np.array([flight[f"coordinate_rate.{w}_wheel"] for w in ("roll", "pitch", "yaw")]).T
    stored = rate * inertia + wheel_inertia * wheels
    x, y, z, w = (flight[f"coordinate.quaternion_{axis}"][:, None] for axis in "xyzw")
    vector = np.hstack((x, y, z))
    once = np.cross(vector, stored)
    return stored + 2.0 * w * once + 2.0 * np.cross(vector, once)


def test_the_shipped_detumbling_comes_to_rest_and_flies_again(tmp_path: Path) -> None:
    trial, _ = read_trial("detumble", None)
    outcome = run_trial(trial, "here", tmp_path / "run", in_process=True, report=False)
    assert outcome.exit_code == 0, outcome.message
    flight = fs.read(tmp_path / "run")
    rate = np.array([flight[f"coordinate_rate.body_rate_{axis}"] for axis in "xyz"])
    assert rate[:, 0] == pytest.approx(np.radians([2.0, -1.5, 1.0]))
    assert abs(rate[:, -1]).max() < 1e-6
    assert abs(np.array([*present(outcome.metrics)["final_error"].values()])).max() < 1e-5
    assert flight["tip.left_z"][0] != 0.0
    assert resim(tmp_path / "run/bag").identical


def test_wheels_keep_the_momentum_of_the_start() -> None:
    """No torque acts from outside: what the wheels store and the platform has stays the same."""
    rate, inertia = np.array([0.1, -0.05, 0.02]), np.array([35.0, 30.0, 32.0])  # wheels included
    motion = {"body_rate": rate.tolist(), "wheel_speeds": {"pitch": 100.0}}
    changes = {"testbed.initial_motion": motion, "testbed.appendages": {}, "duration": 20.0}
    total = momentum(fs.fly(fs.trial("detumble", changes)), inertia, 0.02)
    assert total[0] == pytest.approx(inertia * rate + [0.0, 0.02 * 100.0, 0.0])
    assert abs(total - total[0]).max() < 1e-9


def test_a_plan_predicts_the_motion_of_the_start_and_says_so() -> None:
    trial = fs.trial("m1", PLUCKED)
    plan = fs.plan(trial)
    assert "the bench moves before the plan begins" in plan.summary["warning"]
    flight = fs.fly(fs.trial("m1", PLUCKED, plan=plan))
    predicted = plan.summary["predicted_residual_tip_deflection"]
    assert flight.metrics["residual_tip_deflection"] == pytest.approx(predicted, rel=0.05)


def test_an_estimator_that_assumes_rest_is_named() -> None:
    changes = ["controllers={lqr: {}}", "active=lqr"]
    motion = "testbed.initial_motion={deflections: {mode_1: 0.2}}"
    assert [*assumed_rest(read_trial("m1", changes)[0])] == []
    (line,) = assumed_rest(read_trial("m1", [*changes, motion])[0])
    assert line.startswith("controllers.lqr.")
    assert "0.01 m assumes appendages at rest; the testbed starts with a mode at 0.2 m" in line
    wide = line.split(":")[0]
    assert [*assumed_rest(read_trial("m1", [*changes, motion, f"{wide}=0.1"])[0])] == []


def test_a_model_with_fewer_modes_keeps_the_motion_of_the_bench() -> None:
    motion = {"deflections": {"mode_3": 0.1}}
    testbed = read_testbed({"kind": "csa", "initial_motion": motion}, "here")
    model = with_changes(testbed, {"damping_ratio": 0.01}, "here")
    assert starts_in_motion(model)
    assert with_changes(testbed, {"initial_motion": None}, "here") == read_testbed({}, "here")
    with pytest.raises(BadInput, match=r"mode_3: not in this testbed; .*allowed: mode_1"):
        fs.fly(fs.trial("m1", {"testbed.modes": 1, "testbed.initial_motion": motion}))
