"""What all figures of runs share: their names, their range of time, and what is marked in them."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from flexslew_lab.report.panels import (
    DISTURBANCE,
    FAULT,
    LIGHT,
    LINE,
    MANOEUVRE,
    Group,
    Mark,
    Panel,
)
from flexslew_lab.report.run_data import RunData
from flexslew_lab.report.thinning import Trace
from flexslew_lab.report.verdict import joints_to_move
from flexslew_plant.arrays import Vector
from flexslew_plant.events import IN_CHARGE, FaultChanged, Level, kind_of

MARKS = 20  # at most, of a report
TIME = "time [s]"
REFERENCE = {"color": LINE, "width": 1.3, "dash": "dot"}


def marks(runs: Sequence[RunData]) -> tuple[Mark, ...]:
    """Return manoeuvres, disturbances, faults and changes of the controller, in order of time."""
    found: dict[Mark, list[str]] = {}  # with the runs that have it
    for run in runs:
        start, end = run.metrics["manoeuvre_start"], run.metrics["manoeuvre_end"]
        run_marks = [Mark("manoeuvre", start, end, MANOEUVRE)] if end > start else []
        run_marks += [
            Mark(
                span.words,
                span.start,
                span.end,
                FAULT if span.kind == kind_of(FaultChanged) else DISTURBANCE,
            )
            for span in run.spans
        ]
        run_marks += [
            Mark(
                event.message,
                event.time,
                event.time,
                FAULT if event.level is Level.FAULT else LIGHT,
            )
            for event in run.overview.events
            if isinstance(event.what, IN_CHARGE)
        ]
        for mark in run_marks:
            found.setdefault(mark, []).append(run.label)
    shared = [
        mark if len(labels) == len(runs) else mark._replace(label=f"{mark.label} in {labels[0]}")
        for mark, labels in found.items()
    ]
    return tuple(sorted(shared, key=lambda mark: mark.start)[:MARKS])


def draw(
    panel: Panel, trace: Trace | None, column: int, name: str, line_style: dict[str, Any],
    nonzero: bool = False,
) -> None:  # fmt: skip
    """Add a column of a trace to a panel, where there is such a column with a number in it."""
    if trace is None or column >= trace.value.shape[1]:
        return
    value = trace.value[:, column]
    if np.isfinite(value).any() and not (nonzero and not np.nanmax(np.abs(value))):
        panel.line(trace.time[:, column], value, name, line_style)


def over(group: Group, time_range: tuple[float, float]) -> Group:
    """Return the group with one range of time, with what is drawn or shaded outside left out."""
    group.marks = tuple(
        m for m in group.marks if m.end >= time_range[0] and m.start <= time_range[1]
    )
    visible = {trace["name"] for panel in group.panels for trace in panel.traces}
    group.legend = tuple(entry for entry in group.legend if entry.name in visible)
    for panel in group.panels:
        panel.x_range = time_range
    return group


def span_of(runs: Sequence[RunData]) -> tuple[float, float]:
    """Return the first and the last time of any of the runs [s]."""
    times: list[Vector] = [run.traces["effort"].time for run in runs]
    return min(float(np.nanmin(t)) for t in times), max(float(np.nanmax(t)) for t in times)


def end_of(run: RunData) -> float:
    """Return when the manoeuvre ends [s]."""
    return float(run.metrics["manoeuvre_end"])


def joints_of(runs: Sequence[RunData]) -> list[tuple[str, str]]:
    """Return name and unit of the joints with a commanded move in any run, in the bench's order."""
    units = {name: unit for run in runs for name, unit in run.units.items()}
    active = {name for run in runs for name in joints_to_move(run.metrics)}
    return [(name, units[name]) for name in units if name in active] or list(units.items())


def excluded_joints(runs: Sequence[RunData]) -> str:
    """Return a sentence on the joints that are not drawn; empty where all are."""
    visible = dict(joints_of(runs))
    displacement: dict[tuple[str, str], float] = {}
    for run in runs:
        for name, unit, column in zip(
            run.joint_names, run.joint_units, run.traces["position"].value.T, strict=False
        ):
            if name not in visible and np.isfinite(column).any():
                known = column[np.isfinite(column)]
                way = float(np.abs(known - known[0]).max())
                displacement[name, unit] = max(displacement.get((name, unit), 0.0), way)
    if not displacement:
        return ""
    each = ", ".join(f"{name} {way:.3g} {unit}" for (name, unit), way in displacement.items())
    return f" Joints without a commanded move are left out; they went at most: {each}."


def appendages_of(runs: Sequence[RunData]) -> list[str]:
    """Return the readings of the appendages that deflect; all where none does."""
    names = dict.fromkeys(name for run in runs for name in run.appendage_names)
    with_deflection = {
        name
        for run in runs
        if "tip" in run.traces
        for name, column in zip(run.appendage_names, run.traces["tip"].value.T, strict=True)
        if np.nan_to_num(column).any()
    }
    return [name for name in names if name in with_deflection] or list(names)


def efforts_of(run: RunData) -> list[tuple[str, str]]:
    """Return name and unit of every drive: those of the joints, where there are as many."""
    count = run.traces["effort"].value.shape[1]
    if count == len(run.joint_names):
        units = map(effort_unit, run.joint_units)
        return list(zip(run.joint_names, units, strict=True))
    return [(f"drive {k + 1}", "N m") for k in range(count)]


def effort_unit(unit: str) -> str:
    """Return the unit of the effort on a joint with this unit."""
    return "N" if unit == "m" else "N m"
