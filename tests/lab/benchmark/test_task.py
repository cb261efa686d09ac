from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from flexslew_lab.benchmark.baselines import baselines
from flexslew_lab.benchmark.task import (
    development_seeds,
    entry_study,
    evaluation_seeds,
    load_task,
    members,
    task_hash,
    task_names,
)
from flexslew_lab.studies.flight import metric_columns
from flexslew_lab.trial.own_code import texts_in
from flexslew_lab.trial.trial import set_up, trial_text
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import plain

TASKS = pytest.mark.parametrize("name", task_names())


@TASKS
def test_a_task_is_scored_by_metrics_that_its_bench_has_and_its_weights_make_one(name: str) -> None:
    task = load_task(name)
    bench, _ = set_up(task.trial, name)
    columns = metric_columns(bench, [])
    bench.close()
    assert task.name == name
    assert {*task.score, *task.require} <= {*columns}
    assert sum(term.weight for term in task.score.values()) == pytest.approx(1.0)
    assert all((b.below is None) != (b.above is None) for b in task.require.values())


@TASKS
def test_every_baseline_of_a_task_can_be_entered(name: str) -> None:
    task = load_task(name)
    for entry in baselines(task):
        assert entry_study(task, entry.sections).settings.replan is False


@TASKS
def test_every_member_of_the_development_seeds_and_of_a_round_can_be_built(name: str) -> None:
    task = load_task(name)
    seeds = [*development_seeds(task), *evaluation_seeds(task, "a round")]
    assert len({trial.seed for trial in members(task, seeds)}) == 2 * task.count


def test_a_member_depends_on_its_seed_alone() -> None:
    task = load_task("csa-slew")
    first, second, again = members(task, [3, 5, 3])
    assert trial_text(first) == trial_text(again)
    assert first.testbed != second.testbed
    assert first.seed != second.seed
    assert trial_text(members(load_task("csa-slew"), [5])[0]) == trial_text(second)


def test_members_keep_what_controller_and_planner_believe() -> None:
    one, other = members(load_task("csa-slew"), [1, 2])
    assert one.plan == other.plan
    assert one.controllers == other.controllers


def test_evaluation_seeds_follow_from_task_and_published_text() -> None:
    task = load_task("acc")
    seeds = evaluation_seeds(task, "round 1")
    assert len(set(seeds)) == task.count == len(development_seeds(task))
    assert seeds == evaluation_seeds(task, "round 1")
    assert not set(seeds) & set(evaluation_seeds(task, "round 2"))
    with pytest.raises(BadInput, match="published text"):
        evaluation_seeds(task, " ")


def test_the_hash_does_not_depend_on_the_working_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = task_hash(load_task("three-axis-slew"))
    for name in ("spacecraft", "time_optimal", "solar_panel.yaml"):
        (tmp_path / name).write_text("another")
    monkeypatch.chdir(tmp_path)
    assert task_hash(load_task("three-axis-slew")) == before


def test_the_hash_changes_with_the_data_of_the_trial(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    task = load_task("three-axis-slew")
    data = tmp_path / "solar_panel.yaml"
    before, own = task_hash(task), plain(task.trial)
    [file] = {text for text in texts_in(own) if text.endswith("solar_panel.yaml")}
    data.write_bytes(Path(file).read_bytes())
    monkeypatch.setattr("flexslew_lab.benchmark.task.texts_in", lambda values: [str(data)])
    assert task_hash(task) == before
    data.write_bytes(Path(file).read_bytes() + b"#")
    assert task_hash(task) != before


def test_the_hash_changes_with_the_file_of_the_task(tmp_path: Path) -> None:
    task = load_task("acc")
    copy = tmp_path / task.path.name
    copy.write_bytes(task.path.read_bytes())
    assert task_hash(replace(task, path=copy)) == task_hash(task)
    copy.write_bytes(task.path.read_bytes() + b"#")
    assert task_hash(replace(task, path=copy)) != task_hash(task)


def test_an_unknown_task_is_refused_with_the_known_ones() -> None:
    with pytest.raises(BadInput, match=r"csa_slew.*did you mean csa-slew.*scole"):
        load_task("csa_slew")


@pytest.mark.parametrize("sections", [{"seed": 3}, {"testbed": {"kind": "csa"}}, {"schedule": []}])
def test_an_entry_may_not_set_what_the_task_fixes(sections: dict[str, Any]) -> None:
    with pytest.raises(BadInput, match="is fixed by acc; an entry sets controllers"):
        entry_study(load_task("acc"), sections)
