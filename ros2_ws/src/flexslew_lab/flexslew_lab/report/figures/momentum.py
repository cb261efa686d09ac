"""Figures of what wheels and gyros store, and of how the platform trembles."""

import numpy as np

from flexslew_lab.report.figures.drawing import TIME, draw, marks, over, span_of
from flexslew_lab.report.panels import Group, Panel, legend, style
from flexslew_lab.report.run_data import RunData
from flexslew_plant.testbeds.contract import Pointing

_AXES = ("x", "y", "z")
# traces, the metric by name of the actuator, title and unit
_ROTATION_PANELS = (
    ("wheel_speed", "peak_wheel_speed", "speed of the wheels", "rad/s"),
    ("gimbal_angle", "peak_gimbal_angle", "angle of the gimbals", "rad"),
)


def momentum(run: RunData) -> Group | None:
    """Return how wheels and gimbals turn and what they store; None of a craft without them."""
    if "stored_momentum" not in run.traces or not isinstance(run.testbed, Pointing):
        return None
    stored = Panel("stored momentum, body axes", "N m s", x_title=TIME)
    for k, axis in enumerate(_AXES):
        draw(stored, run.traces["stored_momentum"], k, axis, style(k))
    panels, legend_names = [], [*_AXES]
    for trace, key, title, unit in _ROTATION_PANELS:
        names = list(run.metrics.get(key) or {})
        if trace not in run.traces:
            continue
        panels.append(Panel(title, unit, x_title=TIME))
        for k, name in enumerate(names):
            draw(panels[-1], run.traces[trace], k, name, style(len(legend_names) + k))
        legend_names += names
    group = Group(
        "Stored momentum",
        "How wheels spin relative to the platform and gimbals turn, and the momentum that all of "
        "them store.",
        [*panels, stored],
        legend(legend_names),
        marks([run]),
    )
    return over(group, span_of([run]))


def jitter(run: RunData) -> Group | None:
    """Return the root mean square of the attitude error by octave; None where there is none."""
    ends, rows = run.metrics.get("jitter_frequency"), run.metrics.get("jitter")
    if not ends or not rows or not np.any(rows):
        return None
    edges = np.array([0.5 * ends[0], *ends])  # the first octave goes down to zero
    panel = Panel("attitude error by octave", "rad", log=True, x_title="frequency [Hz]", x_log=True)
    values = np.array(rows)
    smallest = 1e-6 * float(values.max())  # rounding errors are below it
    for k, axis in enumerate(_AXES):
        steps = np.repeat(np.where(values[k] > smallest, values[k], np.nan), 2)
        panel.line(np.repeat(edges, 2)[1:-1], steps, axis, style(k))
    panel.x_range = (float(np.log10(edges[0])), float(np.log10(edges[-1])))
    panel.y_range = (max(float(values[values > smallest].min()), smallest), float(values.max()))
    words = (
        "Root mean square of the attitude error after the manoeuvre's end in each octave, less the "
        "straight line of each pointing window, about the body axes; the first octave begins at 0."
    )
    return Group("Jitter", words, [panel], legend(_AXES))
