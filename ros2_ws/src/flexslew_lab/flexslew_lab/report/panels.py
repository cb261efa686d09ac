"""Panels of a page: one plot each, with its title and legend in HTML, where nothing can collide."""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from flexslew_plant.arrays import Matrix, Vector

LINE, GRID, LIGHT = "#1d2733", "#e4e8ee", "#8a97a8"
COLOURS = ("#0b6bcb", "#e0592a", "#1a9a6c", "#9a4fc4", "#c79100", "#c2375f", "#2aa3b8", "#6b7280")
LINE_STYLES = ("solid", "dash", "dot", "dashdot")  # to distinguish curves after the last colour
MANOEUVRE, DISTURBANCE, FAULT = "#0b6bcb", "#9a4fc4", "#c2375f"
_SINGLE = 1e4  # largest place on an axis that single precision holds to a thousandth
_ROUNDING = 1e-12  # up to which a place or an angle has not moved [m or rad]
_NO_GAIN = 1e-12  # smallest size that is drawn [-]
_MAX_NUMBERS = 3  # of the numbers over shaded times


class Mark(NamedTuple):
    """A time that is shaded in every panel of a group and explained below its heading."""

    label: str
    start: float
    end: float  # equal to start: a line
    colour: str


@dataclass
class Panel:
    """One plot over time, or over the quantity of `x_title`."""

    title: str
    unit: str = ""
    log: bool = False  # of the y axis
    x_title: str = ""
    height: int = 150  # [px]
    x_log: bool = False  # of the x axis; its range is then in decades
    traces: list[dict[str, Any]] = field(default_factory=list)
    limits: tuple[float, ...] = ()  # horizontal lines
    single: bool = False  # whether a label names one point instead of all curves at its x
    x_range: tuple[float, float] | None = None
    y_range: tuple[float, float] | None = None
    equal: bool = False  # whether both axes have one scale
    _largest: float = 0.0  # of all curves

    def line(self, x: Vector, y: Vector, name: str, style: dict[str, Any], **more: Any) -> None:
        """Add a curve; NaN breaks it."""
        self._largest = max(self._largest, float(np.nanmax(np.abs(y), initial=0.0)))
        numbers = x.dtype.kind in "fiu"  # else names, in the order in which they come
        self.traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                "x": encoded(x, _kind_of(x)) if numbers else x.tolist(),
                "y": encoded(y, np.float32),
                "name": name,
                "legendgroup": name,
                "line": {"width": 1.6, **style},
                "hovertemplate": f"%{{y:.4g}} {self.unit}",
                **more,
            }
        )

    def over_frequency(self, frequency: Vector) -> None:
        """Let the x axis be of these frequencies, rising [rad/s]."""
        self.x_title, self.x_log = "frequency [rad/s]", True
        self.x_range = (float(np.log10(frequency[0])), float(np.log10(frequency[-1])))

    def layout(self, marks: Sequence[Mark], last: bool) -> dict[str, Any]:
        """Return the layout as plotly.js takes it.

        Args:
            marks: what is shaded.
            last: whether the panel is the lowest of its group and names the x axis.
        """
        axis = {"gridcolor": GRID, "linecolor": GRID, "zeroline": False, "automargin": True}
        x: dict[str, Any] = {**axis, "nticks": 8}
        y: dict[str, Any] = {**axis, "nticks": 5, "exponentformat": "power"}
        if self.x_range:
            x["range"] = list(self.x_range)
        if self.x_log:
            x |= {"type": "log", "dtick": 1}
        if self.y_range:
            y["range"] = list(self.y_range)
        elif self.unit in ("m", "rad") and not self.log and self._largest <= _ROUNDING:
            y["range"] = [-_ROUNDING, _ROUNDING]
        if self.log and self.y_range:  # whole decades: their labels cannot meet
            low, high = np.floor(np.log10(self.y_range[0])), np.ceil(np.log10(self.y_range[1]))
            y |= {"type": "log", "range": [low, high], "dtick": int(np.ceil((high - low) / 5.0))}
        if self.equal:
            y["scaleanchor"] = "x"
        if last and self.x_title:
            x["title"] = {"text": self.x_title, "standoff": 4}
        return {
            "height": self.height + (18 if last and self.x_title else 0),
            "margin": {"l": 60, "r": 14, "t": 16 if marks else 8, "b": 24},
            "paper_bgcolor": "rgba(0,0,0,0)",
            "plot_bgcolor": "rgba(0,0,0,0)",
            "font": {"family": "Inter, system-ui, sans-serif", "size": 11, "color": LINE},
            "showlegend": False,
            "hovermode": "closest" if self.single else "x unified",
            "hoverlabel": {"namelength": -1, "font": {"size": 11}},
            "xaxis": x,
            "yaxis": y,
            "shapes": [*_shapes(marks), *map(_limit, self.limits)],
            "annotations": _numbers(marks, self.x_range),
        }


class Entry(NamedTuple):
    """One line of the legend of a group."""

    name: str  # as in the traces
    colour: str
    dash: str = "solid"


@dataclass
class Group:
    """Panels over the same axis, under one heading."""

    title: str
    words: str
    panels: list[Panel]
    legend: tuple[Entry, ...] = ()
    marks: tuple[Mark, ...] = ()
    key: str = ""  # name in the page; empty: from the title
    side_by_side: bool = False  # the panels, each with an x axis of its own

    @property
    def id(self) -> str:
        """Name of the group in the page."""
        return self.key or "-".join(word.lower() for word in self.title.split())

    def content(self) -> list[dict[str, Any]]:
        """Return data and layout of every panel as plain data for plotly.js."""
        last = len(self.panels) - 1
        return [
            {
                "data": panel.traces,
                "layout": panel.layout(self.marks, self.side_by_side or k == last),
            }
            for k, panel in enumerate(self.panels)
        ]


def stacked(
    labels: Sequence[str],
    paths: Mapping[str, tuple[Vector, Matrix]],
    words: str = "",
    x_title: str = "time [s]",
) -> Group:
    """Return a panel for each column of paths, over the same axis.

    Args:
        labels: titles of the panels.
        paths: by name, x of shape (k,) and the columns, shape (k, panels).
        words: below its title.
        x_title: quantity and unit of x.
    """
    panels = [Panel(label, x_title=x_title) for label in labels]
    for number, (name, (x, columns)) in enumerate(paths.items()):
        for panel, y in zip(panels, columns.T, strict=True):
            panel.line(x, y, name, style(number))
    return Group("", words, panels, legend(list(paths)) if len(paths) > 1 else ())


def decibels(size: Matrix) -> Matrix:
    """Return sizes in dB; none is drawn far below."""
    return np.asarray(20.0 * np.log10(np.maximum(size, _NO_GAIN)))


def encoded(values: Vector, kind: type[np.floating[Any]]) -> dict[str, str]:
    """Return numbers as plotly.js takes them in bulk."""
    array = np.asarray(values, dtype=kind)
    return {"dtype": f"f{array.itemsize}", "bdata": b64encode(array.tobytes()).decode()}


def _kind_of(x: Vector) -> type[np.floating[Any]]:
    """Return a precision that is finer than a plot can show, which is a millionth of it."""
    small = np.nanmax(np.abs(x), initial=0.0) <= _SINGLE
    return np.float32 if small else np.float64


def style(number: int) -> dict[str, Any]:
    """Return colour and dash of the curve with this number; the first eight differ by colour."""
    cycle = number // len(COLOURS) % len(LINE_STYLES)
    return {"color": COLOURS[number % len(COLOURS)], "dash": LINE_STYLES[cycle]}


def legend(names: Sequence[str]) -> tuple[Entry, ...]:
    """Return the legend of curves that are styled by their number."""
    return tuple(Entry(name, **_entry(style(k))) for k, name in enumerate(names))


def _entry(values: dict[str, Any]) -> dict[str, str]:
    return {"colour": values["color"], "dash": values["dash"]}


def _shapes(marks: Sequence[Mark]) -> list[dict[str, Any]]:
    shapes = []
    for mark in marks:
        shape: dict[str, Any] = {"xref": "x", "yref": "paper", "y0": 0, "y1": 1, "layer": "below"}
        shape |= {"x0": mark.start, "x1": mark.end}
        if mark.end > mark.start:
            shape |= {"type": "rect", "fillcolor": mark.colour, "opacity": 0.09}
            shape |= {"line": {"width": 0}}
        else:
            shape |= {"type": "line", "line": {"color": mark.colour, "width": 1, "dash": "dash"}}
        shapes.append(shape)
    return shapes


def _limit(value: float) -> dict[str, Any]:
    line = {"color": FAULT, "width": 1, "dash": "dot"}
    return {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": value, "y1": value,
            "line": line}  # fmt: skip


def _numbers(marks: Sequence[Mark], x_range: tuple[float, float] | None) -> list[dict[str, Any]]:
    """Return the number of every mark above its start; close ones share a place."""
    if not marks or x_range is None:
        return []
    places: list[tuple[float, list[str]]] = []
    gap = 0.12 * (x_range[1] - x_range[0])
    for number, mark in sorted(enumerate(marks, start=1), key=lambda pair: pair[1].start):
        at = min(max(mark.start, x_range[0]), x_range[1])
        if places and at - places[-1][0] < gap:
            places[-1][1].append(str(number))
        else:
            places.append((at, [str(number)]))
    return [
        {
            "x": at,
            "y": 1,
            "yref": "paper",
            "yanchor": "bottom",
            "xanchor": "center" if x_range[0] + gap < at < x_range[1] - gap else _side(at, x_range),
            "text": _short(numbers),
            "showarrow": False,
            "font": {"size": 9.5, "color": LINE},
        }
        for at, numbers in places
    ]


def _side(at: float, x_range: tuple[float, float]) -> str:
    """Return the anchor of a text that keeps it inside the plot."""
    return "left" if at < 0.5 * (x_range[0] + x_range[1]) else "right"


def _short(numbers: list[str]) -> str:
    return ",".join(numbers) if len(numbers) <= _MAX_NUMBERS else f"{numbers[0]}-{numbers[-1]}"
