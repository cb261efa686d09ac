"""Figures of a platform that points: how far it is from its goal, and where its antennas look."""

import numpy as np

from flexslew_lab.report.figures.drawing import marks
from flexslew_lab.report.panels import Entry, Group, Panel, legend, style
from flexslew_lab.report.run_data import RunData
from flexslew_plant.testbeds.contract import HasLinesOfSight, LineOfSight, Pointing

_AXES = ("x", "y", "z")
_FLOOR = 1e-9  # that a logarithmic scale shows [rad]


def platform(run: RunData) -> Group | None:
    """Return platform error, hinges and lines of sight over time; None of other testbeds."""
    testbed, position, time = run.testbed, run.frame_position, run.frame_time
    if not isinstance(testbed, Pointing) or position.ndim != 2:
        return None
    model = testbed.model()
    if position.shape[1] != model.positions:
        return None
    rates = np.zeros((len(position), model.coordinates))
    m = testbed.motions(position, rates, run.goal)
    panels = []
    for title, unit, error in (
        ("platform position error", "m", m.away),
        ("platform attitude error", "rad", m.attitude),
    ):
        panel = Panel(title, unit, x_title="time [s]")
        for k, axis in enumerate(_AXES):
            panel.line(time, error[:, k], axis, style(k))
        panels.append(panel)
    found: dict[str, LineOfSight] = {}
    if isinstance(testbed, HasLinesOfSight):
        found = testbed.lines_of_sight(time, position, run.goal)
    panels += _antennas(run, found)
    names = tuple(Entry(entry.name, entry.colour, entry.dash) for entry in legend([*_AXES, *found]))
    for panel in panels:
        panel.x_range = (float(time[0]), float(time[-1]))
    words = "How far the platform is from its goal"
    words += (
        ", the angles of the hinges, and the angle between where each antenna looks and its target."
        if found
        else "."
    )
    return Group(
        "Platform and antennas" if found else "Platform", words, panels, names, marks([run])
    )


def _antennas(run: RunData, found: dict[str, LineOfSight]) -> list[Panel]:
    """Return hinge angles and line-of-sight errors, one curve per antenna."""
    if not found:
        return []
    hinges = Panel("hinges", "rad", x_title="time [s]")
    errors = Panel("line of sight from its target", "rad", log=True, x_title="time [s]", height=190)
    for k, (name, sight) in enumerate(found.items(), start=len(_AXES)):
        hinges.line(run.frame_time, sight.hinge, name, style(k))
        errors.line(run.frame_time, np.maximum(sight.error, _FLOOR), name, style(k))
    seen = np.concatenate([sight.error for sight in found.values()])
    errors.y_range = (max(float(seen.min()), _FLOOR), max(float(seen.max()), 10.0 * _FLOOR))
    return [hinges, errors]
