"""The facade for notebooks: trials by name, file and keys; arrays with names and units."""

import sys
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexslew_lab.log.recording.bag_observer import BagObserver
from flexslew_lab.log.recording.bag_writer import BagWriter
from flexslew_lab.notebook import Flight, fly, read, trial
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import plan_of_trial, set_plan, set_up, trial_text
from flexslew_plant.errors import BadInput

SHORT: dict[str, Any] = {
    "duration": 3.0,
    "plan": {
        "method": "reference_only",
        "goal": {"base_yaw": 0.1, "hub_pitch": 0.05},
        "duration": 2.0,
    },
    "schedule": [{"at": 1.0, "until": 1.5, "disturbance": {"hub_pitch": 2.0}}],
}


@pytest.fixture(scope="module")
def flight() -> Flight:
    return fly(trial(SHORT))


def test_a_trial_comes_by_name_by_file_and_by_its_keys(tmp_path: Path) -> None:
    file = tmp_path / "my.yaml"
    file.write_text("duration: 7.0\n")
    assert trial("m1").name == "m1"
    assert trial(file).duration == 7.0
    assert trial(str(file), {"testbed.modes": 2}).testbed.modes == 2
    assert trial(SHORT, {"duration": 4.0}).duration == 4.0
    assert SHORT["duration"] == 3.0


def test_numbers_of_numpy_are_numbers() -> None:
    keys = {"duration": np.float64(4.0), "testbed": {"effort_limit": np.array([80.0, 90.0])}}
    built = trial(keys, {"testbed.modes": np.int64(2)})
    assert (built.duration, built.testbed.modes) == (4.0, 2)
    assert tuple(built.testbed.effort_limit) == (80.0, 90.0)


def test_what_a_run_will_not_show_is_a_warning_in_the_line_that_flies() -> None:
    with pytest.warns(UserWarning, match="the plan ends at 2 s, the run at 1 s") as told:
        fly(trial(SHORT, {"duration": 1.0, "schedule": []}))
    assert [one.filename for one in told] == [__file__]


def test_fractions_and_decimals_are_numbers() -> None:
    assert trial({"duration": Fraction(9, 2), "period": Decimal("0.01")}).duration == 4.5


class Column:
    """An array of another library."""

    def __array__(self, *args: Any, **keys: Any) -> Any:
        return np.array([300.0, 400.0])


@pytest.mark.parametrize("kp", [Column(), range(300, 401, 100), np.array([300, 400], "f4")])
def test_what_numpy_takes_for_an_array_is_a_list(kp: Any) -> None:
    built = trial("m1", {"controllers.pd_feedforward.kp": kp, "name": Path("of_a_path")})
    assert built.controllers["pd_feedforward"]["kp"] == [300.0, 400.0]
    assert built.name == "of_a_path"


@pytest.mark.parametrize(
    ("source", "changes", "named"),
    [
        (SHORT, {"duration": 1.0 + 0.0j}, "(1+0j) is not allowed: give numbers"),
        (SHORT, {1: 2}, "1: unknown key"),
        ("x" * 300, {}, "is neither a file nor a shipped trial"),
        ("no_such_trial", {}, "m1"),
        (SHORT, {"testbed.wings": 2}, "testbed.wings"),
        (SHORT, {"duration": -1.0}, "duration"),
        ("three_axes", {"wings": 2}, "three_axes: wings"),
    ],
)
def test_a_wrong_trial_is_one_line(source: Any, changes: dict[str, Any], named: str) -> None:
    with pytest.raises(BadInput) as refused:
        trial(source, changes)
    assert named in str(refused.value)
    assert "ros2_ws" not in str(refused.value)  # where it is installed helps nobody
    assert "\n" not in str(refused.value)


def test_what_the_command_line_refuses_the_notebook_refuses() -> None:
    late = {"duration": 10.0, "schedule": [{"at": 20.0, "disturbance": {"hub_pitch": 1.0}}]}
    with pytest.raises(
        BadInput, match=r"schedule\.0\.at: 20(\.0)? is not allowed: the run ends at"
    ):
        trial(late)


def test_every_signal_has_a_unit_and_a_value_per_tick(flight: Flight) -> None:
    assert flight.units.keys() == flight.signals.keys()
    assert flight.time == pytest.approx(np.arange(301) * 0.01, abs=1e-12)
    assert {len(values) for values in flight.signals.values()} == {301}
    assert flight.units["position.base_yaw"] == "rad"
    assert flight.units["velocity.mode_1"] == "m/s"
    assert flight.units["effort.hub_pitch"] == "N m"
    assert flight.units["energy"] == "J"


def test_signals_are_what_the_bench_did(flight: Flight) -> None:
    assert flight["position.base_yaw"][0] == 0.0
    assert flight["reference.base_yaw"][250] == pytest.approx(0.1)
    # /truth carries what acted during the tick that ended; 1.0 s to 1.5 s are ticks 101 to 150
    pushed = np.flatnonzero(flight["disturbance.hub_pitch"])
    assert (pushed[0], pushed[-1]) == (101, 150)
    assert flight["disturbance"].shape == (301, 2)
    change = np.gradient(flight["position.hub_pitch"], flight.time)
    assert change[5:-5] == pytest.approx(flight["velocity.hub_pitch"][5:-5], abs=1e-4)
    # the answer of tick k acts during the tick after it
    assert np.array_equal(flight["demand.hub_pitch"][:-1], flight["effort.hub_pitch"][1:])
    assert np.isnan(flight["demand.hub_pitch"][-1])  # nobody is asked at the last tick
    assert flight.metrics["ticks"] == 300
    assert flight.trial["duration"] == 3.0
    assert [event.kind for event in flight.events].count("disturbance") >= 1


def test_what_sensors_say_is_the_truth_with_their_errors() -> None:
    noise = {"joint_position": 1e-6, "joint_velocity": 2e-5, "tip_deflection": 3e-4}
    flown = fly(trial(SHORT, {f"sensors.{name}.noise": size for name, size in noise.items()}))
    pairs = (("measured", "position"), ("measured_rate", "velocity"), ("sensor", "tip"))
    for (said, true), size in zip(pairs, noise.values(), strict=True):
        for name in flown.names(said):
            truth = f"{true}.{name.partition('.')[2]}"
            assert np.nanstd(flown[name] - flown[truth]) == pytest.approx(size, rel=0.2), name
            assert flown.units[name] == flown.units[truth]


def test_gyros_and_star_trackers_of_a_craft_are_signals() -> None:
    instruments = {"gyro": {"kind": "gyro"}, "tracker": {"kind": "star_tracker", "across": 1e-6}}
    still = {"duration": 2.0, "plan": {"method": "none", "goal": {"axis": [0, 0, 1], "angle": 0.1}}}
    flown = fly(trial("three_axes", {**still, "testbed.sensors": instruments}))
    told = {name: flown.units[name] for name in flown.names("sensor")}
    assert told["sensor.gyro_x"] == "rad/s"
    assert {name.partition(".")[2] for name in told} >= {"gyro_x", "tracker_qw", "left_rate_z"}
    rate = flown["coordinate_rate.body_rate_z"][:-1]
    turned = 0.5 * (rate[1:] + rate[:-1])  # a gyro reads the mean rate over its tick
    assert flown["sensor.gyro_z"][1:-1] == pytest.approx(turned, abs=1e-6)
    assert np.ptp(turned) > 1e-4


def test_an_unknown_signal_is_told_with_those_that_there_are(flight: Flight) -> None:
    with pytest.raises(KeyError, match=r"attitude is not a signal; there are position\.base_yaw"):
        flight["attitude"]


def test_a_wrong_name_is_refused_with_the_one_that_was_meant(flight: Flight) -> None:
    with pytest.raises(KeyError, match=r"settling is not a metric; did you mean settling_time\?"):
        flight.metrics["settling"]
    with pytest.raises(KeyError, match=r"efort is not a signal; did you mean effort\?"):
        flight.units("efort")


def test_names_and_units_of_a_quantity_are_requested_alike(flight: Flight) -> None:
    assert flight.names("effort") == ("effort.base_yaw", "effort.hub_pitch")
    assert flight.units("effort") == ("N m", "N m")
    assert flight.units("energy") == (flight.units["energy"],)
    assert flight.names() == tuple(flight) == tuple(flight.units)


def test_a_flight_draws_its_steps_and_the_loop_that_flew(flight: Flight) -> None:
    steps = flight.step_plot()
    assert [trace.name for trace in steps.data] == ["position", "reference"] * 2
    assert np.array_equal(steps.data[2].y, flight["position.hub_pitch"])
    assert len(flight.step_plot("hub_pitch").data) == 2
    bode = flight.bode()
    gain, phase = bode.data[0], bode.data[2]
    assert (gain.name, phase.name) == ("effort.base_yaw", "effort.base_yaw")
    assert bode.layout.xaxis.type == "log"
    assert gain.y[0] > 20.0 > -20.0 > gain.y[-1]  # a PD loop about a free hub


def test_trial_plan_and_model_show_a_small_table() -> None:
    given = trial(SHORT)
    assert "<td>testbed</td><td>csa" in given._repr_html_()
    assert "<td>plan.goal</td>" in trial("m1")._repr_html_()
    model = given.testbed.model()
    assert repr(model).startswith("<Model of 2 joints, ")
    assert "<td>hub_pitch</td><td>rad</td>" in model._repr_html_()
    made = plan_of_trial(trial("m1", plan="reference_only"), predict=False)
    assert made is not None
    assert "<td>base_yaw</td><td>0</td><td>1</td><td>0.06</td>" in made._repr_html_()


def test_a_folder_keeps_the_run_and_is_read_again(flight: Flight, tmp_path: Path) -> None:
    kept = fly(trial(SHORT), str(tmp_path / "run"))
    assert (tmp_path / "run" / "report.html").is_file()
    assert kept.metrics["trajectory_hash"] == flight.metrics["trajectory_hash"]
    again = read(str(tmp_path / "run" / "bag"))
    for name, values in kept.signals.items():
        assert np.array_equal(values, again.signals[name], equal_nan=True)


def test_estimates_of_different_size_stand_beside_each_other(tmp_path: Path) -> None:
    keys = {
        **SHORT,
        "controllers": {"pd_feedforward": {}, "proportional_integral": {}},
        "schedule": [{"at": 2.0, "switch": "proportional_integral"}],
    }
    run_trial(trial(keys), "test", tmp_path / "run", in_process=True, report=False)
    flown = read(tmp_path / "run")
    assert not np.isnan(flown["estimate.base_yaw"][:300]).any()
    assert np.isnan(flown["estimate.mode_1"][:200]).all()
    assert not np.isnan(flown["estimate.mode_1"][200:300]).any()


def test_a_figure_has_a_panel_per_quantity_with_its_unit(flight: Flight) -> None:
    figure = flight.plot("position", "effort.base_yaw")
    names = [trace.name for trace in figure.data]
    assert names[:2] == ["position.base_yaw", "position.hub_pitch"]
    assert names[-1] == "effort.base_yaw"
    assert figure.layout.yaxis.title.text == "position [rad, m]"
    assert figure.layout.yaxis2.title.text == "effort.base_yaw [N m]"
    assert np.array_equal(figure.data[0].y, flight["position.base_yaw"])
    assert len(flight.plot().data) > 4


def test_a_figure_of_a_bench_without_tips_shows_the_rest() -> None:
    testbed = {"kind": "varying_oscillator"}
    flown = fly(trial({"name": "stiff", "duration": 0.1, "testbed": testbed}))
    assert [trace.name for trace in flown.plot().data] == ["position.mass", "effort.mass"]


def test_a_data_frame_has_the_time_as_index_and_the_units(flight: Flight) -> None:
    pytest.importorskip("pandas")
    frame = flight.frame()
    assert frame.index.name == "time"
    assert list(frame.columns) == list(flight.signals)
    assert frame.attrs["units"]["tip." + flight.names("tip")[0].partition(".")[2]] == "m"


def test_without_pandas_the_arrays_are_there_and_the_frame_says_what_is_missing(
    flight: Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ModuleNotFoundError, match="pandas"):
        flight.frame()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["own_spacecraft", "scole_s_open", "three_axes"])
def test_joints_of_a_spacecraft_are_read_from_its_state(name: str) -> None:
    turn = {"method": "none", "goal": {"axis": [0.6, 0.0, 0.8], "angle": 0.5}}
    quick = {"duration": 3.0, **({"plan": turn} if name == "three_axes" else {})}
    flown = fly(trial(name, quick))
    joints = [signal.partition(".")[2] for signal in flown.names("measured")]
    for joint in joints:  # by sensors without errors
        there = flown[f"position.{joint}"][:-1]
        assert np.array_equal(there, flown[f"measured.{joint}"][:-1])
        assert np.allclose(there, flown[f"estimate.{joint}"][:-1], atol=1e-12)
    assert max(np.ptp(flown[f"position.{joint}"]) for joint in joints) > 1e-3
    model = trial(name, quick).testbed.model()
    assert (
        flown["position"].shape
        == flown["velocity"].shape
        == (len(flown.time), len(joints) + model.modes)
    )
    state = np.hstack((flown["coordinate"], flown["coordinate_rate"]))
    assert np.array_equal(flown["position.mode_1"], state[:, model.positions - model.modes])
    assert np.array_equal(flown["velocity"][7, : len(joints)], model.joint_state(state[7])[1])


def test_a_flight_with_resets_is_its_last_epoch_as_its_metrics_are(tmp_path: Path) -> None:
    given = trial(SHORT, {"schedule": [{"at": 0.0, "disturbance": {"hub_pitch": 2.0}}]})
    bench, controllers = set_up(given, "test")
    plan = plan_of_trial(given)
    assert set_plan(controllers, given.active, plan) is None
    with BagWriter(tmp_path / "bag", {"trial": trial_text(given)}) as writer:
        observer = BagObserver(writer)
        observer.notify(given, bench, plan, controllers)
        for ticks in (250, 60):
            while bench.tick < ticks:
                question = bench.question
                observer.question(question)
                observer.truth(bench.truth())
                answer = controllers[question.controller].observe(question)
                assert answer is not None
                observer.answer(answer)
                bench.offer(answer.command)
                bench.advance()
            observer.truth(bench.truth())
            if ticks == 250:
                bench.reset()
        observer.close()
    flown = read(tmp_path / "bag")
    assert flown.time == pytest.approx(np.arange(61) * 0.01, abs=1e-12)
    assert flown.metrics["ticks"] == 60
    assert np.abs(flown["tip"]).max() == flown.metrics["peak_tip_deflection"]
    assert flown["measured.hub_pitch"][0] == 0.0
    assert np.array_equal(flown["demand"][:-1], flown["effort"][1:])
