"""The page of a comparison: one HTML file with table, robustness and curves."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from flexslew_lab.comparison.comparison import ComparedFlight, Comparison, Entries
from flexslew_lab.report.panels import Group, Panel, legend, style
from flexslew_lab.report.tables import Table, tables_page
from flexslew_plant.arrays import Vector

_FAR = 30.0  # a curve beyond that many times the median candidate's is cut off [-]


class DrawnQuantity(NamedTuple):
    """A panel over the errors of a bench."""

    title: str
    unit: str
    x_title: str
    kind: str  # of the error: STIFFNESS or CARRIED
    of: Callable[[ComparedFlight], float]  # NaN where the bench was lost


def comparison_page(comparison: Comparison) -> str:
    """Return the comparison as HTML that needs nothing else."""
    columns = comparison.filled(comparison.columns)
    numbers = Table(
        "Numbers",
        comparison.words,
        [comparison.word, *(column.title for column in columns)],
        [(name, *cells) for name, cells in comparison.table(columns)],
        comparison.note,
        [style(k)["color"] for k in range(len(comparison.flown))],
    )
    refused = [(entry.name, entry.refused) for entry in comparison.entries if entry.refused]
    tables = (numbers, Table("Not flown", "", (), refused))
    return tables_page("comparison", comparison.title, comparison.about, tables, comparison.groups)


def robustness(flown: Entries, drawn: Sequence[DrawnQuantity], words: str, height: int) -> Group:
    """Return quantities against errors of the bench, one candidate after the other."""
    panels = []
    for quantity in drawn:
        panel = Panel(quantity.title, quantity.unit, log=True, height=height)
        panel.x_title = quantity.x_title
        for number, entry in enumerate(flown):
            flights = entry.by(quantity.kind)
            x = np.array([100.0 * getattr(f, quantity.kind) for f in flights])
            y = np.array([quantity.of(f) for f in flights])
            if len(x) > 1:
                panel.line(x, y, entry.name, style(number), mode="lines+markers")
                widen(panel, y)
        panels.append(panel)
    names = legend([entry.name for entry in flown])
    return Group("Robustness", words, [panel for panel in panels if panel.traces], names)


def motion(flown: Entries, named: Sequence[tuple[str, str]]) -> Group:
    """Return the curves of the nominal flights over time; each has a name and a unit."""
    panels = [Panel(name, unit) for name, unit in named]
    for number, entry in enumerate(flown):
        flight = entry.nominal
        for panel, values in zip(panels, flight.curves.T, strict=True):
            panel.line(flight.time, values, entry.name, {**style(number), "width": 1.4})
            panel.x_title = "time [s]"
            panel.x_range = (0.0, max(float(e.nominal.time[-1]) for e in flown))
    for column, panel in enumerate(panels):
        _cut(panel, [entry.nominal.curves[:, column] for entry in flown])
    names = legend([entry.name for entry in flown])
    return Group("The flights", "On the nominal bench.", panels, names)


def widen(panel: Panel, values: Vector) -> None:
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
