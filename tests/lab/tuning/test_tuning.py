"""Tunings of trials: goals are met as the analysis of the bench has them, or refused in a line."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.representatives import representatives
from typer.testing import CliRunner

import flexslew as fs
from flexslew_lab.cli.main import app
from flexslew_lab.tuning.page import tuning_page
from flexslew_lab.tuning.tuned import TunedController, bench_loops
from flexslew_lab.tuning.tuning_file import read_tuning, tuning_names
from flexslew_plant.errors import BadInput

pytest.importorskip("ctrlsys")
STIFFNESS = "testbed.parameters.stiffness"
ACC: dict[str, Any] = {
    "tuning": "acc", "trial": "acc_benchmark", "controller": "order_2",
    "structure": {"kind": "state_space", "order": 2, "outputs": {"effort.mass": 1.0},
                  "inputs": {"position.mass + tip.spring": 1.0}},
    "models": [{}, {STIFFNESS: 0.8}],
    "goals": [{"goal": "margin", "disk": 0.3}, {"goal": "poles", "decay": 0.05}],
    "starts": 3, "evaluations": 300,
}  # fmt: skip
GAINS: dict[str, Any] = {
    "tuning": "m1_gains", "trial": "m1", "controller": "pd_feedforward",
    "structure": {"kind": "gains"},
    "goals": [
        {"goal": "margin", "disk": 1.0, "hard": False},
        {"goal": "gain", "source": ["disturbance.base_yaw"], "to": ["position.base_yaw"],
         "below": 0.004},
    ],
    "starts": 1, "evaluations": 150,
}  # fmt: skip
FAST = {"goal": "poles", "decay": 0.5}


@pytest.fixture(scope="module")
def acc() -> TunedController:
    return fs.tune(ACC)


@pytest.fixture(scope="module")
def gains() -> TunedController:
    return fs.tune(GAINS)


def test_a_tuned_state_space_meets_its_goals_on_every_model(acc: TunedController) -> None:
    assert acc.met
    for value in (1.0, 0.8):
        found = fs.analyse(fs.trial(acc.trial, {STIFFNESS: value}), "order_2", at=0.0)
        assert found.stable
        assert found.disks["input"].alpha >= 0.3
        slowest = min(p.damping * p.frequency for p in found.poles)
        assert slowest >= 0.05 * (1.0 - 1e-6)


def test_the_number_of_a_margin_is_that_of_the_analysis(acc: TunedController) -> None:
    margin = acc.goals[0]
    alphas = [fs.analyse(fs.trial(acc.trial, {STIFFNESS: v}), "order_2", at=0.0)
              .disks["input"].alpha for v in (1.0, 0.8)]  # fmt: skip
    assert margin.value == pytest.approx(0.3 / min(alphas), rel=1e-4)
    assert min(acc.margins.values()) == pytest.approx(min(alphas), rel=1e-4)


def test_the_tuned_trial_flies(acc: TunedController) -> None:
    flight = fs.fly(fs.trial(acc.trial, {"duration": 40.0}))
    tip = flight["tip"]
    assert abs(tip[-100:]).max() < 0.2 * abs(tip).max()


def test_soft_goals_improve_while_hard_ones_are_met(gains: TunedController) -> None:
    soft, hard = gains.goals
    assert hard.met
    assert soft.value < soft.before or hard.before > 1.0
    found = fs.analyse(gains.trial, "pd_feedforward")
    assert found.stable


def test_a_gain_goal_is_the_peak_of_the_bench_s_closed_loop(gains: TunedController) -> None:
    """The disturbance is added to the command, as in the loop of the analysis."""
    loop = next(iter(bench_loops(gains.problem, gains.trial).values()))
    closed = loop.closed
    w = np.append(np.geomspace(1e-3, np.pi / closed.period, 20_000), gains.goals[1].frequency)
    z = np.exp(1j * w * closed.period)
    row = closed.rows(["position.base_yaw"])
    column = closed.inputs.index("effort.base_yaw")
    size = abs(row.at(z)[:, 0, column])
    assert gains.goals[1].value == pytest.approx(size[-1] / 0.004, rel=1e-6)
    assert size.max() == size[-1]


def test_the_numbers_of_a_law_stand_in_the_tuned_trial(gains: TunedController) -> None:
    section = gains.trial.controllers["pd_feedforward"]
    assert section is not None
    assert {"kp", "kd"} <= set(section)
    assert gains.section["kp"] != [460.0, 460.0]


def test_a_result_prints_its_verdict_and_its_page_draws_each_goal(acc: TunedController) -> None:
    assert repr(acc).startswith("<TunedController order_2: stable on 2 models; 2 of 2 goals met")
    page = tuning_page(acc)
    assert "disk margin 0.3 at efforts" in page
    assert "The goal is met" in page
    plain = json.loads(json.dumps(acc.plain()))
    assert plain["met"] is True
    assert [goal["met"] for goal in plain["goals"]] == [True, True]


def test_a_goal_out_of_reach_is_not_met() -> None:
    found = fs.tune({**ACC, "goals": [*ACC["goals"], FAST], "starts": 1})
    assert not found.met
    assert not found.goals[-1].met
    assert "stable on 2 models" in found.verdict
    assert "3 goals met; the worst is " in found.verdict


def test_a_loop_that_no_start_stabilises_is_refused_with_model_and_frequency() -> None:
    block = {**ACC["structure"], "order": 0}  # a double integrator by its position alone
    with pytest.raises(BadInput, match=r"no stable loop on all models from 1 starts.* rad/s; give"):
        fs.tune({**ACC, "structure": block, "starts": 1})


WRONG = [
    ({"controller": "a b"}, "controller"),
    ({"goals": []}, "goals"),
    ({"goals": [{"goal": "margin", "disk": 0.3, "channels": ["hub"]}]},
     "goals.1: channels: 'effort.hub'"),
    ({"goals": [{"goal": "poles"}]}, "goals.1: give decay or damping"),
    ({"goals": [{"goal": "gain", "source": ["noise.mass"], "to": ["effort.mass"], "below": 1.0}]},
     "goals.1: source: 'noise.mass'"),
    ({"goals": [{"goal": "tracking", "joints": ["hub"], "time": 1.0}]}, "goals.1: to: 'error.hub'"),
    ({"goals": [{"goal": "speed"}]}, "goals"),
    ({"models": [{"mass": 2.0}]}, "no parameter 'mass'"),
    ({"models": [{}, {}]}, "models.2"),
    ({"structure": {**ACC["structure"], "inputs": {"position.hub": 1.0}}},
     "inputs: 'position.hub'"),
    ({"structure": {**ACC["structure"], "outputs": {"effort.hub": 1.0}}}, "outputs: 'effort.hub'"),
    ({"structure": {"kind": "gains"}}, "controller: 'order_2'"),
    ({"trial": "nothing"}, "trial: nothing"),
    ({"starts": 0}, "starts"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "words"), WRONG, ids=[words for _, words in WRONG])
def test_what_is_wrong_in_a_file_is_named(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(BadInput) as refused:
        read_tuning({**ACC, **changes})
    message = str(refused.value)
    assert words in message
    assert "\n" not in message


def test_numbers_in_which_a_law_is_not_affine_are_refused() -> None:
    keys = {"controller": "output_feedback", "trial": "swap_demo",
            "structure": {"kind": "gains", "keys": ["weight_frequency"]}}  # fmt: skip
    goals = {"goals": [{"goal": "margin", "disk": 0.5}], "models": [{}]}
    with pytest.raises(BadInput, match="the law is not affine in them"):
        read_tuning({**ACC, **keys, **goals})


def test_a_tuning_goes_on_from_its_state_and_refuses_that_of_another(tmp_path: Path) -> None:
    state = tmp_path / "starts.json"
    few = {**ACC, "starts": 2, "evaluations": 60}
    whole = fs.tune(few, state=tmp_path / "other.json")
    fs.tune(few, state=state)
    kept = json.loads(state.read_text())
    kept["starts"] = kept["starts"][:1]
    state.write_text(json.dumps(kept))
    again = fs.tune(few, state=state)
    assert again.starts == whole.starts
    with pytest.raises(BadInput, match="is of another tuning"):
        fs.tune({**few, "seed": 2}, state=state)
    state.write_text("{}")
    with pytest.raises(BadInput, match="is no state of a tuning"):
        fs.tune(few, state=state)


def test_the_command_writes_a_trial_that_flies_and_a_page(tmp_path: Path) -> None:
    file, out = tmp_path / "acc.yaml", tmp_path / "out"
    file.write_text(json.dumps({**ACC, "guarantee": {STIFFNESS: [0.8, 1.2]}}))
    done = CliRunner().invoke(
        app, ["tune-structure", str(file), "--out", str(out), "--guarantee", "--fly", "--json"]
    )
    assert done.exit_code == 0, done.output
    found = json.loads((out / "tuned.json").read_text())
    assert found["met"]
    assert found["guarantee"]["guaranteed"]
    assert (out / "flight" / "report.html").exists()
    assert fs.trial(out / "trial.yaml").active == "order_2"
    assert "disk margin" in (out / "report.html").read_text()


def test_the_command_reports_what_is_not_met_by_its_exit_code(tmp_path: Path) -> None:
    file = tmp_path / "acc.yaml"
    file.write_text(json.dumps({**ACC, "goals": [FAST], "starts": 1, "evaluations": 60}))
    done = CliRunner().invoke(app, ["tune-structure", str(file), "--out", str(tmp_path / "out")])
    assert done.exit_code == 1
    assert "0 of 1 goals met" in done.output


def test_an_unknown_tuning_names_the_shipped_ones() -> None:
    with pytest.raises(BadInput, match="acc_order_3, observatory_pointing"):
        read_tuning("acc_order_4")


@pytest.mark.parametrize("name", representatives(tuning_names(), "acc_order_3"))
def test_a_shipped_tuning_is_read(name: str) -> None:
    problem = read_tuning(name)
    assert problem.settings.tuning == name
    assert len(problem.structure.labels) == len(problem.structure.start)


M1_PID: dict[str, Any] = {
    "tuning": "m1_pid", "trial": "m1", "controller": "notched",
    "structure": {
        "kind": "pid",
        "loops": {
            "effort.base_yaw": {"input": "error.base_yaw", "kp": 460.0, "kd": 920.0,
                                "filter": 0.02, "notches": [{"frequency": 6.0}]},
            "effort.hub_pitch": {"input": "error.hub_pitch", "kp": 460.0, "kd": 920.0,
                                 "filter": 0.02},
        },
    },
    "goals": [
        {"goal": "margin", "disk": 0.4},
        {"goal": "bandwidth", "frequency": 0.05},
        {"goal": "roll_off", "frequency": 20.0, "at": "sensors"},
        {"goal": "tracking", "joints": ["base_yaw"], "time": 20.0, "steady": 0.1},
        {"goal": "poles", "damping": 0.001},
    ],
    "starts": 1, "evaluations": 60,
}  # fmt: skip


@pytest.fixture(scope="module")
def m1_pid() -> TunedController:
    return fs.tune(M1_PID)


def test_weighted_goals_bound_the_responses_of_the_bench_s_loop(m1_pid: TunedController) -> None:
    """Of S and T with all efforts or sensors open at once, from the loop of the running law."""
    loop = next(iter(bench_loops(m1_pid.problem, m1_pid.trial).values()))
    w = np.geomspace(1e-3, 100.0, 3000)
    response = loop.response(w)
    numbers = {goal.label.split(" ")[0]: goal.value for goal in m1_pid.goals}

    def sensitivity(names: tuple[str, ...]) -> Any:
        return np.linalg.inv(np.eye(len(names)) + loop.loop_gain(names, response))

    def sizes(matrices: Any) -> Any:
        return np.linalg.norm(matrices, 2, axis=(1, 2))

    s = sizes(sensitivity(loop.effort_names))
    slow = w < 0.05
    assert (s <= numbers["bandwidth"] * np.sqrt((w / 0.05) ** 2 + 1e-6) * 1.01)[slow].all()
    sensors = tuple(n for n in loop.sensor_names if n.startswith("position"))
    t = sizes(np.eye(len(sensors)) - sensitivity(sensors))
    fast = w > 20.0
    assert (t <= numbers["roll-off"] * 20.0 / w * np.sqrt(1.0 + (0.005 * w) ** 2) * 1.01)[
        fast
    ].all()
    closed = loop.closed
    columns = [closed.inputs.index(f"reference.{joint}") for joint in loop.joint_names]
    row = closed.rows(["position.base_yaw"]).at(np.exp(1j * w * closed.period))
    error = abs(1.0 - row[:, 0, columns[loop.joint_names.index("base_yaw")]])
    bound = abs((1.5j * w + 0.1 * 0.1) / (1j * w + 0.1))
    assert (error <= numbers["tracking"] * bound * 1.01).all()
    damping = min(pole.damping for pole in m1_pid.analysis.poles)
    assert numbers["poles"] == pytest.approx(0.001 / damping, rel=1e-3)


@pytest.mark.slow
def test_the_shipped_tuning_of_order_3_is_guaranteed_over_the_range_of_its_benchmark() -> None:
    tuned = fs.tune("acc_order_3")
    assert tuned.met
    assert len(tuned.section["system"]["a"]) == 3
    assert fs.worst_case(tuned.trial, {STIFFNESS: [0.5, 2.0]}, "order_3", at=0.0).guaranteed


def test_a_problem_that_is_too_large_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flexslew_lab.tuning.problem._MOST_STATES", 5)
    with pytest.raises(BadInput, match=r"structure: the loop has \d+ states with its weights; at"):
        read_tuning(ACC)
