"""`flexslew identify` on runs and on files of other benches: files, page, JSON, refusals."""

import json
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore

from flexslew_lab.identification.identification import experiment_of, identify
from flexslew_lab.identification.records.foreign import external_record
from flexslew_lab.identification.records.from_bag import bag_of, record_of
from flexslew_lab.identification.records.record import Record
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.overrides import override_values
from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import parse_trial, trial_of_values
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import plain
from flexslew_plant.yaml_data import load_yaml

W = 2.0**0.5  # both masses 1 kg, spring 1 N/m [rad/s]
TRIAL = """
name: shaken
duration: 125.0
period: 0.02
testbed: {kind: floating_oscillator, damping_ratio: 0.005}
sensors:
  joint_position: {noise: 4.0e-3}
  joint_velocity: {noise: 3.0e-3}
  tip_deflection: {noise: 3.0e-3}
plan: {method: excitation, band: [0.3, 6.0], largest_excursion: [0.2], duration: 120.0}
controllers: {pd_feedforward: {kp: [0.5], kd: [1.0]}}
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("shaken") / "run"
    run_trial(parse_trial(TRIAL, "test"), "test", folder, in_process=True, report=False)
    return folder


def test_a_run_gives_a_model_that_is_believed_a_page_and_numbers(
    call: Any, run: Path, tmp_path: Path
) -> None:
    out = tmp_path / "found"
    system = tmp_path / "bench.json"
    code, printed, _ = call(
        "identify", run, run, "--out", out, "--json", "--system", system,
        "--fit", "parameters.stiffness", "--appendage", "mass=x",
    )  # fmt: skip
    assert code == 0
    numbers = json.loads(printed[: printed.rindex("}") + 1])
    (mode,) = numbers["modes"]
    assert mode["frequency"]["value"] == pytest.approx(W, rel=2e-3)
    assert mode["frequency"]["low"] < mode["frequency"]["value"] < mode["frequency"]["high"]
    assert numbers["parameters"]["parameters.stiffness"]["value"] == pytest.approx(1.0, rel=0.01)
    assert numbers["validation"][0]["over_noise"]["position.mass"] == pytest.approx(1.0, rel=0.05)
    page = (out / "identification.html").read_text()
    assert "Modes of the free bench" in page
    assert "https://" not in page.split("<body")[1].split("<script")[0]
    assert load_yaml((out / "identified.yaml").read_text(), "file")["model"]
    assert load_yaml((out / "appendage.yaml").read_text(), "file")["frequencies_hz"]
    linear = json.loads(system.read_text())
    poles = control.poles(control.ss(*(linear[key] for key in "ABCD")))
    assert np.abs(poles).max() == pytest.approx(mode["frequency"]["value"], rel=1e-6)


def written_bag(folder: Path, record: Record) -> Path:
    """Write a bag of another bench: sensor_msgs/JointState, and efforts in a Float64MultiArray."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    stamp, header = types["builtin_interfaces/msg/Time"], types["std_msgs/msg/Header"]
    state, array = types["sensor_msgs/msg/JointState"], types["std_msgs/msg/Float64MultiArray"]
    layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    with Writer(folder, version=9) as writer:
        states = writer.add_connection("/joint_states", state.__msgtype__, typestore=store)
        efforts = writer.add_connection("/effort", array.__msgtype__, typestore=store)
        for k, (effort, measured) in enumerate(zip(record.effort, record.measured, strict=False)):
            at = round(k * record.period * 1e9)
            when = header(stamp(at // 10**9, at % 10**9), "")
            said = state(when, ["mass"], measured[:1], measured[1:2], np.zeros(0))
            held = array(layout, effort)
            for connection, message in ((states, said), (efforts, held)):
                raw = store.serialize_cdr(message, connection.msgtype)
                writer.write(connection, at, raw)
    return folder


@pytest.mark.parametrize(("made", "named"), [("lab", "lab"), ("lab/bag", "lab")])
def test_a_bag_of_joint_states_gives_the_mode_of_the_run(
    call: Any, run: Path, tmp_path: Path, made: str, named: str
) -> None:
    bag = tmp_path / made
    bag.parent.mkdir(exist_ok=True)
    written_bag(bag, record_of(bag_of(run)))
    code, printed, _ = call(
        "identify", tmp_path / named, "--out", tmp_path, "--json", "--band", "0.3,6",
        "--inputs", "/effort.data[0]=mass",
        "--outputs", "/joint_states.position[0]=position.mass,/joint_states.velocity[0]=rate.mass",
    )  # fmt: skip
    assert code == 0
    (mode,) = json.loads(printed[printed.index("{\n") : printed.rindex("}") + 1])["modes"]
    assert mode["frequency"]["value"] == pytest.approx(W, rel=2e-3)


def test_a_bag_of_this_bench_read_by_columns_has_the_efforts_at_their_ticks(run: Path) -> None:
    """A measurement holds the effort of the tick before; taken for the next one, all is late."""
    own = record_of(bag_of(run))
    columns = ("/measurement.joint_position[0]=position.mass",)
    repaired = external_record(run / "bag", ("/measurement.applied_effort[0]=mass",), columns)
    ticks = repaired.record.ticks
    assert own.ticks - ticks <= 1
    # means over ticks that the stamps' nanoseconds round
    assert repaired.record.effort == pytest.approx(own.effort[:ticks], abs=1e-5)
    assert repaired.record.measured[:, 0] == pytest.approx(own.measured[: ticks + 1, 0], abs=1e-6)


def test_a_file_says_when_its_efforts_end_and_where_they_look_limited(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    u = np.clip(rng.standard_normal(400), -1.5, 1.5)
    t = 0.02 * np.arange(400)
    path = tmp_path / "lab.csv"
    np.savetxt(path, np.column_stack((t, u, u)), delimiter=",", header="t,u,x", comments="")
    begun, ended = (external_record(path, ("u",), ("x",), past=past) for past in (False, True))
    # the time written has 18 digits
    assert ended.record.effort[:-1, 0] == pytest.approx(begun.record.effort[1:399, 0], abs=1e-9)
    share = float((np.abs(u) == 1.5).mean())
    assert any(f"at its largest value, 1.5, in {share:.0%}" in words for words in begun.words)
    free = np.column_stack((t, rng.standard_normal(400), u))
    np.savetxt(path, free, delimiter=",", header="t,u,x", comments="")
    assert external_record(path, ("u",), ("x",)).words == ()


@pytest.mark.parametrize(
    ("rows", "period", "words"),
    [
        ("0.0,1.0", None, "two samples and more are needed"),
        ("0.0,1.0\nnan,1.0\n0.2,1.0", None, "at finite times"),
        ("0.0,1.0\n0.1,1.0\n0.2,1.0", 0.0, "--period: 0.0 is not allowed"),
        ("0.0,1.0\n0.1,1.0\n0.2,1.0", float("nan"), "--period: nan is not allowed"),
    ],
)
def test_a_file_without_ticks_is_refused(
    tmp_path: Path, rows: str, period: float | None, words: str
) -> None:
    path = tmp_path / "lab.csv"
    path.write_text(f"t,u\n{rows}\n")
    with pytest.raises(BadInput, match=words):
        external_record(path, ("u",), ("u",), period)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("nowhere",), "nowhere: no such run"),
        (("RUN", "--band", "3,1"), "--band: '3,1' is not allowed: two numbers, low,high"),
        (("RUN", "--appendage", "mass"), "--appendage: {'mass': ''} is not allowed: an axis x, y"),
        (("RUN", "--start", "mass"), "--start: 'mass' is not allowed: key=value with a number"),
        (("RUN", "--fit", "parameters.mas"), "--fit: parameters.mas is not a number"),
        (("RUN", "--inputs", "/a.b"), "--inputs and --outputs belong together"),
        (("RUN", "--band", "100,140"), "no excitation there, they shake"),
        (("RUN/bag", "--inputs", "/no.x", "--outputs", "/no.y"), "no topic /no; there are"),
        (("lab.csv",), "lab.csv: name its columns: --inputs and --outputs"),
        (("lab.csv", "--inputs", "u=mass", "--outputs", "x=position.mass"), "at least"),
    ],
)
def test_what_cannot_be_identified_is_refused_in_one_line_and_leaves_nothing(
    call: Any, run: Path, tmp_path: Path, words: tuple[str, ...], told: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    t = 0.02 * np.arange(90)
    rows = np.column_stack((t, np.sin(t), np.cos(t)))
    np.savetxt("lab.csv", rows, delimiter=",", header="t,u,x", comments="")
    given = [word.replace("RUN", str(run)) for word in words]
    code, _, err = call("identify", *given, "--out", tmp_path / "out")
    assert code == 2
    (line,) = err.strip().splitlines()
    assert told in line
    assert not (tmp_path / "out" / "identified.yaml").exists()


@pytest.mark.slow
def test_a_saturated_experiment_is_refused_with_its_share(
    call: Any, run: Path, tmp_path: Path
) -> None:
    trial = TRIAL.replace("0.005}", "0.005, effort_limit: [0.3]}")
    trial = trial.replace("largest_excursion: [0.2]", "amplitude: [0.3]")
    flown = tmp_path / "run"
    hard = parse_trial(trial, "test")
    run_trial(hard, "test", flown, in_process=True, report=False)
    share = record_of(bag_of(flown)).saturated
    assert share > 0.01
    code, _, err = call("identify", flown)
    assert code == 2
    assert f"a drive was at its limit in {share:.0%} of the ticks" in err


@pytest.mark.slow
def test_the_shipped_experiment_on_scole_tells_the_mode_that_it_drives(tmp_path: Path) -> None:
    """A minute of its five: the wheel about roll drives the second mode, and hardly the first."""
    keys = {"duration": 65.0, "plan.duration": 60.0}
    short = trial_of_values(
        override_values(plain(read_trial("shake_scole", None)[0]), keys), "test"
    )
    run_trial(short, "test", tmp_path / "run", in_process=True, report=False)
    found = identify([experiment_of(tmp_path / "run")]).model
    model = short.testbed.model()
    linear = model.linearise(model.rest({}))
    true = np.sort(np.abs(linear.eigenvalues[linear.eigenvalues.imag > 0.0]))[1]
    near = min((m.frequency.value for m in found.modes), key=lambda w: abs(w - true))
    assert near == pytest.approx(true, rel=2e-3)
    n = model.before_modes
    turns = np.linalg.solve(linear.mass[:n, :n], linear.input_matrix[:n])[:, 0]
    roll = 1.0 / np.abs(turns[:6]).max()  # of the platform, which the wheel turns the other way
    assert found.inertia[0][0].value == pytest.approx(roll, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(("friction", "doubted"), [(0.0, False), (0.05, True)])
def test_friction_of_the_motors_which_rigid_motion_has_none_of_is_said(
    friction: float, doubted: bool, tmp_path: Path, call: Any
) -> None:
    changes = {
        "duration": 205.0,
        "period": 0.05,
        "plan.duration": 200.0,
        "plan.band": [0.1, 6.0],
        "actuator.viscous_friction": friction,
    }
    asked = trial_of_values(override_values(load_yaml(TRIAL, "test"), changes), "test")
    run_trial(asked, "test", tmp_path / "run", in_process=True, report=False)
    code, out, _ = call("identify", tmp_path / "run", "--json")
    warnings = json.loads(out)["warnings"]
    assert code == 0
    assert any("friction of the motors" in words for words in warnings) == doubted
