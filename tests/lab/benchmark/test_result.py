import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from flexslew_lab.benchmark.entry import BenchmarkEntry, read_entry
from flexslew_lab.benchmark.flight import MemberResult, failures, fly_entry
from flexslew_lab.benchmark.result import (
    SeedSet,
    read_result,
    result_of,
    result_text,
    verify_result,
)
from flexslew_lab.benchmark.task import Task, load_task
from flexslew_lab.run.pool import InThisProcess, Pool
from flexslew_lab.studies.study import Study
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import ANY_CODE, NO_CODE

LAWS = """
import os
import numpy as np

class Damper:
    def __init__(self, settings, period, effort_limit): ...
    def update(self, measurement, estimate, reference):
        return -0.3 * measurement.joint_position - 0.9 * measurement.joint_velocity

class Raises(Damper):
    def update(self, measurement, estimate, reference):
        raise ValueError("no idea")

class NotFinite(Damper):
    def update(self, measurement, estimate, reference):
        return np.array([np.nan])

class WrongShape(Damper):
    def update(self, measurement, estimate, reference):
        return np.zeros(3)

class Dies(Damper):
    def update(self, measurement, estimate, reference):
        os._exit(3)

class ReadsStiffness(Damper):
    class Settings: ...
    def __init__(self, settings, plant):
        self.stiffness = plant.testbed.parameters.stiffness
    def update(self, measurement, estimate, reference):
        raise ValueError(f"k is {self.stiffness}")
"""
WHICH = SeedSet("development", "", 2)
Result = dict[str, Any]


@pytest.fixture(scope="module")
def task() -> Task:
    return load_task("acc")


@pytest.fixture
def law(tmp_path: Path) -> Callable[[str], str]:
    """Return a function that gives the name of a law in a file."""
    (tmp_path / "laws.py").write_text(LAWS.replace("class Settings: ...", SETTINGS))
    return lambda name: f"{tmp_path / 'laws.py'}:{name}"


SETTINGS = "Settings = __import__('flexslew_plant.settings').settings.section(type('S', (), {}))"


def fly(task: Task, entry: BenchmarkEntry, seeds: list[int], workers: int | None = None) -> Any:
    return fly_entry(task, entry, seeds, executor=InThisProcess)


def result_by(task: Task, law: str) -> tuple[Result, list[MemberResult]]:
    entry = read_entry(task, law=law)
    study, members = fly(task, entry, WHICH.seeds(task))
    return result_of(task, entry, WHICH, study, members), members


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("Raises", "raised ValueError: no idea"),
        ("NotFinite", "gave [nan], which is not finite"),
        ("WrongShape", "3"),
        ("ReadsStiffness", "k is 1.0 "),  # of the nominal bench, in every member
    ],
)
def test_a_law_that_fails_gives_failed_members_with_the_reason(
    name: str, reason: str, task: Task, law: Callable[[str], str]
) -> None:
    result, members = result_by(task, law(name))
    assert result["score"] == {"mean": 0.0, "low": 0.0, "high": 0.0}
    assert result["failed"] == len(members) == 2
    [(found, count)] = failures(members)
    assert reason in found
    assert count == 2


@pytest.mark.slow
def test_a_process_that_dies_is_a_failed_member(task: Task, law: Callable[[str], str]) -> None:
    entry = read_entry(task, law=law("Dies"))
    _, members = fly_entry(task, entry, [1], executor=lambda job: Pool(job, 1))
    assert failures(members) == [("its process died 2 times (exit code 3)", 1)]


def test_a_result_is_confirmed_and_a_change_of_it_is_found(
    task: Task, law: Callable[[str], str], tmp_path: Path
) -> None:
    result, members = result_by(task, law("Damper"))
    assert all(member.score > 0.0 for member in members)
    path = tmp_path / "result.json"
    path.write_text(result_text(result))
    kept = read_result(path)
    assert verify_result(kept, "result", ANY_CODE, fly=fly) == []
    kept["members"][1]["score"] += 1e-6
    assert "seed 2: score" in verify_result(kept, "result", ANY_CODE, fly=fly)[0]
    kept = read_result(path) | {"processor": "another"}
    kept["members"][1]["score"] *= 1.0 + 1e-11
    assert verify_result(kept, "result", ANY_CODE, fly=fly) == []
    kept["members"][0]["seed"] = 7
    assert "seeds are not those" in verify_result(kept, "result", ANY_CODE, fly=fly)[0]


def test_a_changed_law_is_found(task: Task, law: Callable[[str], str], tmp_path: Path) -> None:
    result, _ = result_by(task, law("Damper"))
    (tmp_path / "laws.py").write_text(LAWS.replace("0.9", "0.8"))
    found = verify_result(result, "result", ANY_CODE, fly=fly)
    assert f"files: {law('Damper')} has changed" in found[0]


def test_code_of_a_result_runs_only_where_it_is_trusted(
    task: Task, law: Callable[[str], str]
) -> None:
    result, _ = result_by(task, law("Damper"))
    with pytest.raises(BadInput, match="--trust"):
        verify_result(result, "result", NO_CODE, fly=fly)


def test_a_result_that_was_changed_by_hand_is_refused(task: Task, tmp_path: Path) -> None:
    study: Study
    entry = BenchmarkEntry("baseline", {})
    study, members = fly(task, entry, [1])
    text = result_text(result_of(task, entry, SeedSet("development", "", 1), study, members))
    path = tmp_path / "result.json"
    path.write_text(text.replace('"failed": 0', '"failed": 1'))
    with pytest.raises(BadInput, match="is damaged: its SHA-256"):
        read_result(path)
    unsealed = json.loads(text)
    del unsealed["sha256"]
    path.write_text(json.dumps(unsealed))
    with pytest.raises(BadInput, match="has no seal"):
        read_result(path)
    path.write_text("{}")
    with pytest.raises(BadInput, match="is no result of the benchmark"):
        read_result(path)


@pytest.mark.parametrize(
    ("which", "words"),
    [
        (SeedSet("mine", "", 2), "development or evaluation"),
        (SeedSet("development", "x", 2), "belongs to --seeds evaluation"),
        (SeedSet("evaluation", "", 2), "belongs to --seeds evaluation"),
        (SeedSet("development", "", 65), "1 to 64"),
    ],
)
def test_seeds_that_do_not_exist_are_refused(which: SeedSet, words: str, task: Task) -> None:
    with pytest.raises(BadInput, match=words):
        which.seeds(task)
