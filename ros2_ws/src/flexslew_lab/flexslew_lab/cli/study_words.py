"""What a terminal shows of a study: how far it is, and what it found."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import timedelta
from time import monotonic
from typing import Any

from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
)

from flexslew_lab.cli.terminal import for_people, print_message, print_table
from flexslew_lab.json_text import json_text
from flexslew_lab.short_values import short
from flexslew_lab.studies.execution.pace import RemainingTime
from flexslew_plant.refusal import one_line

NO_ESTIMATE = "estimating the time left"
_PRINT_INTERVAL = 30.0  # between two lines where no bar can be drawn [wall s]


@contextmanager
def progress(name: str) -> Iterator[Callable[[int, int], None]]:
    """Show how far a study is and how long it will take, during a block that reports it.

    A bar on a terminal; else, in the log of a batch queue, a line now and then.
    """
    if not for_people.is_terminal:
        yield _Lines(name)
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]}"),
    )
    pace = RemainingTime()
    with Progress(*columns, console=for_people, transient=True) as bar:
        task = bar.add_task(
            f"{escape(one_line(name))} [dim]trials[/dim]", total=None, left=NO_ESTIMATE
        )

        def update(done: int, requested: int) -> None:
            pace.take(done, monotonic())
            bar.update(task, completed=done, total=requested, left=left_words(pace.left(requested)))

        yield update


class _Lines:
    """Prints the progress of a study, at most every half minute."""

    def __init__(self, name: str) -> None:
        self._name, self._pace = name, RemainingTime()
        self._start_time = self._last = monotonic()

    def __call__(self, done: int, requested: int) -> None:
        now = monotonic()
        self._pace.take(done, now)
        if now - self._last >= _PRINT_INTERVAL:
            self._last = now
            left = self._pace.left(requested)
            print_message(f"{self._name}: {far(done, requested, now - self._start_time, left)}")


def far(done: int, requested: int, seconds: float, left: float | None) -> str:
    """Return in words how far a study is.

    Args:
        done: trials, those of earlier runs too.
        requested: trials.
        seconds: since this run began [wall s].
        left: until its end [wall s]; None: not known yet.
    """
    so_far = timedelta(seconds=round(seconds))
    return f"{done} of {requested} trials, {so_far} so far, {left_words(left)}"


def left_words(left: float | None) -> str:
    """Return how long a study will take yet, in words."""
    return NO_ESTIMATE if left is None else f"{timedelta(seconds=round(left))} left"


def print_summary(found: dict[str, Any], as_json: bool) -> None:
    """Print what a study found: a table for people, or the whole summary as JSON."""
    if as_json:
        print(json_text(found))
        return
    from flexslew_lab.studies.findings.criteria import Decision
    from flexslew_lab.studies.findings.tables import (
        QUANTILE_NAMES,
        criterion_words,
        metric_tables,
        missing_words,
        pair_rows,
    )

    colors = {Decision.PASSED: "green", Decision.REJECTED: "red", Decision.UNKNOWN: "yellow"}
    rate = found["trials_per_second"]
    rows = [
        ("trials", f"{found['trials']} of {found['planned']}, {found['failed']} failed"),
        ("wall time", f"{short(found['wall_time'])} s, {short(rate)} trials/s"),
        ("flown by", short(found["ways"])),
        ("bounds from", found["sampling"]["bounds"]),
        ("table", found["table"]),
        ("report", found.get("report", "-")),
    ]
    print_table(("", found["study"]), rows)
    if words := missing_words(found):
        print_message(words, "red", head="incomplete: ")
    for label, lines in metric_tables(found).items():
        print_table(
            (label or "metric", "unit", "mean", *QUANTILE_NAMES, "failed", "missing"),
            [
                (*row[:3], *row.quantiles, row.failed or "", row.missing or "")  # name, unit, mean
                for row in lines
            ],
        )
    if found["paired"]:
        against = found["paired"][0]["against"]
        header = ("smaller / larger in", "mean difference", "median difference", "p", "pairs")
        print_table((f"against {against}", "variant", "is", *header), pair_rows(found))
    for row in found["criteria"]:
        verdict = Decision(row["verdict"])
        print_message(f" {criterion_words(row)}", head=verdict.value, head_style=colors[verdict])


def side_by_side(names: Sequence[str], found: list[dict[str, Any]]) -> None:
    """Print the 99 % quantiles of two studies side by side."""
    from flexslew_lab.studies.findings.tables import total_rows

    first, second = ({row.name: row.quantiles[-1] for row in total_rows(one)} for one in found)
    lines = [(name, value, second[name]) for name, value in first.items() if name in second]
    print_table(("99 % of", *names), lines)
