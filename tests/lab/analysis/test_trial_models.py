"""The model of a trial: where it rests at a time, what lies before its motors then, in a file."""

from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat
from typer.testing import CliRunner

from flexslew_lab.analysis.analysis import loop_analysis
from flexslew_lab.analysis.trial_models import model_of, point_of
from flexslew_lab.cli.main import app
from flexslew_lab.notebook import linear_model, nonlinear_model, trial
from flexslew_plant.errors import BadInput

PLAN = {"method": "reference_only", "goal": {"base_yaw": 1.0, "hub_pitch": 0.5}, "duration": 25.0}


def test_three_lines_give_a_state_space() -> None:
    what = trial("m1")
    plant = linear_model(what, hub_pitch=0.5)
    assert plant.dt == 0
    assert plant["tip:beam_positive", "effort:hub_pitch"].nstates == plant.nstates
    assert linear_model(what, sampled=True).dt == 0.01
    assert nonlinear_model(what).nstates == plant.nstates
    assert np.array_equal(linear_model("m1").A, linear_model(trial("m1")).A)
    assert nonlinear_model("m1").nstates == linear_model("m1").nstates


def test_at_a_time_the_bench_rests_where_its_plan_is_and_with_the_faults_that_act() -> None:
    schedule = [
        {"at": 0.0, "until": 2.0, "fault": {"kind": "command_delay", "ticks": 4}},
        {"at": 1.0, "fault": {"kind": "actuator_gain", "joint": "hub_pitch", "gain": 0.5}},
        {"at": 1.0, "fault": {"kind": "command_delay", "ticks": 1.5}},
        {"at": 1.0, "fault": {"kind": "sensor_freeze", "channel": "joint_position",
                              "of": "hub_pitch"}},
    ]  # fmt: skip
    what = trial("m1", {"plan": PLAN, "schedule": schedule,
                        "allow_faults": True})  # fmt: skip
    point = point_of(what, 25.0)
    np.testing.assert_allclose(point.rest.q[:2], [1.0, 0.5], atol=1e-12)
    np.testing.assert_array_equal(point.path.gain, [1.0, 0.5])
    np.testing.assert_array_equal(point.path.delay, [1.5, 1.5])
    assert point.left_out == ("sensor_freeze",)
    assert "effort.hub_pitch.before.2" in model_of(point, sampled=True).states
    np.testing.assert_array_equal(point_of(what, 1.5).path.delay, [5.5, 5.5])


def test_the_command_writes_a_file_and_says_what_is_in_it(tmp_path: Any) -> None:
    out = tmp_path / "plant.mat"
    done = CliRunner().invoke(
        app, ["model", "m1", "--rest", "hub_pitch=0.5", "--sampled", "--to", str(out)]
    )
    assert done.exit_code == 0, done.output
    assert "position.hub_pitch" in done.output
    assert loadmat(out)["A"].shape == (10, 10)


def test_the_command_leaves_out_what_nothing_moves_or_sees(tmp_path: Any) -> None:
    out = tmp_path / "plant.mat"
    words = ["model", "own_spacecraft", "--minimal", "--outputs", "position.roll, rate.roll"]
    done = CliRunner().invoke(app, [*words, "--to", str(out)])
    assert done.exit_code == 0, done.output
    found = loadmat(out)
    assert found["A"].shape == (6, 6)
    assert found["C"].shape == (2, 6)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--outputs", "position.hub"], "--outputs: no 'position.hub'; did you mean position.hub_"),
        (["--rest", "elbow=0.5"], "elbow is not a joint"),
        (["--rest", "hub_pitch"], "--rest: hub_pitch: give joint=position"),
        (["--rest", "hub_pitch=nan"], "rest of hub_pitch: nan is not allowed: a finite number"),
        (
            ["--rest", "hub_pitch=3 cm"],
            "rest of hub_pitch: '3 cm' is not allowed: give a number in",
        ),
        (["--rest", "hub_pitch=-inf"], "rest of hub_pitch: -inf is not allowed"),
        (["--at", "-1"], "--at: -1.0 is not allowed"),
    ],
)
def test_wrong_rests_are_refused_and_write_nothing(
    arguments: list[str], words: str, tmp_path: Any
) -> None:
    out = tmp_path / "plant.json"
    with pytest.raises(BadInput, match=words):
        CliRunner().invoke(
            app, ["model", "m1", *arguments, "--to", str(out)], catch_exceptions=False
        )
    assert not out.exists()


SEEN = {"gyro": {"kind": "gyro", "angle_random_walk": 2e-6, "rate_random_walk": 1e-8},
        "tracker": {"kind": "star_tracker", "across": 5e-6, "about": 4e-5, "interval": 0.2,
                    "delay": 0.2}}  # fmt: skip


def test_what_is_in_no_linear_model_is_named() -> None:
    what = trial("own_spacecraft", {"plan": None, "testbed.sensors": SEEN,
                                    "testbed.orbit": {"altitude": 6e5},
                                    "actuator.slew_rate": 2.0})  # fmt: skip
    assert point_of(what).left_out == (
        "actuator.slew_rate",
        "forces from outside",
        "delay and ticks of sensor gyro",
        "delay and ticks of sensor tracker",
    )


def test_friction_quanta_of_sensors_and_thrusters_are_named() -> None:
    strain = {"kind": "displacement", "appendage": "left", "quantisation": 1e-6}
    pusher = {"kind": "thruster", "direction": [1.0, 0.0, 0.0], "limit": 1.0}
    what = trial("own_spacecraft", {"plan": None, "testbed.sensors": {"gauge": strain},
                                    "testbed.actuators.pusher": pusher,
                                    "actuator.coulomb_friction": 1e-3,
                                    "sensors.joint_velocity.quantisation": 1e-6})  # fmt: skip
    assert point_of(what).left_out == (
        "actuator.coulomb_friction but for its slope at rest, of motors that stick",
        "that thrusters push one way",
        "quantisation of sensor joint_velocity",
        "quantisation of sensor gauge",
    )


def test_a_law_whose_filter_estimates_appendage_modes_is_refused_in_words() -> None:
    law = {"pd_feedforward": {"kp": [12.0], "kd": [60.0], "attitude": {"modes": {}}}}
    what = trial("three_axes", {"plan": None, "testbed.sensors": SEEN, "controllers": law})
    with pytest.raises(BadInput, match="a filter with appendage modes has no linear form"):
        loop_analysis(what, "it")
