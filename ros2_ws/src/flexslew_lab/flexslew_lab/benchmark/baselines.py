"""The built-in laws as entries: which fly a task, and the results that come with the bench."""

import json
from importlib import resources
from pathlib import Path
from typing import Any

from flexslew_lab.benchmark.entry import BASELINE, BenchmarkEntry
from flexslew_lab.benchmark.flight import fly_entry
from flexslew_lab.benchmark.result import DEVELOPMENT, SeedSet, result_of
from flexslew_lab.benchmark.task import Task, task_hash
from flexslew_lab.trial.overrides import override_values
from flexslew_plant.errors import BadInput, FlexslewError
from flexslew_plant.given_file import given_text
from flexslew_plant.settings import plain
from flexslew_plant.yaml_data import load_yaml

_FOLDER = Path(str(resources.files("flexslew_lab"))) / "benchmark"
RESULTS = _FOLDER / "leaderboard.json"
_LEFT_OUT = ("members", "files", "software")  # of a result in a leaderboard
_ENTRIES = _FOLDER / "baselines.yaml"


def baselines(task: Task) -> list[BenchmarkEntry]:
    """Return the entries of baselines.yaml for a task: its own baseline first."""
    given = load_yaml(_ENTRIES.read_text(encoding="utf-8"), str(_ENTRIES)).get(task.name) or {}
    base = plain(task.trial)
    found = [BenchmarkEntry(BASELINE, {})]
    for name, changes in given.items():
        values = override_values(base, changes)
        sections = {key.split(".")[0] for key in changes}
        found.append(BenchmarkEntry(name, {key: values[key] for key in sorted(sections)}))
    return found


def fly_baselines(
    task: Task, members: int, workers: int | None = None
) -> tuple[list[dict[str, Any]], list[str]]:
    """Return the results of all baselines without their members, and why others did not fly.

    Args:
        task: the benchmark problem.
        members: of the development seeds, from the first on.
        workers: see fly_entry.
    """
    which = SeedSet(DEVELOPMENT, "", members)
    rows, refused = [], []
    for entry in baselines(task):
        try:
            study, flown = fly_entry(task, entry, which.seeds(task), workers)
        except FlexslewError as error:
            refused.append(f"{entry.name}: {error}")
            continue
        result = result_of(task, entry, which, study, flown)
        rows.append({key: value for key, value in result.items() if key not in _LEFT_OUT})
    return rows, refused


def merged(rows: list[dict[str, Any]], others: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows of a leaderboard with those of some tasks in place of the former ones."""
    tasks = {row["task"] for row in rows}
    kept = [row for row in others if row["task"] not in tasks]
    return sorted([*kept, *rows], key=lambda row: (row["task"], -row["score"]["mean"]))


def shipped_results(task: Task) -> list[dict[str, Any]]:
    """Return the results of the baselines, without members; none where the task has changed."""
    if not RESULTS.is_file():
        return []
    rows = read_rows(RESULTS)
    return [row for row in rows if row["task_hash"] == task_hash(task)]


def read_rows(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a leaderboard's file.

    Raises:
        BadInput: it cannot be read, or holds something else.
    """
    try:
        rows = json.loads(given_text(path))
    except (ValueError, RecursionError):
        rows = None
    if not isinstance(rows, list) or not all(isinstance(r, dict) and "score" in r for r in rows):
        raise BadInput("is no leaderboard; write it with ./flexslew benchmark baselines", path)
    return rows
