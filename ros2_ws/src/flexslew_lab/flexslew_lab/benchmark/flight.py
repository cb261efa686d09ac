"""The members of a task under one entry: each with its metrics, its score, or why it failed."""

import hashlib
import json
import os
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from typing import NamedTuple

from flexslew_lab.benchmark.entry import BenchmarkEntry
from flexslew_lab.benchmark.score import Metrics, score_of, violation
from flexslew_lab.benchmark.task import Task, entry_study, member_case
from flexslew_lab.progress import count_results, phase
from flexslew_lab.run.pool import Executor, Pool
from flexslew_lab.studies.cases import Case, nominal_of, require_variant
from flexslew_lab.studies.execution.worker import Job
from flexslew_lab.studies.flight import FlightResult, PlanCache
from flexslew_lab.studies.study import Study
from flexslew_lab.trial.own_code import user_code_names
from flexslew_plant.own_code import is_user_code, require_trust

EFFORT = "control_effort"  # metric over which scores are drawn


class MemberResult(NamedTuple):
    """What an entry did on one member of the ensemble.

    Args:
        seed: of the member.
        score: from 0 to 100.
        reason: why it failed; empty: it did not.
        metrics: all columns of a study; empty if it did not fly to its end.
        digest: SHA-256 of these metrics.
    """

    seed: int
    score: float
    reason: str
    metrics: dict[str, float | None]
    digest: str


def fly_entry(
    task: Task,
    entry: BenchmarkEntry,
    seeds: Sequence[int],
    workers: int | None = None,
    executor: Callable[[Job], Executor[Case, FlightResult]] | None = None,
) -> tuple[Study, list[MemberResult]]:
    """Return the entry's study and its members in the order of the seeds.

    What happens in a member is a result: a law that raises, a command that is not finite, a process
    that dies, a plan that is not found.

    Args:
        task: the benchmark problem.
        entry: what flies.
        seeds: of the members, each once.
        workers: processes; None: one per core.
        executor: returns what flies the members; None: these processes.

    Raises:
        BadInput: the entry cannot be flown at all.
        Untrusted: it names code that is not trusted.
    """
    study = entry_study(task, entry.sections, entry.trust)
    require_variant(study, study.variants[0])
    nominal = nominal_of(study, 0).trial
    for name in filter(is_user_code, user_code_names(nominal)):
        require_trust(entry.trust, name, study.source)
    plans = PlanCache()
    with phase("planning"):
        plans.keep(nominal)
    job = Job(study, plans)
    cases = iter([member_case(study, seed) for seed in seeds])
    found: dict[int, MemberResult] = {}
    pool = executor(job) if executor else Pool(job, workers or os.cpu_count() or 1)
    with closing(pool):
        for results in count_results(pool.fly(cases), len(seeds), "flying", "members"):
            found |= {result.number: member_of(task, result) for result in results}
    return study, [found[seed] for seed in seeds]


def member_of(task: Task, result: FlightResult) -> MemberResult:
    """Return the member of a flight; one that violates a requirement has failed."""
    metrics = result.metrics if result.status == "ok" else {}
    reason = violation(task, metrics) if metrics else result.reason or "no metrics"
    score = score_of(task, metrics or None)
    return MemberResult(result.number, score, reason, metrics, digest_of(metrics))


def digest_of(metrics: Metrics) -> str:
    """Return the SHA-256 of metrics: every bit counts."""
    return hashlib.sha256(json.dumps(dict(metrics), sort_keys=True).encode()).hexdigest()


def failures(members: Sequence[MemberResult]) -> list[tuple[str, int]]:
    """Return the reasons of failed members with their counts, the most frequent first."""
    return Counter(member.reason for member in members if member.reason).most_common()
