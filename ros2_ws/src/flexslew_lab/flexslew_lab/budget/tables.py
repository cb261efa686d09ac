"""A budget as tables: for a terminal, a page, LaTeX and CSV."""

from pathlib import Path
from typing import Any

from flexslew_lab.budget.budget import Budget
from flexslew_lab.budget.prove import ProvedBudget
from flexslew_lab.log.files.whole_file import write_whole
from flexslew_lab.publication.figure import format_of, latex_text
from flexslew_lab.publication.metric_table import (
    TABLE_FORMATS,
    csv_text,
    latex_number,
    latex_tabular,
)
from flexslew_lab.short_values import short

MARGIN_COLUMNS = ("requirement", "limit", "value", "margin", "of the limit [%]", "met")
PROVED_COLUMNS = ("metric", "predicted", "flown", "standard error", "inside [%]", "agrees")
_DIGITS = 3


def budget_columns(budget: Budget) -> tuple[str, ...]:
    """Return the columns of budget_rows."""
    return ("source", "axis", *budget.metrics)


def budget_rows(budget: Budget) -> list[list[str]]:
    """Return a row for each source and axis, then those of the total."""
    return [
        [words, axis, *("-" if v is None else short(v, _DIGITS) for v in values)]
        for words, axis, values in _values(budget)
    ]


def _values(budget: Budget) -> list[tuple[str, str, list[float | None]]]:
    """Return source, axis with its unit, and the values of all metrics."""
    found = []
    axes = zip(budget.axes.names, budget.axes.units, strict=True)
    named = [f"{name} [{unit}]" for name, unit in axes]
    for row in (*budget.rows, budget.total):
        for k, axis in enumerate(named):
            values = [
                float(row.bounds[m].value[k]) if m in row.bounds else None for m in budget.metrics
            ]
            found.append((row.source, axis, values))
    return found


def margin_rows(budget: Budget) -> list[tuple[str, ...]]:
    """Return a row for each requirement and axis."""
    return [
        (
            one.requirement,
            *(short(v, _DIGITS) for v in (one.limit, one.value, one.margin)),
            "-" if one.share is None else f"{100.0 * one.share:.1f}",
            "yes" if one.met else "NO",
        )
        for one in budget.margins
    ]


def proved_rows(proof: ProvedBudget) -> list[tuple[str, ...]]:
    """Return a row for each metric and axis, predicted and flown as root mean squares."""
    return [
        (
            f"{one.metric}.{one.axis}",
            *(short(v, _DIGITS) for v in (one.predicted, one.flown, one.error)),
            f"{100.0 * one.inside:.2f}",
            "yes" if one.agrees else "NO",
        )
        for one in proof.metrics
    ]


def write_budget_table(budget: Budget, to: Path) -> None:
    """Write the table of a budget.

    Args:
        budget: of a trial.
        to: file, .tex with booktabs or .csv with all digits.

    Raises:
        BadInput: if the file is not allowed.
    """
    kind = format_of(to, "--table", TABLE_FORMATS)
    to.parent.mkdir(parents=True, exist_ok=True)
    write_whole(to, _latex(budget) if kind == "tex" else _csv(budget))


def _latex(budget: Budget) -> str:
    rows: list[list[str]] = [
        [latex_text(source), latex_text(axis), *map(latex_number, values)]
        for source, axis, values in _values(budget)
    ]
    for one in budget.margins:
        words = "met" if one.met else "not met"
        value = latex_number(one.value)
        limit = f"{value} of {latex_number(one.limit)}, {words}"
        span = len(budget.metrics)
        rows.append([latex_text(one.requirement), "", f"\\multicolumn{{{span}}}{{r}}{{{limit}}}"])
    lines = [f"% {budget.verdict}", *(f"% without {text}" for text in budget.without)]
    return "\n".join([*lines, latex_tabular(budget_columns(budget), rows, 2)])


def _csv(budget: Budget) -> str:
    """Return all numbers, a line for each source, metric and axis."""
    rows: list[tuple[Any, ...]] = [
        ("source", "kind", "metric", "axis", "unit", "mean", "deviation", "value", "limit")
    ]
    limits = {one.requirement: one.limit for one in budget.margins}
    for row in (*budget.rows, budget.total):
        for metric, bound in row.bounds.items():
            for k, (axis, unit) in enumerate(
                zip(budget.axes.names, budget.axes.units, strict=True)
            ):
                limit = limits.get(f"{metric}.{axis}") if row.kind == "total" else None
                numbers = (float(bound.mean[k]), float(bound.deviation[k]), float(bound.value[k]))
                rows.append((row.source, row.kind, metric, axis, unit, *numbers, limit))
    return csv_text(rows)
