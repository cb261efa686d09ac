"""The page of a search for gains: what margin costs what residual, and what is gained."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from flexslew_lab.gains.ensemble import MemberOutcome
from flexslew_lab.gains.search import FoundGains, GainEvaluation
from flexslew_lab.report.panels import Group, Panel, legend, style
from flexslew_lab.report.sections import Table, page_of_sections
from flexslew_lab.short_values import in_columns

_FRONT = 20  # rows of the table, at most


def gains_page(found: FoundGains, name: str) -> str:
    """Return the search as HTML that needs nothing else."""
    sections = (_comparison_table(found), _front(found), _trade_off(found))
    title = f"{name}: gains of {found.gains.controller}"
    return page_of_sections("gains", title, "", sections, found.verdict)


def summary_rows(found: FoundGains) -> list[tuple[str, ...]]:
    """Return the trial's gains and the best ones, with what they do."""
    ones = [1.0] * len(found.gains.shipped)
    rows = (
        ("in the trial", *_cells(found.gains.times(ones), found.shipped)),
        ("found", *_cells(found.gains.times(found.best.factors), found.best.outcome)),
    )
    return [tuple(row) for row in in_columns(rows)]


def columns(found: FoundGains) -> tuple[str, ...]:
    """Return the headings of summary_rows."""
    return ("", *found.gains.shipped, "worst residual [m]", "worst effort", "disk margin")


def _cells(gains: dict[str, Any], outcome: MemberOutcome) -> list[str | float]:
    numbers = [", ".join(f"{v:.5g}" for v in np.atleast_1d(value)) for value in gains.values()]
    return [*numbers, *map(float, outcome)]


def _comparison_table(found: FoundGains) -> Table:
    words = (
        "The largest deflection of a tip after the manoeuvre and the largest integral of squared "
        "efforts, over benches with +-20 % of stiffness and payload; the disk margin at the "
        "plant's input of the nominal one, where the manoeuvre ends."
    )
    return Table("What was found", words, columns(found), [list(r) for r in summary_rows(found)])


def _front(found: FoundGains) -> Table:
    front = found.front
    rows = np.unique(np.linspace(0, len(front) - 1, min(len(front), _FRONT)).round().astype(int))
    entries = in_columns(
        _cells(found.gains.times(front[k].factors), front[k].outcome) for k in rows
    )
    words = "None that was tried has both a smaller residual and a larger margin."
    return Table("What the margin costs", words, columns(found)[1:], entries)


def _trade_off(found: FoundGains) -> Group:
    panel = Panel("worst residual", "m", log=True, x_title="disk margin [-]", height=320)
    shipped = GainEvaluation((1.0,), found.shipped)
    entries = (("tried", found.tried), ("front", found.front), ("in the trial", (shipped,)),
             ("found", (found.best,)))  # fmt: skip
    for k, (name, ones) in enumerate(entries):
        x, y = _points(ones)
        mode = "lines+markers" if name == "front" else "markers"
        marker = {"size": 5 if name in ("tried", "front") else 11, "color": style(k)["color"]}
        panel.line(x, y, name, style(k), mode=mode, marker=marker)
    _, every = _points(found.tried)
    panel.y_range = (float(every.min()), float(every.max()))
    words = f"Every choice that was tried; a disk margin of {found.least:.4g} had to be kept."
    return Group("Trade-off", words, [panel], legend([name for name, _ in entries]))


def _points(ones: Sequence[GainEvaluation]) -> tuple[Any, Any]:
    """Return margins and residuals of those that fly."""
    kept = [one.outcome for one in ones if np.isfinite(one.outcome.residual)]
    return np.array([o.alpha for o in kept]), np.array([o.residual for o in kept])
