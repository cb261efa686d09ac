"""The page of a comparison: one HTML file with table, robustness and curves."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from flexslew_lab.comparison.comparison import CandidateFlight, Comparison, Entries
from flexslew_lab.comparison.winners import verdict, winner_table
from flexslew_lab.report.panels import Group, Panel, legend, style
from flexslew_lab.report.sections import Section, Table, page_of_sections
from flexslew_plant.arrays import Vector

_FAR = 30.0  # a curve beyond that many times the median candidate's is cut off [-]


class PlotMetric(NamedTuple):
    """A panel over the errors of a bench."""

    title: str
    unit: str
    x_title: str
    kind: str  # of the error: STIFFNESS or CARRIED
    of: Callable[[CandidateFlight], float]  # NaN where the bench was lost


def comparison_page(comparison: Comparison) -> str:
    """Return the comparison as HTML that needs nothing else."""
    columns = comparison.filled(comparison.columns)
    numbers = Table(
        "Numbers",
        comparison.words,
        [comparison.word, *(column.title for column in columns)],
        [(name, *cells) for name, cells in comparison.table(columns)],
        comparison.note,
        [style(k)["color"] for k in range(len(comparison.simulated_entries))],
    )
    reasons = [(entry.name, entry.refused) for entry in comparison.entries if entry.refused]
    refused = Table("Not flown", "", (), reasons)
    sections: list[Section] = [winner_table(comparison), numbers, refused, *comparison.groups]
    return page_of_sections(
        "comparison", comparison.title, comparison.about, sections, verdict(comparison)
    )


def robustness(
    simulated: Entries, plot_quantities: Sequence[PlotMetric], words: str, height: int
) -> Group:
    """Return quantities against errors of the bench, one candidate after the other."""
    panels = []
    for quantity in plot_quantities:
        panel = Panel(quantity.title, quantity.unit, log=True, height=height)
        panel.x_title = quantity.x_title
        for number, entry in enumerate(simulated):
            flights = entry.by(quantity.kind)
            x = np.array([100.0 * getattr(f, quantity.kind) for f in flights])
            y = np.array([quantity.of(f) for f in flights])
            if len(x) > 1:
                panel.line(x, y, entry.name, style(number), mode="lines+markers")
                extend_range(panel, y)
        panels.append(panel)
    names = legend([entry.name for entry in simulated])
    return Group("Robustness", words, [panel for panel in panels if panel.traces], names)


def motion(simulated: Entries, named: Sequence[tuple[str, str]]) -> Group:
    """Return the curves of the nominal flights over time; each has a name and a unit."""
    panels = [Panel(name, unit) for name, unit in named]
    for number, entry in enumerate(simulated):
        flight = entry.nominal
        for panel, values in zip(panels, flight.curves.T, strict=True):
            panel.line(flight.time, values, entry.name, {**style(number), "width": 1.4})
            panel.x_title = "time [s]"
            panel.x_range = (0.0, max(float(e.nominal.time[-1]) for e in simulated))
    for column, panel in enumerate(panels):
        _cut(panel, [entry.nominal.curves[:, column] for entry in simulated])
    names = legend([entry.name for entry in simulated])
    return Group("The flights", "On the nominal bench.", panels, names)


def extend_range(panel: Panel, values: Vector) -> None:
    """Let the panel show these values, all positive."""
    positive = values[values > 0.0]  # NaN is not
    if positive.size:
        low, high = panel.y_range or (np.inf, 0.0)
        panel.y_range = (min(low, float(positive.min())), max(high, float(positive.max())))


def _cut(panel: Panel, curves: Sequence[Vector]) -> None:
    """Let a candidate that is far off not flatten all others."""
    peaks = sorted(float(np.abs(curve).max(initial=0.0)) for curve in curves)
    middle = peaks[len(peaks) // 2] if peaks else 0.0
    if middle > 0.0 and peaks[-1] > _FAR * middle:
        low = min(float(np.min(curve)) for curve in curves)
        panel.y_range = (max(low, -_FAR * middle), _FAR * middle)
