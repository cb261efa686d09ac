"""The figures of a report: groups of panels from what `read_run` thinned, for any testbed."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from flexslew_control.plan import Plan
from flexslew_lab.report.panels import (
    BROKEN,
    DISTURBED,
    INK,
    MANOEUVRE,
    PALE,
    Entry,
    Group,
    Mark,
    Panel,
    legend,
    style,
)
from flexslew_lab.report.run_data import RunData
from flexslew_lab.report.thinning import Trace
from flexslew_plant.arrays import Vector

MODES, MARKS = 8, 20  # at most, of a report
_ENVELOPE = 160  # points of the residual
_DECADES = 1e-6  # of the residual's largest value: below it lies rounding
_TIME = "time [s]"
_REFERENCE = {"color": INK, "width": 1.3, "dash": "dot"}
_FORCED = {"color": DISTURBED, "width": 1.3}


def manoeuvre(runs: Sequence[RunData]) -> Group:
    """Return joints with their reference, tips and efforts; several runs over one another."""
    group = Group(
        "The manoeuvre",
        "Joint positions with their reference, tip deflections, and the efforts that the drives "
        "applied, with the plan's feedforward and the drives' limits.",
        [*_motion(runs), *_efforts(runs)],
        (
            *legend([run.label for run in runs]),
            Entry("reference", INK, "dot"),
            Entry("feedforward", INK, "dash"),
            Entry("disturbance", DISTURBED),
        ),
        marks(runs),
    )
    return _over(group, _span(runs))


def compared(runs: Sequence[RunData]) -> Group:
    """Return joints and tips of a run with and without feedforward."""
    group = Group(
        "With and without feedforward",
        "The same trial flown by feedback alone: the difference is what the plan is worth.",
        _motion(runs),
        (*legend([run.label for run in runs]), Entry("reference", INK, "dot")),
        marks(runs[:1]),
    )
    return _over(group, _span(runs))


def residual(runs: Sequence[RunData]) -> Group | None:
    """Return what is left after the manoeuvre, logarithmic; None where no run gets that far."""
    numbered = [(k, run) for k, run in enumerate(runs) if run.goal and _end(run) < _span([run])[1]]
    if not numbered:
        return None
    late = [run for _, run in numbered]
    panels = []
    for name, unit in _joints(late):
        panel = Panel(f"error of {name}", unit, log=True, x_title=_TIME)
        for number, run in numbered:
            if name in run.joint_names and name in run.goal:
                at = run.joint_names.index(name)
                _envelope(panel, run, "position", at, run.goal[name], number)
        panels.append(panel)
    for name in _appendages(late):
        panel = Panel(f"tip deflection of {name}", "m", log=True, x_title=_TIME)
        for number, run in numbered:
            if name in run.appendage_names:
                _envelope(panel, run, "tip", run.appendage_names.index(name), 0.0, number)
        panels.append(panel)
    group = Group(
        "After the manoeuvre",
        "What is left once the plan has ended: the largest magnitude in each interval, on a "
        "logarithmic scale.",
        [panel for panel in panels if panel.traces],
        legend([run.label for run in runs]),
        tuple(m for m in marks(late) if m.colour != MANOEUVRE),
    )
    start = min(_end(run) for run in late)
    return _over(group, (start, _span(late)[1])) if group.panels else None


def modes(runs: Sequence[RunData]) -> Group | None:
    """Return the modal coordinates, one panel per mode; None where there are none."""
    count = max((run.traces["modes"].value.shape[1] for run in runs if "modes" in run.traces),
                default=0)  # fmt: skip
    panels = []
    for k in range(min(count, MODES)):
        panel = Panel(f"mode {k + 1}", "m", x_title=_TIME, height=110)
        for number, run in enumerate(runs):
            _draw(panel, run.traces.get("modes"), k, run.label, style(number))
        panels.append(panel)
    if not panels:
        return None
    words = "Modal coordinates of the truth, one panel per mode, each with a scale of its own."
    if count > MODES:
        words += f" The first {MODES} of {count} are shown."
    names = legend([run.label for run in runs]) if len(runs) > 1 else ()
    return _over(Group("Modes", words, panels, names, marks(runs)), _span(runs))


def estimation(run: RunData) -> Group | None:
    """Return estimate minus truth; None where there is no estimate or it is exact throughout."""
    trace = run.traces.get("estimate_error")
    if trace is None or not np.nanmax(np.abs(trace.value), initial=0.0):
        return None
    joints = len(run.joint_names)
    panels = []
    for unit in dict.fromkeys(run.joint_units):
        panel = Panel("joints", unit, x_title=_TIME)
        for k, (name, own) in enumerate(zip(run.joint_names, run.joint_units, strict=True)):
            if own == unit:
                _draw(panel, trace, k, name, style(k))
        panels.append(panel)
    count = max(trace.value.shape[1] - joints, 0)
    panel = Panel("modes", "m", x_title=_TIME)
    for k in range(count):
        _draw(panel, trace, joints + k, f"mode {k + 1}", style(joints + k))
    names = [*run.joint_names, *(f"mode {k + 1}" for k in range(count))]
    group = Group(
        "Estimate minus truth",
        "Error of the estimate of the controller in charge.",
        [p for p in [*panels, panel] if p.traces],
        legend(names),
        marks([run]),
    )
    return _over(group, _span([run])) if group.panels else None


def effort_terms(run: RunData) -> Group | None:
    """Return the terms of the effort, joint by joint; None where none were logged."""
    drawn = {name: t for name, t in run.terms.items() if np.nanmax(np.abs(t.value), initial=0.0)}
    if not drawn:
        return None
    panels = []
    for k, (name, unit) in enumerate(_efforts_of(run)):
        panel = Panel(f"effort on {name}", unit, x_title=_TIME)
        for number, (term, trace) in enumerate(drawn.items()):
            _draw(panel, trace, k, term, style(number))
        _draw(panel, run.traces.get("demand"), k, "their sum", _REFERENCE)
        panels.append(panel)
    group = Group(
        "Terms of the effort",
        "The terms that the controller in charge added up, before the drive's limits.",
        [panel for panel in panels if panel.traces],
        (*legend(list(drawn)), Entry("their sum", INK, "dot")),
        marks([run]),
    )
    return _over(group, _span([run]))


def planned(plan: Plan, units: Sequence[str], limits: Sequence[float]) -> Group:
    """Return the reference and the feedforward of a plan, joint by joint.

    Args:
        plan: what to draw.
        units: of the joints, rad or m.
        limits: of the drives, one per joint [N m or N].
    """
    time: Vector = np.asarray(plan.start + plan.period * np.arange(plan.ticks + 1), dtype=float)
    panels = []
    for k, (name, unit) in enumerate(zip(plan.joint_names, units, strict=True)):
        panel = Panel(f"{name}, position", unit, x_title=_TIME)
        panel.line(time, plan.position[:, k], "reference", style(0))
        panels.append(panel)
        panel = Panel(f"{name}, velocity", f"{unit}/s", x_title=_TIME)
        panel.line(time, plan.velocity[:, k], "reference", style(0))
        panels.append(panel)
    for k, (name, unit) in enumerate(zip(plan.joint_names, units, strict=True)):
        effort = plan.effort[:, k]
        peak = float(np.abs(effort).max(initial=0.0))
        panel = _with_limit(f"effort on {name}", _effort_unit(unit), peak, limits[k])
        held = {"color": style(1)["color"], "shape": "hv"}
        panel.line(time, np.append(effort, effort[-1:]), "feedforward", held)
        panels.append(panel)
    words = f"{plan.method}, {plan.duration:g} s from {plan.start:g} s on."
    group = Group("The plan", words, panels, legend(["reference", "feedforward"]))
    return _over(group, (float(time[0]), float(time[-1])))


def marks(runs: Sequence[RunData]) -> tuple[Mark, ...]:
    """Return manoeuvres, disturbances, faults and changes of the controller, in order of time."""
    found: dict[Mark, list[str]] = {}  # with the runs that have it
    for run in runs:
        start, end = run.metrics["manoeuvre_start"], run.metrics["manoeuvre_end"]
        own = [Mark("manoeuvre", start, end, MANOEUVRE)] if end > start else []
        own += [
            Mark(span.words, span.start, span.end, BROKEN if span.kind == "fault" else DISTURBED)
            for span in run.spans
        ]
        own += [
            Mark(event.message, event.time, event.time, BROKEN if event.level == "fault" else PALE)
            for event in run.overview.events
            if event.kind in ("switched", "fallback", "brake")
        ]
        for mark in own:
            found.setdefault(mark, []).append(run.label)
    shared = [
        mark if len(whose) == len(runs) else mark._replace(label=f"{mark.label} in {whose[0]}")
        for mark, whose in found.items()
    ]
    return tuple(sorted(shared, key=lambda mark: mark.start)[:MARKS])


def _motion(runs: Sequence[RunData]) -> list[Panel]:
    """Return one panel per joint, with its reference, and one per appendage."""
    panels = []
    for name, unit in _joints(runs):
        panel = Panel(name, unit, x_title=_TIME)
        having = [(k, run) for k, run in enumerate(runs) if name in run.joint_names]
        for number, run in having:
            at = run.joint_names.index(name)
            _draw(panel, run.traces.get("position"), at, run.label, style(number))
        run = having[0][1]
        at = run.joint_names.index(name)
        _draw(panel, run.traces.get("reference"), at, "reference", _REFERENCE)
        panels.append(panel)
    for name in _appendages(runs):
        panel = Panel(f"tip deflection of {name}", "m", x_title=_TIME)
        for number, run in enumerate(runs):
            if name in run.appendage_names:
                at = run.appendage_names.index(name)
                _draw(panel, run.traces.get("tip"), at, run.label, style(number))
        panels.append(panel)
    return panels


def _efforts(runs: Sequence[RunData]) -> list[Panel]:
    """Return one panel per drive, with feedforward, disturbance and limits."""
    panels = []
    for name, unit in dict.fromkeys(pair for run in runs for pair in _efforts_of(run)):
        having = [(k, run) for k, run in enumerate(runs) if (name, unit) in _efforts_of(run)]
        first = having[0][1]
        column = _efforts_of(first).index((name, unit))
        testbed = first.overview.testbed
        known = testbed is not None and len(testbed.effort_limit) > column
        limit = float(testbed.effort_limit[column]) if known else np.inf
        efforts = [run.traces["effort"].value[:, _efforts_of(run).index((name, unit))]
                   for _, run in having]  # fmt: skip
        peak = max(float(np.nanmax(np.abs(effort), initial=0.0)) for effort in efforts)
        panel = _with_limit(f"effort on {name}", unit, peak, limit)
        for number, run in having:
            own = _efforts_of(run).index((name, unit))
            _draw(panel, run.traces["effort"], own, run.label, style(number))
        dashed = {"color": INK, "width": 1.2, "dash": "dash"}
        _draw(panel, first.traces.get("feedforward"), column, "feedforward", dashed)
        forced = first.traces.get("disturbance")
        _draw(panel, forced, column, "disturbance", _FORCED, nonzero=True)
        panels.append(panel)
    return panels


def _with_limit(title: str, unit: str, peak: float, limit: float) -> Panel:
    """Return a panel of an effort that names its limit, and shows it where efforts come near."""
    if not np.isfinite(limit):
        return Panel(title, unit, x_title=_TIME)
    panel = Panel(f"{title}, limit ±{limit:g} {unit}", unit, x_title=_TIME)
    if peak > 0.15 * limit:
        panel.limits = (-limit, limit)
        panel.y_range = (-1.06 * max(limit, peak), 1.06 * max(limit, peak))
    return panel


def _draw(
    panel: Panel, trace: Trace | None, column: int, name: str, look: dict[str, Any],
    nonzero: bool = False,
) -> None:  # fmt: skip
    if trace is None or column >= trace.value.shape[1]:
        return
    value = trace.value[:, column]
    if np.isfinite(value).any() and not (nonzero and not np.nanmax(np.abs(value))):
        panel.line(trace.time[:, column], value, name, look)


def _envelope(panel: Panel, run: RunData, key: str, column: int, goal: float, number: int) -> None:
    """Add the largest |value - goal| of each interval after the manoeuvre's end."""
    trace = run.traces.get(key)
    if trace is None or column >= trace.value.shape[1]:
        return
    time, error = trace.time[:, column], np.abs(trace.value[:, column] - goal)
    late = (time >= _end(run) - 1e-9) & np.isfinite(error)
    time, error = time[late], error[late]
    if not error.size or not error.max():
        return
    parts = np.array_split(np.arange(error.size), min(_ENVELOPE, error.size))
    largest = np.array([error[part].max() for part in parts])
    largest[largest < _DECADES * largest.max()] = np.nan
    panel.line(np.array([time[part].mean() for part in parts]), largest, run.label, style(number))
    low, high = np.nanmin(largest), largest[np.isfinite(largest)].max()
    before = panel.y_range or (np.inf, 0.0)
    panel.y_range = (min(before[0], 0.7 * float(low)), max(before[1], 1.4 * float(high)))


def _over(group: Group, shown: tuple[float, float]) -> Group:
    """Return the group with one range of time, with what is drawn or shaded outside left out."""
    group.marks = tuple(m for m in group.marks if m.end >= shown[0] and m.start <= shown[1])
    drawn = {trace["name"] for panel in group.panels for trace in panel.traces}
    group.legend = tuple(entry for entry in group.legend if entry.name in drawn)
    for panel in group.panels:
        panel.x_range = shown
    return group


def _span(runs: Sequence[RunData]) -> tuple[float, float]:
    times: list[Vector] = [run.traces["effort"].time for run in runs]
    return min(float(np.nanmin(t)) for t in times), max(float(np.nanmax(t)) for t in times)


def _end(run: RunData) -> float:
    return float(run.metrics["manoeuvre_end"])


def _joints(runs: Sequence[RunData]) -> list[tuple[str, str]]:
    """Return name and unit of every joint of any of the runs, those of the first one first."""
    return list(
        dict.fromkeys(
            pair for run in runs for pair in zip(run.joint_names, run.joint_units, strict=True)
        )
    )


def _appendages(runs: Sequence[RunData]) -> list[str]:
    """Return the readings of the appendages that deflect; all where none does."""
    names = dict.fromkeys(name for run in runs for name in run.appendage_names)
    bent = {
        name
        for run in runs
        if "tip" in run.traces
        for name, column in zip(run.appendage_names, run.traces["tip"].value.T, strict=True)
        if np.nan_to_num(column).any()
    }
    return [name for name in names if name in bent] or list(names)


def _efforts_of(run: RunData) -> list[tuple[str, str]]:
    """Return name and unit of every drive: those of the joints, where there are as many."""
    count = run.traces["effort"].value.shape[1]
    if count == len(run.joint_names):
        units = map(_effort_unit, run.joint_units)
        return list(zip(run.joint_names, units, strict=True))
    return [(f"drive {k + 1}", "N m") for k in range(count)]


def _effort_unit(unit: str) -> str:
    return "N" if unit == "m" else "N m"
