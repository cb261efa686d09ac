"""What is published of the tasks does not change: their hashes and a member of each baseline.

`. setup/environment.sh; python -m tests.lab.benchmark.test_frozen` writes frozen.json again, where
a task is added.
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from flexslew_lab.benchmark.entry import BenchmarkEntry
from flexslew_lab.benchmark.flight import MemberResult, fly_entry
from flexslew_lab.benchmark.result import processor_class
from flexslew_lab.benchmark.task import load_task, task_hash, task_names
from flexslew_lab.run.pool import InThisProcess
from flexslew_lab.studies.batch.tolerance import TOLERANCE, relative_difference
from flexslew_lab.studies.execution.worker import Job
from flexslew_lab.studies.flight import FlightResult

FROZEN = Path(__file__).with_name("frozen.json")
SEED = 1
REMEDY = "a published task is never changed: add a new one, see docs/benchmark/rules.md"
LIGHT = ("acc", "antenna", "csa-slew")  # tasks whose member flies in any run of the tests
# an iterated plan stops within its own tolerance, by which processors may differ
ITERATED = {"csa-slew": 1e-6, "three-axis-slew": 1e-6}
EXTRAS = {"three-axis-slew": "casadi"}


def without_batch(job: Job) -> "InThisProcess[Any, FlightResult]":
    settings = replace(job.study.settings, batch=False)
    return InThisProcess(job._replace(study=job.study._replace(settings=settings)))


def member_of(name: str) -> MemberResult:
    """Return a member of the baseline of a task, by the bench."""
    _, [member] = fly_entry(load_task(name), BenchmarkEntry("", {}), [SEED], executor=without_batch)
    return member


def record_of(name: str) -> dict[str, Any]:
    """Return what is kept of a task: of the metrics those of the score, and a hash of all."""
    task, member = load_task(name), member_of(name)
    scored = {key: member.metrics[key] for key in (*task.score, *task.require)}
    where = {"hash": task_hash(task), "processor": processor_class()}
    return where | member._asdict() | {"metrics": scored}


def frozen() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(FROZEN.read_text())
    return found


@pytest.mark.parametrize("name", task_names())
def test_a_task_is_the_published_one(name: str) -> None:
    assert task_hash(load_task(name)) == frozen()[name]["hash"], REMEDY


@pytest.mark.parametrize(
    "name", [n if n in LIGHT else pytest.param(n, marks=pytest.mark.slow) for n in task_names()]
)
def test_a_member_of_the_baseline_is_the_published_one(name: str) -> None:
    if name in EXTRAS:
        pytest.importorskip(EXTRAS[name])
    kept, member = frozen()[name], member_of(name)
    assert member.reason == kept["reason"] == ""
    if kept["processor"] == processor_class():
        assert (member.digest, member.score) == (kept["digest"], kept["score"]), REMEDY
    tolerance = ITERATED.get(name, TOLERANCE)
    assert relative_difference(member.score, kept["score"]) <= tolerance, REMEDY
    for key, value in kept["metrics"].items():
        assert relative_difference(member.metrics[key], value) <= tolerance, key


if __name__ == "__main__":
    FROZEN.write_text(json.dumps({n: record_of(n) for n in task_names()}, indent=1) + "\n")
