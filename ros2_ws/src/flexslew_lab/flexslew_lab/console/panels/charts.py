"""Four charts over simulated time: which signals, which window, events as vertical lines."""

from functools import partial
from pathlib import Path

import numpy as np

from flexslew_lab.console import quantities
from flexslew_lab.console.charting import ChartData, chart_update, options
from flexslew_lab.console.desk import PanelContext, ReplyLine
from flexslew_lab.console.history import Curve, reduce_samples
from flexslew_lab.console.layouts import Layouts
from flexslew_lab.console.link import RequestResult
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.events import (
    AnswerMissing,
    ControllerNotReady,
    ControllerReady,
    ScheduleShifted,
)

_WINDOWS = {"10 s": 10.0, "30 s": 30.0, "100 s": 100.0, "300 s": 300.0, "whole run": 0.0}
_QUIET = (AnswerMissing, ScheduleShifted, ControllerReady, ControllerNotReady)  # too many for lines
_NONE = "nothing"
_SAVE = "the curves in the window, as a table or a picture"


class ChartsPanel:
    """The charts and their common controls.

    Args:
        context: of the page.
        file: where layouts are kept.
    """

    def __init__(self, context: PanelContext, file: Path) -> None:
        gui, self._view = context.gui, context.view
        self._overlays: dict[str, list[Curve]] = {}  # of another run, by quantity
        self._pause_range: tuple[float, float] | None = None  # what a paused view shows [s]
        self._layouts = Layouts(file, (*quantities.NAMES, _NONE))
        with gui.middle:
            with gui.add("tools"):
                self._window = gui.choice("Window", tuple(_WINDOWS), value="30 s")
                names = tuple(self._layouts.known)
                self._layout = gui.choice("Layout", names, value=self._layouts.last)
                self._pause = gui.check("Pause the view", False, hint="the bench goes on")
                self._lines = gui.check("Events as lines", True)
                hint = "the log keeps everything"
                context.click(gui.button("Clear the charts", hint=hint), self._clear)
            with gui.add("grid"):
                plots = self._layouts.active_plots()
                numbers = tuple(map(str, range(len(plots))))
                self._charts = [
                    _Chart(context, name, number, numbers)
                    for name, number in zip(plots, numbers, strict=True)
                ]
        self._name = gui.text("Name of the layout", hint="what the four charts show")
        context.click(gui.button("Save the layout"), self._save)
        self._reply = ReplyLine(context)
        for chart in self._charts:
            context.change(chart.place, partial(self._exchange, chart))
        context.change(self._pause, self._on_pause)
        context.change(self._layout, self._choose)

    def refresh(self) -> None:
        """Draw what is new."""
        start, end = self._pause_range or self._current_range()
        times = np.zeros(0)
        if self._lines.value:
            events = self._view.events
            epoch = max((e.epoch for e in events), default=0)  # what is drawn is of the last one
            times = np.array(
                [
                    e.time
                    for e in events
                    if e.epoch == epoch
                    and start <= e.time <= end
                    and not isinstance(e.what, _QUIET)
                ]
            )
        for chart in self._charts:
            chart.draw(start, end, np.unique(times)[-100:], self._overlays)

    def overlay(self, previous: dict[str, list[Curve]]) -> None:
        """Draw the curves of another run, by quantity, over those of this run."""
        self._overlays = previous
        for chart in self._charts:
            chart.force_update()

    def jump(self, time: float) -> None:
        """Hold the view around a time [s]."""
        width = _WINDOWS.get(self._window.value, 30.0) or 30.0
        self._pause_range = time - width / 2, time + width / 2
        self._pause.value = True

    def _current_range(self) -> tuple[float, float]:
        width = _WINDOWS.get(self._window.value, 30.0)
        end = max(self._view.time, width, 0.1)
        return (end - width, end) if width else (0.0, end)

    def _on_pause(self, who: str) -> None:
        self._pause_range = self._current_range() if self._pause.value else None

    def _clear(self, who: str) -> None:
        self._view.truth.clear()
        self._view.controller_state.clear()

    def _choose(self, who: str) -> None:
        self._layouts.choose(self._layout.value)
        for chart, selected_name in zip(self._charts, self._layouts.active_plots(), strict=True):
            chart.what.value = selected_name

    def _exchange(self, chart: "_Chart", who: str) -> None:
        """Exchange a chart with the one that was dragged onto it."""
        other = self._charts[int(chart.place.value)]
        chart.what.value, other.what.value = other.what.value, chart.what.value
        chart.place.value = ""

    def _save(self, who: str) -> None:
        try:
            self._layouts.save(self._name.value, [chart.what.value for chart in self._charts])
        except (BadInput, OSError) as error:
            self._reply.tell(RequestResult(False, str(error)))
            return
        self._layout.options = tuple(self._layouts.known)
        self._layout.value = self._layouts.last
        self._reply.tell(RequestResult(True, f"the layout {self._layouts.last} is kept"))


class _Chart:
    """One chart with the choice of its quantity."""

    def __init__(
        self, context: PanelContext, quantity: str, number: str, numbers: tuple[str, ...]
    ) -> None:
        gui, self._view = context.gui, context.view
        with gui.add("tile", options=numbers, value="") as self.place:
            with gui.add("handle", value=number):
                self.what = gui.choice("Chart", (*quantities.NAMES, _NONE), value=quantity)
                self.what.hint = "drag it onto another chart to exchange both"
                kinds = ("CSV", "PNG", "SVG")
                gui.add("save", "Save", hint=_SAVE, options=kinds, data=self.place)
            self._labels: tuple[object, ...] = ()
            self._last_state: tuple[object, ...] = ()
            empty_data = ChartData(options([]), chart_update(np.zeros(0), [], np.zeros(0)))
            self._plot = gui.add("chart", "chart", data=empty_data)
        context.change(self.what, lambda who: self.force_update())

    def draw(
        self, start: float, end: float, events: Vector, overlays: dict[str, list[Curve]]
    ) -> None:
        """Show a window of time."""
        quantity = self.what.value
        state = (quantity, start, end, len(events), self._view.truth.time.size)
        if state == self._last_state:
            return
        self._last_state = state
        self._plot.visible = quantity in quantities.NAMES
        if not self._plot.visible:
            return
        curves = [*quantities.curves_of(self._view, quantity), *overlays.get(quantity, [])]
        axis, rows = reduce_samples(curves, start, end)
        labels = tuple((curve.label, curve.dashed) for curve in curves)
        axes = self._plot.data.options
        if labels != self._labels:
            self._labels, axes = labels, options(curves)
        self._plot.data = ChartData(axes, chart_update(axis, rows, events))

    def force_update(self) -> None:
        """Draw again next time, even if the window has not moved."""
        self._last_state = ()
