"""Trials by name or file, single values changed, saved plans flown."""

import json
from pathlib import Path
from typing import Any

import pytest
from tests.present import present

from flexslew_control.planners.feedforward.optimized_feedforward import OptimizedFeedforward
from flexslew_control.plans.plan_file import save_plan
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.sources import example_trials, read_trial, trial_path
from flexslew_lab.trial.trial import parse_trial, plan_of_trial, trial_text
from flexslew_plant.errors import BadInput


@pytest.mark.parametrize("shipped", example_trials(), ids=lambda trial: trial.name)
def test_every_shipped_trial_is_known_by_its_name_and_says_what_it_is(shipped: Any) -> None:
    trial, source = read_trial(shipped.name)
    assert trial.name == shipped.name
    assert source == shipped.name
    assert 20 < len(shipped.about) < 300
    assert parse_trial(trial_text(trial), "again", trial.trust) == trial


def test_no_name_is_m1_and_a_file_wins_over_a_shipped_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert read_trial(None)[0].name == "m1"
    monkeypatch.chdir(tmp_path)
    (tmp_path / "m1").write_text("{name: mine}")
    assert read_trial("m1")[0].name == "mine"


def test_an_unknown_name_is_told_with_the_known_ones() -> None:
    with pytest.raises(BadInput, match=r"swap_dem: is neither .* did you mean swap_demo\? .*m1"):
        trial_path("swap_dem")


def test_values_are_changed_by_their_path_and_read_as_yaml() -> None:
    changes = ["testbed.modes=5", "plan.goal.hub_pitch=0.8", "controllers.pd_feedforward.kp=[1, 2]"]
    trial, source = read_trial("m1", changes)
    assert trial.testbed.modes == 5
    assert isinstance(trial.plan, OptimizedFeedforward)
    assert trial.plan.goal == {"base_yaw": 1.0, "hub_pitch": 0.8}
    assert trial.controllers["pd_feedforward"]["kp"] == [1, 2]
    assert source == ("m1 --set " + " --set ".join(changes))


def test_the_name_of_a_method_in_place_of_the_plan_keeps_goal_and_duration() -> None:
    plan: Any = read_trial("m1", ["plan.duration=31", "plan=reference_only"])[0].plan
    assert (plan.method, plan.duration) == ("reference_only", 31.0)
    assert plan.goal == {"base_yaw": 1.0, "hub_pitch": 0.5}
    later: Any = read_trial("m1", ["plan=input_shaping", "plan.duration=20"])[0].plan
    assert (later.method, later.duration, later.goal) == ("input_shaping", 20.0, plan.goal)


def test_a_list_where_the_keys_of_a_trial_belong_is_named() -> None:
    with pytest.raises(BadInput, match=r"^a\.yaml: a list stands where keys belong"):
        parse_trial("- duration: 3", "a.yaml")
    with pytest.raises(BadInput, match=r"plan: \[.* a list stands where keys belong"):
        parse_trial("plan: [{method: none}]", "a.yaml")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("testbed.modez=5", r"^--set: testbed\.modez: unknown key; did you mean modes\?"),
        ("durations=5", "durations: unknown key; did you mean duration"),
        ("testbed.modes", "--set: testbed.modes: give key.path=value"),
        ("=5", "--set: =5: give key.path=value"),
        ("testbed.modes=[", r"--set: testbed\.modes: line \d+, column \d+ is not YAML"),
        ("seed.low=1", "--set: seed.low: seed is the scalar"),
        ("plan=referenc_only", "plan: method: .* did you mean reference_only"),
        ("plan=retargeting", "it does not plan what optimized_feedforward does"),
        ("plan.method=reference_only", "or --set plan=reference_only to keep its manoeuvre"),
        ("plan.model.modes=0", "modes: 0"),
    ],
)
def test_a_wrong_change_is_refused_in_one_line(change: str, words: str) -> None:
    with pytest.raises(BadInput, match=words) as caught:
        plan_of_trial(read_trial("m1", [change])[0])
    assert "\n" not in str(caught.value)


def test_a_saved_plan_flies_as_the_plan_it_was_saved_from(tmp_path: Path) -> None:
    trial = read_trial("m1", ["duration=30.0", "testbed.modes=1"])[0]
    save_plan(present(plan_of_trial(trial)), tmp_path / "my.plan")
    changed = [f"plan={json.dumps({'file': str(tmp_path / 'my.plan')})}"]
    saved = read_trial("m1", ["duration=30.0", "testbed.modes=1", *changed])[0]
    hashes = [
        run_trial(t, "test", tmp_path / name, True, False).metrics["trajectory_hash"]
        for t, name in ((trial, "planned"), (saved, "saved"))
    ]
    assert hashes[0] == hashes[1]


@pytest.mark.slow
def test_a_saved_plan_for_another_bench_is_refused(tmp_path: Path) -> None:
    trial = read_trial("m1")[0]
    save_plan(present(plan_of_trial(trial)), tmp_path / "my.plan")
    plan = f"plan={json.dumps({'file': str(tmp_path / 'my.plan')})}"
    for change, words in (
        ("period=0.02", "the period of the plan is"),
        ("testbed={kind: hub_with_appendages}", "moves"),
    ):
        other = read_trial("m1", [plan, change, "controllers={pd_feedforward: {}}"])[0]
        with pytest.raises(BadInput, match=words):
            run_trial(other, "test", tmp_path / "none", True, False)
        assert not (tmp_path / "none").exists()


def test_the_folder_of_a_run_is_refused_with_the_file_to_give(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"it is a folder$"):
        read_trial(tmp_path)
    (tmp_path / "trial.yaml").write_text("name: a\n")
    with pytest.raises(BadInput, match=r"it is a folder; give the trial\.yaml in it$"):
        read_trial(tmp_path)
