"""The result file of an entry: what flew, where, with which seeds; sealed by its own SHA-256."""

import json
import platform
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from llvmlite.binding import get_host_cpu_name

from flexslew_lab.benchmark.entry import BenchmarkEntry
from flexslew_lab.benchmark.flight import EFFORT, MemberResult, fly_entry
from flexslew_lab.benchmark.score import Score, ensemble_score
from flexslew_lab.benchmark.task import (
    Task,
    development_seeds,
    evaluation_seeds,
    load_task,
    task_hash,
)
from flexslew_lab.studies.batch.tolerance import TOLERANCE, relative_difference
from flexslew_lab.studies.cases import nominal_of
from flexslew_lab.studies.identity import study_versions
from flexslew_lab.studies.seals import json_with_digest, opened_json
from flexslew_lab.studies.study import Study
from flexslew_lab.trial.own_code import user_code_names
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import given_text
from flexslew_plant.own_code import Trust, code_hash

DEVELOPMENT, EVALUATION = "development", "evaluation"
_KEYS = {
    *("task", "version", "task_hash", "entry", "files", "seeds", "software", "commit"),
    *("processor", "score", "failed", "effort", "members"),
}
_GIT_TIMEOUT = 5.0  # [wall s]
_MOST_DIFFERENCES = 20  # that are listed


class SeedSet(NamedTuple):
    """Which seeds an entry flies.

    Args:
        kind: development or evaluation.
        round: published text of an evaluation round; empty otherwise.
        members: how many of the set, from its first on.
    """

    kind: str
    round: str
    members: int

    def seeds(self, task: Task) -> list[int]:
        """Return the seeds.

        Raises:
            BadInput: unknown set, a round without its text, or more members than the set has.
        """
        if self.kind not in (DEVELOPMENT, EVALUATION):
            raise BadInput(f"{DEVELOPMENT} or {EVALUATION}", key="--seeds", value=self.kind)
        if (self.kind == EVALUATION) != bool(self.round):
            words = f"belongs to --seeds {EVALUATION}: the published text of the round"
            raise BadInput(words, key="--round", value=self.round)
        if not 1 <= self.members <= task.count:
            words = f"1 to {task.count}, the size of the set"
            raise BadInput(words, key="--members", value=self.members)
        development = self.kind == DEVELOPMENT
        seeds = development_seeds(task) if development else evaluation_seeds(task, self.round)
        return list(seeds)[: self.members]


def processor_class() -> str:
    """Return the kind of processor; the same kind gives the same bits."""
    return f"{platform.machine()} {get_host_cpu_name()}"


def result_of(
    task: Task, entry: BenchmarkEntry, which: SeedSet, study: Study, members: Sequence[MemberResult]
) -> dict[str, Any]:
    """Return the result of an entry as plain data."""
    efforts = [e for m in members if (e := m.metrics.get(EFFORT)) is not None]
    return {
        "task": task.name,
        "version": task.version,
        "task_hash": task_hash(task),
        "entry": {"name": entry.name, "sections": _flown_sections(study, entry)},
        "files": {name: code_hash(name) for name in user_code_names(nominal_of(study, 0).trial)},
        "seeds": which._asdict(),
        "software": study_versions(study),
        "commit": _commit(),
        "processor": processor_class(),
        "score": ensemble_score([member.score for member in members])._asdict(),
        "failed": sum(bool(member.reason) for member in members),
        "effort": sum(efforts) / len(efforts) if efforts else None,
        "members": [_as_data(task, member) for member in members],
    }


def _flown_sections(study: Study, entry: BenchmarkEntry) -> dict[str, Any]:
    """Return the entry's sections with the contents of its files, so they are not read again."""
    return {key: study.base[key] for key in entry.sections}


def _as_data(task: Task, member: MemberResult) -> dict[str, Any]:
    names = dict.fromkeys((*task.score, *task.require, EFFORT))
    metrics = {name: member.metrics.get(name) for name in names} if member.metrics else {}
    return member._asdict() | {"metrics": metrics}


def _commit() -> str:
    """Return the commit of the source, with `-dirty` if it has changes; empty outside of git.

    An installed package may lie in the repository of another project, which does not track it.
    """
    here = Path(__file__)
    tracked = _git(here.parent, "ls-files", here.name)
    return _git(here.parent, "describe", "--always", "--dirty") if tracked else ""


def _git(folder: Path, *words: str) -> str:
    command = ["git", "-C", str(folder), *words]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=_GIT_TIMEOUT, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip()


def result_text(result: dict[str, Any]) -> str:
    """Return the text of a result file, with its seal."""
    return json_with_digest(result)


def read_result(path: Path) -> dict[str, Any]:
    """Return the content of a result file.

    Raises:
        BadInput: it cannot be read, is no result, or was changed after it was written.
    """
    values = opened_json(path)
    if missing := _KEYS - values.keys():
        words = f"is no result of the benchmark: {', '.join(sorted(missing))} is missing"
        raise BadInput(words, path)
    if json.loads(given_text(path)) != json.loads(json_with_digest(values)):
        raise BadInput("has no seal; write it again with ./flexslew benchmark run", path)
    return values


def score_in(result: dict[str, Any]) -> Score:
    """Return the score of a result."""
    return Score(**result["score"])


def verify_result(
    result: dict[str, Any],
    source: str,
    trust: Trust,
    workers: int | None = None,
    fly: Callable[..., tuple[Study, list[MemberResult]]] = fly_entry,
) -> list[str]:
    """Return the differences between a result and its members flown again; empty: none.

    On the same kind of processor every bit of the metrics counts, elsewhere 1e-9.

    Args:
        result: see read_result.
        source: its file, for messages.
        trust: classes of the user's own that it may name.
        workers: see fly_entry.
        fly: flies an entry, as fly_entry.

    Raises:
        BadInput: its task is not known here, or the entry cannot be flown.
    """
    task = load_task(str(result["task"]))
    if result["task_hash"] != task_hash(task):
        return [f"task_hash: the task {task.name} is another one here"]
    try:
        entry = BenchmarkEntry(result["entry"]["name"], result["entry"]["sections"], trust)
        seeds = SeedSet(**result["seeds"]).seeds(task)
        before = [MemberResult(**member) for member in result["members"]]
    except (TypeError, KeyError, AttributeError) as error:
        raise BadInput(f"is no result of the benchmark: {error}", source) from None
    if [member.seed for member in before] != seeds:
        return ["members: their seeds are not those of the set"]
    study, members = fly(task, entry, seeds, workers)
    now = result_of(task, entry, SeedSet(**result["seeds"]), study, members)
    found = [
        f"files: {name} has changed"
        for name, digest in now["files"].items()
        if result["files"].get(name) != digest
    ]
    exact = result["processor"] == now["processor"]
    again = [MemberResult(**member) for member in now["members"]]
    for old, new in zip(before, again, strict=True):
        found += _differences(old, new, exact)
    for key in ("score", "failed", "effort"):
        if not found and not _is_equal(result[key], now[key], exact):
            found.append(f"{key}: {result[key]} in the file, {now[key]} here")
    rest = len(found) - _MOST_DIFFERENCES
    return found[:_MOST_DIFFERENCES] + ([f"and {rest} more"] if rest > 0 else [])


def _differences(old: MemberResult, new: MemberResult, exact: bool) -> list[str]:
    """Return how a member differs from the one in the file."""
    place = f"seed {old.seed}"
    if bool(old.reason) != bool(new.reason):
        return [f"{place}: {old.reason or 'ok'} in the file, {new.reason or 'ok'} here"]
    found = [
        f"{place}: {name}: {value!r} in the file, {new.metrics.get(name)!r} here"
        for name, value in {**old.metrics, "score": old.score}.items()
        if not _is_equal(value, {**new.metrics, "score": new.score}.get(name), exact)
    ]
    if exact and not found and old.digest != new.digest:
        found.append(f"{place}: a metric outside of the score")
    return found


def _is_equal(old: Any, new: Any, exact: bool) -> bool:
    if isinstance(old, dict) and isinstance(new, dict):
        return old.keys() == new.keys() and all(_is_equal(old[k], new[k], exact) for k in old)
    if exact or not isinstance(old, float) or not isinstance(new, float):
        return bool(old == new)
    return relative_difference(old, new) <= TOLERANCE
