"""The leaderboard as a page: by task a table, and the score of each entry over its effort."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from flexslew_lab.report.panels import Group, Panel, legend, style
from flexslew_lab.report.sections import Table, page_of_sections
from flexslew_lab.short_values import short

COLUMNS = ("entry", "score", "95 % bounds", "failed", "effort", "members")


def leaderboard_page(rows: Sequence[dict[str, Any]]) -> str:
    """Return the leaderboards of all tasks as HTML that needs nothing else."""
    sections: list[Table | Group] = []
    for task in dict.fromkeys(row["task"] for row in rows):
        own = [row for row in rows if row["task"] == task]
        words = "From 0, the worst, to 100; effort is the mean of control_effort."
        sections.append(Table(task, words, COLUMNS, [list(cells(row)) for row in own]))
        sections.append(_figure(task, own))
    return page_of_sections("benchmark", "Leaderboard", "", sections)


def cells(row: dict[str, Any]) -> tuple[str, ...]:
    """Return the cells of a result in the order of COLUMNS."""
    score, seeds = row["score"], row["seeds"]
    return (
        str(row["entry"]["name"]),
        f"{score['mean']:.2f}",
        f"{score['low']:.2f} to {score['high']:.2f}",
        str(row["failed"]),
        "-" if row["effort"] is None else short(row["effort"]),
        " ".join((f"{seeds['members']} {seeds['kind']}", seeds["round"])).rstrip(),
    )


def _figure(task: str, rows: Sequence[dict[str, Any]]) -> Group:
    panel = Panel("score", "-", x_title="control effort", height=320)
    known = [row for row in rows if row["effort"] is not None]
    for k, row in enumerate(known):
        point = np.array([row["effort"]]), np.array([row["score"]["mean"]])
        marker = {"size": 11, "color": style(k)["color"]}
        panel.line(*point, row["entry"]["name"], style(k), mode="markers", marker=marker)
    panel.y_range = (0.0, 100.0)
    words = "Further up and to the left is better."
    return Group(f"{task}: score over effort", words, [panel], legend([_name(r) for r in known]))


def _name(row: dict[str, Any]) -> str:
    return str(row["entry"]["name"])
