"""What the controller in charge knew and did: its estimate, and the terms of its effort."""

import numpy as np

from flexslew_lab.report.figures.drawing import (
    REFERENCE,
    TIME,
    draw,
    efforts_of,
    marks,
    over,
    span_of,
)
from flexslew_lab.report.panels import (
    LINE,
    Entry,
    Group,
    Panel,
    legend,
    style,
)
from flexslew_lab.report.run_data import RunData


def estimation(run: RunData) -> Group | None:
    """Return estimate minus truth; None where there is no estimate or it is exact throughout."""
    trace = run.traces.get("estimate_error")
    if trace is None or not np.nanmax(np.abs(trace.value), initial=0.0):
        return None
    joints = len(run.joint_names)
    panels = []
    for unit in dict.fromkeys(run.joint_units):
        panel = Panel("joints", unit, x_title=TIME)
        for k, (name, joint_unit) in enumerate(zip(run.joint_names, run.joint_units, strict=True)):
            if joint_unit == unit:
                draw(panel, trace, k, name, style(k))
        panels.append(panel)
    count = max(trace.value.shape[1] - joints, 0)
    panel = Panel("modes", "m", x_title=TIME)
    for k in range(count):
        draw(panel, trace, joints + k, f"mode {k + 1}", style(joints + k))
    names = [*run.joint_names, *(f"mode {k + 1}" for k in range(count))]
    group = Group(
        "Estimate minus truth",
        "Error of the estimate of the controller in charge.",
        [p for p in [*panels, panel] if p.traces],
        legend(names),
        marks([run]),
    )
    return over(group, span_of([run])) if group.panels else None


def effort_terms(run: RunData) -> Group | None:
    """Return the terms of the effort, joint by joint; None where none were logged."""
    terms = {name: t for name, t in run.terms.items() if np.nanmax(np.abs(t.value), initial=0.0)}
    if not terms:
        return None
    panels = []
    for k, (name, unit) in enumerate(efforts_of(run)):
        panel = Panel(f"effort on {name}", unit, x_title=TIME)
        for number, (term, trace) in enumerate(terms.items()):
            draw(panel, trace, k, term, style(number))
        draw(panel, run.traces.get("demand"), k, "their sum", REFERENCE)
        panels.append(panel)
    group = Group(
        "Terms of the effort",
        "The terms that the controller in charge added up, before the drive's limits.",
        [panel for panel in panels if panel.traces],
        (*legend(list(terms)), Entry("their sum", LINE, "dot")),
        marks([run]),
    )
    return over(group, span_of([run]))
