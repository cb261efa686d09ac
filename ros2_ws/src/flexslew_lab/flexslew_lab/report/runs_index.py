"""The runs of a folder with their key figures, for a table and for a page to filter and compare."""

import json
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

from flexslew_lab.metrics.rows import flat, unit_of
from flexslew_lab.report.page import render, write_page
from flexslew_lab.report.run_notes import read_notes
from flexslew_lab.report.thumbnail import THUMBNAIL
from flexslew_lab.report.verdict import joints_to_move, run_summary
from flexslew_lab.short_values import in_columns, short
from flexslew_lab.trial.trial import Trial
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import given_text
from flexslew_plant.yaml_data import load_yaml

PAGE = "index.html"
FIGURES = ("residual_tip_deflection", "settling_time", "peak_effort", "saturated_time")
_SETTLING_TIME = "settling_time"  # of joints with a commanded move
_OPERATOR = {True: "changed", False: "untouched", None: ""}
_LARGE = 1 << 22  # no metrics.json or trial.yaml of ours is larger [B]


class Run(NamedTuple):
    """One run as its folder describes it."""

    folder: Path
    finished: str  # local time at which its metrics were written
    trial: str
    law: str  # the controller in charge at the start
    planner: str
    testbed: str
    operator: str  # changed or untouched; empty: unknown from its log
    verdict: str
    note: str
    tags: tuple[str, ...]
    figures: dict[str, float | None]  # the worst joint where there are several
    metrics: dict[str, Any]  # all of them, by dotted name

    @property
    def report(self) -> str:
        """Its report, as seen from the page; empty where it has none."""
        exists = (self.folder / "report.html").is_file()
        return f"{self.folder.name}/report.html" if exists else ""

    @property
    def picture(self) -> str:
        """Its thumbnail, as seen from the page; empty where it has none."""
        exists = (self.folder / THUMBNAIL).is_file()
        return f"{self.folder.name}/{THUMBNAIL}" if exists else ""


def runs_in(
    folder: Path, trial: str = "", law: str = "", testbed: str = ""
) -> tuple[list[Run], list[str]]:
    """Return the runs of a folder, newest first, and the names of those that cannot be read.

    Args:
        folder: with one folder per run.
        trial: only runs of this trial; empty: of all. The same for law and testbed.
        law: in charge at the start.
        testbed: its kind.
    """
    found, invalid_names = [], []
    for path in folder.glob("*/metrics.json"):
        try:
            found.append((path.stat().st_mtime, _run(path.parent)))
        except (OSError, ValueError, TypeError, AttributeError, BadInput):
            invalid_names.append(path.parent.name)
    conditions = (("trial", trial), ("law", law), ("testbed", testbed))
    rows = [run for _, run in sorted(found, key=lambda pair: pair[0], reverse=True)]
    return [
        run for run in rows if all(getattr(run, k) == v for k, v in conditions if v)
    ], invalid_names


def write_index(folder: Path) -> Path:
    """Return the page over all runs of a folder that was written into it."""
    rows, invalid_names = runs_in(folder)
    columns = [(key, unit_of(key, ())) for key in FIGURES]
    cells = {run.folder: [run.figures[key] for key in FIGURES] for run in rows}
    texts = dict(zip(cells, in_columns(cells.values(), 3), strict=True))
    page = render("runs.html.j2", figures=False, runs=rows, texts=texts, unread=invalid_names,
                  columns=columns, choices=_choices(rows), data=_comparison_data(rows))  # fmt: skip
    return write_page(page, folder / PAGE)


def _run(folder: Path) -> Run:
    """Return a run from its files.

    Raises:
        OSError, ValueError, TypeError, AttributeError, BadInput: if they are not as of a run.
    """
    file = folder / "metrics.json"
    metrics = json.loads(_text(file))
    trial = load_yaml(_text(folder / "trial.yaml"), str(folder)) or {}
    joints, changes = joints_to_move(metrics), metrics.get("operator_changes")
    return Run(
        folder,
        datetime.fromtimestamp(file.stat().st_mtime).strftime("%Y-%m-%d %H:%M"),
        str(trial.get("name", "")),
        str(trial.get("active", "")),
        str((trial.get("plan") or {}).get("method", "none")),
        str((trial.get("testbed") or {}).get("kind", "")),
        _OPERATOR[changes if changes is None else bool(changes)],
        run_summary(metrics, {}, trial.get("goal_tolerance", Trial.goal_tolerance), changes or 0),
        *read_notes(folder),
        {
            key: _largest(metrics.get(key), joints if key == _SETTLING_TIME else ())
            for key in FIGURES
        },
        flat(metrics),
    )


def _text(file: Path) -> str:
    return given_text(file, _LARGE)


def _largest(value: Any, joints: Sequence[str]) -> float | None:
    """Return a number, of several joints the largest; None where one has none."""
    if not isinstance(value, dict):
        return None if value is None else float(value)
    each = [value.get(name) for name in joints] or list(value.values())
    return None if not each or None in each else max(float(v) for v in each if v is not None)


def _choices(rows: Sequence[Run]) -> dict[str, list[str]]:
    """Return by what the runs can be filtered, with the values that there are."""
    keys = ("trial", "law", "planner", "testbed", "operator")
    return {key: sorted({getattr(run, key) for run in rows}) for key in keys}


def _comparison_data(rows: Sequence[Run]) -> dict[str, Any]:
    """Return what the page's script compares, and the units of the metrics that have one."""
    units = {key: unit_of(key, ()) for run in rows for key in run.metrics}
    return {"runs": [_plain(run) for run in rows], "units": {k: u for k, u in units.items() if u}}


def _plain(run: Run) -> dict[str, Any]:
    """Return a run as the page's script takes it, for the comparison."""
    numbers = {key: short(value, 3) for key, value in run.metrics.items()}
    return {"name": run.folder.name, "path": str(run.folder), "metrics": numbers}
