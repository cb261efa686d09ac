"""Law `linear` with an allocation: it turns an observatory by torques about the body axes."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.plants import plant

import flexslew as fs
from flexslew_control.controllers import CONTROLLERS, build_controller
from flexslew_control.controllers.linear.law_signals import LawSignals
from flexslew_lab.analysis.analysis import disk_margin, loop_analysis
from flexslew_lab.replay.check import check
from flexslew_lab.replay.resim import resim
from flexslew_lab.trial.trial import Trial, law_of, plant_of
from flexslew_plant.errors import BadInput

KP, KD = [12.0, 11.0, 9.0], [110.0, 100.0, 85.0]  # about x, y, z
WHEELS = {"kind": "wheels", "null_motion": 0.02, "bias_speed": [60.0, -60.0, 60.0, -60.0]}
AXES = {"gyroscopic": True, "attitude": {}, "allocation": WHEELS}
PD = {"d": np.hstack((np.diag(KP), np.diag(KD))).tolist()}
LAW = {"law": "linear", "system": PD, **AXES}
THE_SAME = {"law": "pd_feedforward", "kp": KP, "kd": KD, **AXES}


def pointing(section: dict[str, Any], **keys: Any) -> Trial:
    """Return a small turn of the observatory by this controller alone."""
    return fs.trial("observatory", {
        "duration": 60.0, "goal_tolerance": 0.1, "schedule": [], "fallback": [],
        "testbed.pointing_from": 45.0, "testbed.pointing_window": 5.0,
        "plan": {"method": "reference_only", "goal": {"axis": [1.0, -2.0, 0.5], "angle": 0.02},
                 "duration": 12.0},
        "controllers": {"pointing": section}, "active": "pointing",
    } | keys)  # fmt: skip


def built(section: dict[str, Any]) -> Any:
    trial = pointing(THE_SAME)
    law, settings = law_of("pointing", section)
    return build_controller("pointing", law, settings, plant_of(trial), "here")


def with_gyros(section: dict[str, Any]) -> Trial:
    """Return a turn by control moment gyros, by this controller alone."""
    gyros = {"kind": "control_moment_gyros", "null_motion": 0.05}
    section = {**section, "attitude": None, "allocation": gyros}
    plan = {"method": "input_shaping", "goal": {"axis": [1.0, 1.0, 0.5], "angle": 0.3}}
    return fs.trial("control_moment_gyros", {
        "duration": 12.0, "plan": {**plan, "duration": 8.0},
        "controllers": {"pointing": section}, "active": "pointing",
    })  # fmt: skip


def with_thrusters(section: dict[str, Any]) -> Trial:
    """Return the same small turn by thrusters."""
    return pointing({**section, "allocation": {"kind": "thrusters"}})


@pytest.mark.parametrize("trial", [pointing, with_thrusters, with_gyros])
def test_gains_alone_fly_as_the_attitude_law_that_they_are(
    trial: Callable[[dict[str, Any]], Trial],
) -> None:
    ours, theirs = (fs.fly(trial(section))["position"] for section in (LAW, THE_SAME))
    assert abs(theirs).max() > 0.02
    np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_gains_alone_have_the_margins_of_the_attitude_law_that_they_are() -> None:
    ours, theirs = (
        loop_analysis(pointing(section), "here", at=0.0, errors=()) for section in (LAW, THE_SAME)
    )
    assert ours.stable
    assert theirs.stable
    assert disk_margin(ours.loop) == pytest.approx(disk_margin(theirs.loop), rel=1e-6)


def test_an_integral_flies_as_the_attitude_law_that_it_is() -> None:
    ki, period = [1.0, 0.9, 0.75], 0.1
    integral = {
        "a": np.eye(3).tolist(), "b": np.hstack((period * np.diag(ki), np.zeros((3, 3)))).tolist(),
        "c": np.eye(3).tolist(), "d": PD["d"], "period": period,
    }  # fmt: skip
    law = {"law": "linear", "system": integral, "tracking_time": 10.0, **AXES}
    pid = {"law": "collocated_pid", "kp": KP, "ki": ki, "kd": KD, **AXES}
    ours, theirs = (fs.fly(pointing(section))["position"] for section in (law, pid))
    np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_what_was_applied_is_read_as_a_torque_about_the_body_axes() -> None:
    it = built({**LAW, "gyroscopic": False})
    torque, joints = it.law.allocator.torque, plant_of(pointing(THE_SAME)).joint_names
    row = LawSignals(("x", "y", "z"), joints, (), torque).row("applied.y")
    np.testing.assert_array_equal(row[6 : 6 + len(joints)], torque[1])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"inputs": ["error.wheel_1"] * 6}, "error.wheel_1 is not allowed: error.x"),
        ({"outputs": ["effort.wheel_1"] * 3}, "not allowed: torque.x, torque.y"),
        ({"outputs": ["torque.x"] * 3}, "is there twice; give each axis one"),
        ({"d": (-np.array(PD["d"])).tolist()}, "not stable on the model"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_in_one_line(change: dict[str, Any], words: str) -> None:
    with pytest.raises(BadInput, match=words) as refused:
        built({**LAW, "system": {**PD, **change}})
    assert "\n" not in str(refused.value)


def test_an_allocation_needs_a_craft_that_turns_in_three_axes() -> None:
    with pytest.raises(BadInput, match="do not turn it in three axes"):
        build_controller("it", "linear", {"allocation": {"kind": "wheels"}}, plant(), "here")
    assert CONTROLLERS["linear"].reads_testbed({"allocation": WHEELS})


def test_it_takes_over_in_flight_and_a_bag_is_flown_and_checked_again(tmp_path: Path) -> None:
    lag = {"a": (-np.eye(3)).tolist(), "b": np.eye(3, 6).tolist(), "c": np.eye(3).tolist(), **PD}
    keys = {"duration": 20.0, "schedule": [{"at": 10.0, "switch": "other"}],
            "testbed.pointing_from": 15.0}  # fmt: skip
    controllers = {"pointing": THE_SAME, "other": {"law": "linear", "system": lag, **AXES}}
    fs.fly(pointing(THE_SAME, controllers=controllers, **keys), tmp_path / "run")
    assert resim(tmp_path / "run/bag").identical
    assert check(tmp_path / "run/bag", "other").ok
