"""Tunings of trials: goals are met as the analysis of the bench has them, or refused in a line."""

import json
from pathlib import Path
from typing import Any

import pytest
from tests.lab.tuning.acc import ACC, FAST, STIFFNESS

import flexslew as fs
from flexslew_lab.tuning.page import tuning_page
from flexslew_lab.tuning.tuned import TunedController
from flexslew_lab.tuning.tuning_file import read_tuning
from flexslew_plant.errors import BadInput

pytest.importorskip("ctrlsys")


@pytest.fixture(scope="module")
def acc() -> TunedController:
    return fs.tune(ACC)


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


def test_a_problem_that_is_too_large_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flexslew_lab.tuning.problem._MOST_STATES", 5)
    with pytest.raises(BadInput, match=r"structure: the loop has \d+ states with its weights; at"):
        read_tuning(ACC)
