"""Four charts over simulated time: which signals, which window, events as vertical lines."""

from functools import partial
from typing import Any

import numpy as np
from viser import uplot

from flexslew_lab.console import quantities
from flexslew_lab.console.desk import Desk
from flexslew_lab.console.history import Curve, marked, power_of, thinned
from flexslew_plant.arrays import Vector
from flexslew_plant.events import AnswerMissed, BecameReady, BecameUnready, FellBehind

_SHOWN = (quantities.POSITION, quantities.ERROR, quantities.EFFORT, quantities.TIPS)
_WINDOWS = {"10 s": 10.0, "30 s": 30.0, "100 s": 100.0, "300 s": 300.0, "whole run": 0.0}
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#555555", "#8a2be2")
_EVENTS = "events"
_QUIET = (AnswerMissed, FellBehind, BecameReady, BecameUnready)  # too many for lines
_NONE = "nothing"


class ChartsPanel:
    """The charts and their common controls.

    Args:
        desk: of the page.
    """

    def __init__(self, desk: Desk) -> None:
        gui, self._view = desk.gui, desk.view
        self.overlays: dict[str, list[Curve]] = {}  # of another run, by quantity
        self._held: tuple[float, float] | None = None  # what a paused view shows [s]
        self._window = gui.add_dropdown("Window", tuple(_WINDOWS), initial_value="30 s")
        self._pause = gui.add_checkbox("Pause the view", False, hint="the bench goes on")
        self._lines = gui.add_checkbox("Events as lines", True)
        desk.click(gui.add_button("Clear the charts", hint="the log keeps everything"), self._clear)
        self._charts = [_Chart(desk, quantity) for quantity in _SHOWN]
        desk.change(self._pause, self._on_pause)

    def refresh(self) -> None:
        """Draw what is new."""
        start, end = self._held or self._following()
        times = np.zeros(0)
        if self._lines.value:
            times = np.array(
                [
                    e.time
                    for e in self._view.events
                    if start <= e.time <= end and not isinstance(e.what, _QUIET)
                ]
            )
        for chart in self._charts:
            chart.draw(start, end, np.unique(times)[-100:], self.overlays)

    def jump(self, time: float) -> None:
        """Hold the view around a time [s]."""
        width = _WINDOWS.get(self._window.value, 30.0) or 30.0
        self._held = time - width / 2, time + width / 2
        self._pause.value = True

    def _following(self) -> tuple[float, float]:
        width = _WINDOWS.get(self._window.value, 30.0)
        end = max(self._view.time, width, 0.1)
        return (end - width, end) if width else (0.0, end)

    def _on_pause(self, who: str) -> None:
        self._held = self._following() if self._pause.value else None

    def _clear(self, who: str) -> None:
        self._view.truth.clear()
        self._view.controller_state.clear()


class _Chart:
    """One chart with the choice of its quantity."""

    def __init__(self, desk: Desk, quantity: str) -> None:
        self._server, self._view = desk.server, desk.view
        options = (*quantities.NAMES, _NONE)
        self._what = desk.gui.add_dropdown("Chart", options, initial_value=quantity)
        nothing = np.zeros(1)
        self._labels: tuple[Any, ...] = ()
        self._drawn: tuple[Any, ...] = ()
        self._plot = desk.gui.add_uplot(
            (nothing, nothing, nothing),
            _series([]),
            height=170,
            scales={
                "x": uplot.Scale(time=False, auto=True),
                _EVENTS: uplot.Scale(auto=False, range=(0.0, 1.0)),
            },
            axes=(
                uplot.Axis(size=30),
                uplot.Axis(size=56),
            ),
            cursor=uplot.Cursor(sync=uplot.Cursor_Sync(key="bench")),
        )
        desk.change(self._what, partial(self._changed))

    def draw(
        self, start: float, end: float, events: Vector, overlays: dict[str, list[Curve]]
    ) -> None:
        """Show a window of time."""
        quantity = self._what.value
        state = (quantity, start, end, len(events), self._view.truth.time.size, len(overlays))
        if state == self._drawn:
            return
        self._drawn = state
        if quantity not in quantities.NAMES:
            self._plot.visible = False
            return
        self._plot.visible = True
        curves = [*quantities.curves_of(self._view, quantity), *overlays.get(quantity, [])]
        axis, rows = thinned(curves, start, end)
        power = power_of(rows)
        rows = [row / 10.0**power for row in rows]
        axis, rows, up = marked(axis, rows, events)
        labels = (power, *((curve.label, curve.dashed) for curve in curves))
        with self._server.atomic():
            if labels != self._labels:
                self._labels = labels
                self._plot.series = _series(curves, power)
            self._plot.data = (axis, up, *rows)

    def _changed(self, who: str) -> None:
        self._drawn = ()


def scaled_label(label: str, power: int) -> str:
    """Return a label whose unit says the power of ten that is counted in: `arm [1e-6 rad]`."""
    if not power:
        return label
    name, bracket, unit = label.partition(" [")
    return f"{name} [1e{power} {unit}" if bracket else f"{name} [1e{power}]"


def _series(curves: list[Curve], power: int = 0) -> tuple[Any, ...]:
    events = uplot.Series(
        label=_EVENTS, scale=_EVENTS, stroke="#999999", width=1, points={"show": False}
    )
    shown = [
        uplot.Series(
            label=scaled_label(curve.label, power),
            stroke=COLORS[(k if curve.color is None else curve.color) % len(COLORS)],
            width=1.5,
            points={"show": False},
            **({"dash": (6.0, 4.0)} if curve.dashed else {}),
        )
        for k, curve in enumerate(curves)
    ]
    return (uplot.Series(label="time [s]"), events, *(shown or [uplot.Series(label="-")]))
