"""Figures of what wheels store, and of how the platform trembles."""

import numpy as np

from flexslew_lab.report.figures.drawing import TIME, draw, marks, over, span_of
from flexslew_lab.report.panels import Group, Panel, legend, style
from flexslew_lab.report.run_data import RunData
from flexslew_plant.testbeds.spacecraft.motions import Pointing

_AXES = ("x", "y", "z")


def momentum(run: RunData) -> Group | None:
    """Return speeds and momentum of the wheels over time; None of a craft without wheels."""
    if "wheel_speed" not in run.traces or not isinstance(run.testbed, Pointing):
        return None
    wheels = list(run.metrics.get("peak_wheel_speed") or {})
    speeds = Panel("speed of the wheels", "rad/s", x_title=TIME)
    stored = Panel("momentum of the wheels, body axes", "N m s", x_title=TIME)
    for k, axis in enumerate(_AXES):
        draw(stored, run.traces["stored_momentum"], k, axis, style(k))
    for k, name in enumerate(wheels):
        draw(speeds, run.traces["wheel_speed"], k, name, style(len(_AXES) + k))
    group = Group(
        "Wheels",
        "How fast the wheels spin relative to the platform, and the momentum that all of them "
        "store.",
        [speeds, stored],
        legend([*_AXES, *wheels]),
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
    smallest = 1e-6 * float(values.max())  # below it lies rounding
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
