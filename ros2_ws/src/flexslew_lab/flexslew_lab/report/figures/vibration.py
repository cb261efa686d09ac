"""What rings: the residual after a manoeuvre, and the modes."""

from collections.abc import Sequence

import numpy as np

from flexslew_lab.report.figures.drawing import (
    TIME,
    appendages_of,
    draw,
    end_of,
    joints_of,
    marks,
    over,
    span_of,
)
from flexslew_lab.report.panels import (
    MANOEUVRE,
    Group,
    Panel,
    legend,
    style,
)
from flexslew_lab.report.run_data import RunData

MODES = 8  # at most, of a report
_ENVELOPE = 160  # points of the residual
_DECADES = 1e-6  # of the residual's largest value: rounding errors are below it


def residual(runs: Sequence[RunData]) -> Group | None:
    """Return what is left after the manoeuvre, logarithmic; None where no run gets that far."""
    available = [
        (k, run) for k, run in enumerate(runs) if run.goal and end_of(run) < span_of([run])[1]
    ]
    if not available:
        return None
    late = [run for _, run in available]
    panels = []
    for name, unit in joints_of(late):
        panel = Panel(f"error of {name}", unit, log=True, x_title=TIME)
        for number, run in available:
            if name in run.joint_names and name in run.goal:
                at = run.joint_names.index(name)
                _envelope(panel, run, "position", at, run.goal[name], number)
        panels.append(panel)
    for name in appendages_of(late):
        panel = Panel(f"tip deflection of {name}", "m", log=True, x_title=TIME)
        for number, run in available:
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
    start = min(end_of(run) for run in late)
    return over(group, (start, span_of(late)[1])) if group.panels else None


def modes(runs: Sequence[RunData]) -> Group | None:
    """Return the modal coordinates, one panel per mode; None where there are none."""
    count = max((run.traces["modes"].value.shape[1] for run in runs if "modes" in run.traces),
                default=0)  # fmt: skip
    panels = []
    for k in range(min(count, MODES)):
        panel = Panel(f"mode {k + 1}", "m", x_title=TIME, height=110)
        for number, run in enumerate(runs):
            draw(panel, run.traces.get("modes"), k, run.label, style(number))
        panels.append(panel)
    if not panels:
        return None
    words = "Modal coordinates of the truth, one panel per mode, each with a scale of its own."
    if count > MODES:
        words += f" The first {MODES} of {count} are shown."
    names = legend([run.label for run in runs]) if len(runs) > 1 else ()
    return over(Group("Modes", words, panels, names, marks(runs)), span_of(runs))


def _envelope(panel: Panel, run: RunData, key: str, column: int, goal: float, number: int) -> None:
    """Add the largest |value - goal| of each interval after the manoeuvre's end."""
    trace = run.traces.get(key)
    if trace is None or column >= trace.value.shape[1]:
        return
    time, error = trace.time[:, column], np.abs(trace.value[:, column] - goal)
    late = (time >= end_of(run) - 1e-9) & np.isfinite(error)
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
