"""The page of a comparison of laws: one HTML file with table, robustness and curves."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from flexslew_lab.comparison.laws import LawComparison, LawFlight
from flexslew_lab.comparison.quantities import ComparedQuantity
from flexslew_lab.report.page import render
from flexslew_lab.report.panels import Group, Panel, legend, style

_FAR = 30.0  # a curve beyond that many times the median law's is cut off [-]


def laws_page(comparison: LawComparison) -> str:
    """Return the comparison as HTML that needs nothing else."""
    trial = comparison.trial
    head = [f"{q.title}{f' [{q.unit}]' if q.unit else ''}" for q in comparison.quantities]
    return render(
        "laws.html.j2",
        title=f"{trial.name}: every law",
        testbed=f"{trial.testbed.kind}, {trial.testbed.modes} modes, {trial.duration:g} s",
        columns=[*head, *(f"{q.title}, worst" for q in _drawn(comparison))],
        rows=[(entry.name, cells) for entry, cells in _table(comparison)],
        refused=[(entry.name, entry.refused) for entry in comparison.entries if entry.refused],
        colours=[style(k)["color"] for k in range(len(comparison.flown))],
        groups=[robustness(comparison), motion(comparison)],
    )


def robustness(comparison: LawComparison) -> Group:
    """Return the drawn quantities against errors of stiffness and inertia, law by law."""
    panels = []
    for quantity in _drawn(comparison):
        for kind in ("stiffness", "inertia"):
            unit = f", {quantity.title}" if quantity.unit else ""
            panel = Panel(f"{quantity.title} against {kind}", quantity.unit, log=True, height=170)
            panel.x_title = f"error of the {kind} [%]{unit}"
            for number, entry in enumerate(comparison.flown):
                others = "inertia" if kind == "stiffness" else "stiffness"
                chosen = sorted(
                    (f for f in entry.flights if getattr(f, others) == 0.0),
                    key=lambda flight: getattr(flight, kind),
                )
                x = np.array([100.0 * getattr(f, kind) for f in chosen])
                y = np.array([_number(quantity, f) for f in chosen])
                if len(x) > 1:
                    panel.line(x, y, entry.name, style(number), mode="lines+markers")
                    _widen(panel, y)
            panels.append(panel)
    return Group(
        "Robustness",
        "On benches whose stiffness, or whose carrier's mass and inertia, is not what every law "
        "was designed for. A law that does not hold the bench has no point there.",
        [panel for panel in panels if panel.traces],
        legend([entry.name for entry in comparison.flown]),
    )


def motion(comparison: LawComparison) -> Group:
    """Return error, tip deflection and effort of the nominal flights over time."""
    panels = [Panel(name, unit) for name, unit in comparison.errors]
    panels += [Panel("largest tip deflection", "m"), Panel("norm of all efforts", "")]
    for number, entry in enumerate(comparison.flown):
        flight = entry.nominal
        for panel, values in zip(
            panels, (*flight.error.T, flight.tip, flight.applied), strict=True
        ):
            panel.line(flight.time, values, entry.name, {**style(number), "width": 1.4})
            panel.x_title = "time [s]"
            panel.x_range = (0.0, comparison.trial.duration)
    for panel, column in zip(panels, range(len(panels)), strict=True):
        _cut(panel, [_column(entry.nominal, column) for entry in comparison.flown])
    names = legend([entry.name for entry in comparison.flown])
    return Group("The flights", "On the nominal bench.", panels, names)


def short_table(comparison: LawComparison) -> tuple[list[str], list[list[Any]]]:
    """Return the columns and rows of a table that fits into a terminal."""
    requested = comparison.quantities
    head = ["law", *(f"{q.title}{f' [{q.unit}]' if q.unit else ''}" for q in requested)]
    return head, [[entry.name, *cells[: len(requested)]] for entry, cells in _table(comparison)]


def _table(comparison: LawComparison) -> list[tuple[Any, list[str]]]:
    """Return the numbers of each law, one for each column."""
    out = []
    for entry in comparison.flown:
        cells = [_cell(q.of(entry.nominal.metrics)) for q in comparison.quantities]
        for quantity in _drawn(comparison):
            values = [_number(quantity, flight) for flight in entry.flights]
            cells.append("lost" if not np.isfinite(values).all() else _cell(max(values)))
        out.append((entry, cells))
    return out


def _drawn(comparison: LawComparison) -> list[ComparedQuantity]:
    return [q for q in comparison.quantities if q.drawn]


def _number(quantity: ComparedQuantity, flight: LawFlight) -> float:
    """Return a quantity of a flight; NaN where the bench was lost."""
    value = None if flight.lost else quantity.of(flight.metrics)
    return float("nan") if value is None else value


def _cell(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def _column(flight: LawFlight, column: int) -> Any:
    return [*flight.error.T, flight.tip, flight.applied][column]


def _cut(panel: Panel, curves: Sequence[Any]) -> None:
    """Let a law that is far off not flatten all others."""
    peaks = sorted(float(np.abs(curve).max(initial=0.0)) for curve in curves)
    middle = peaks[len(peaks) // 2] if peaks else 0.0
    if middle > 0.0 and peaks[-1] > _FAR * middle:
        low = min(float(np.min(curve)) for curve in curves)
        panel.y_range = (max(low, -_FAR * middle), _FAR * middle)


def _widen(panel: Panel, values: Any) -> None:
    """Let the panel show these values, all positive."""
    positive = values[values > 0.0]  # NaN is not
    if positive.size:
        low, high = panel.y_range or (np.inf, 0.0)
        panel.y_range = (min(low, float(positive.min())), max(high, float(positive.max())))
