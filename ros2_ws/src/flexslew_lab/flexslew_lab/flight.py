"""A flight as arrays by name, with units: what a notebook works with."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from flexslew_lab.metrics import Key
from flexslew_lab.metrics.operator_changes import changes_of
from flexslew_lab.metrics.rows import flat, row_unit
from flexslew_lab.named import BySignal, Named
from flexslew_lab.report.handover_lines import handover_lines
from flexslew_lab.report.verdict import run_summary
from flexslew_lab.short_values import short
from flexslew_lab.trial.trial import Trial, trial_of_values
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.events import Event
from flexslew_plant.extras import required
from flexslew_plant.notebook_table import in_notebook
from flexslew_plant.own_code import NO_CODE, Trust

if TYPE_CHECKING:
    import pandas
    import plotly.graph_objects
    import xarray


@dataclass(frozen=True, repr=False)
class Flight:
    """What a run was: every signal over the ticks of the truth, by name and with its unit.

    After a reset it is the last epoch alone, as for the metrics; the events are those of all.
    Signals are called `quantity.joint`, `quantity.mode_1` or `tip.appendage`; `energy` stands
    alone. Where a signal has no value at a tick (after a missed answer) it is NaN.
    """

    trial: dict[str, Any]  # the keys of the trial with every default written out
    metrics: Named[Any]  # the content of metrics.json
    events: tuple[Event, ...]
    time: Vector  # simulated, of every tick, (ticks,) [s]
    signals: Named[Vector]  # by name, each (ticks,)
    units: BySignal[str]  # by name; `units("position")` are those of a quantity
    user_keys: dict[str, Key] = field(default_factory=dict)  # of the trial's own metrics

    def __getitem__(self, name: str) -> Vector | Matrix:
        """Return the signal `name`, (ticks,), or all of a quantity side by side, (ticks, n).

        Raises:
            KeyError: if there is no such signal; the message lists all.
        """
        if name in self.signals:
            return self.signals[name]
        return np.column_stack([self.signals[full] for full in self.names(name)])

    def __contains__(self, name: object) -> bool:
        """Return whether there is a signal, or a quantity, of that name."""
        return any(name in (full, full.partition(".")[0]) for full in self.signals)

    def __iter__(self) -> Iterator[str]:
        """Return the names of all signals."""
        return iter(self.signals)

    @cached_property
    def names(self) -> BySignal[str]:
        """Names of the signals; `names("position")` are those of a quantity."""
        return BySignal({name: name for name in self.signals}, "signal")

    def __repr__(self) -> str:
        """Return one line: the trial, its size, the verdict."""
        size = f"{len(self.time)} ticks, {len(self.signals)} signals"
        return f"<Flight {self.name}: {size}; {self.verdict}>"

    def _repr_html_(self) -> str:
        """Return the verdict and the table of the metrics, for notebooks."""
        joints = {n.partition(".")[2]: self.units[n] for n in self.signals if n[:9] == "measured."}
        rows = [
            (name, short(value, 3), row_unit(name, joints, self.user_keys))
            for name, value in flat(self.metrics).items()
            if value is not None
        ]
        kinds = ", ".join(dict.fromkeys(name.partition(".")[0] for name in self.signals))
        size = f"{len(self.time)} ticks of {kinds}"
        return f"<b>{escape(self.name)}</b>: {escape(self.verdict)}<br>" + in_notebook(
            size, (), rows, folded="metrics"
        )

    @property
    def name(self) -> str:
        """The name of its trial."""
        return str(self.trial.get("name", ""))

    @property
    def verdict(self) -> str:
        """The main result for a user; of a law that fell silent, why."""
        tolerance = self.trial.get("goal_tolerance", Trial.goal_tolerance)
        units = {n.partition(".")[2]: u for n, u in self.units.items() if n[:9] == "position."}
        words = run_summary(self.metrics, {}, tolerance, len(changes_of(self.events)), units)
        return "; ".join((words, *handover_lines(self.events)))

    def xarray(self) -> xarray.Dataset:
        """Return all signals as an xarray Dataset over the time [s], with their units.

        Raises:
            ModuleNotFoundError: xarray is not installed.
        """
        xarray = required("xarray")
        data = {
            name: ("time", values, {"units": self.units[name]})
            for name, values in self.signals.items()
        }
        return xarray.Dataset(
            data, {"time": ("time", self.time, {"units": "s"})}, {"trial": self.name}
        )

    def frame(self) -> pandas.DataFrame:
        """Return all signals as a pandas DataFrame over the time [s], units in `attrs`.

        Raises:
            ModuleNotFoundError: pandas is not installed.
        """
        pandas = required("pandas")
        frame = pandas.DataFrame(self.signals, index=pandas.Index(self.time, name="time"))
        frame.attrs["units"] = {"time": "s", **self.units}
        return frame

    def plot(self, *quantities: str) -> plotly.graph_objects.Figure:
        """Return a Plotly figure, one panel per quantity over the same time axis.

        Args:
            quantities: as for `names`; without any: position, tip (if it has tips) and effort.

        Raises:
            KeyError: there is no such signal.
        """
        chosen = quantities or tuple(q for q in ("position", "tip", "effort") if q in self)
        panels = [
            (
                f"{quantity} [{', '.join(dict.fromkeys(self.units(quantity)))}]",
                {name: self.signals[name] for name in self.names(quantity)},
            )
            for quantity in chosen
        ]
        return _figure(self.time, "time [s]", panels)

    def step_plot(self, *joints: str) -> plotly.graph_objects.Figure:
        """Return a Plotly figure of positions and references over time, one panel per joint.

        Args:
            joints: by name; without any: all.

        Raises:
            KeyError: if there is no such joint.
        """
        names = joints or tuple(name.partition(".")[2] for name in self.names("measured"))
        panels = [
            (
                f"{joint} [{self.units[f'position.{joint}']}]",
                {kind: self.signals[f"{kind}.{joint}"] for kind in ("position", "reference")},
            )
            for joint in names
        ]
        return _figure(self.time, "time [s]", panels)

    def bode(self, trust: Trust = NO_CODE) -> plotly.graph_objects.Figure:
        """Return a Plotly figure with gain and phase of the loop of each effort, others closed.

        The loop is that of `analyse`: the trial's active controller about the end of its plan.

        Args:
            trust: classes that the trial may name, see read.

        Raises:
            BadInput: if the law has no linear form.
        """
        from flexslew_lab.analysis.analysis import loop_analysis

        trial = trial_of_values(self.trial, self.name, trust)
        analysis = loop_analysis(trial, self.name)
        loops = {name: analysis.sweep.gain((name,))[:, 0, 0] for name in analysis.loop.effort_names}
        gain = {n: 20.0 * np.log10(np.maximum(abs(loop), 1e-12)) for n, loop in loops.items()}
        phase = {n: np.degrees(np.unwrap(np.angle(loop))) for n, loop in loops.items()}
        panels = [("gain [dB]", gain), ("phase [deg]", phase)]
        return _figure(analysis.sweep.grid, "frequency [rad/s]", panels, "log")


def _figure(
    x: Vector, title: str, panels: Sequence[tuple[str, Mapping[str, Vector]]], scale: str = "linear"
) -> plotly.graph_objects.Figure:
    """Return a Plotly figure with panels of curves by name, one above another."""
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    spacing = min(0.06, 0.5 / len(panels))
    figure = make_subplots(rows=len(panels), shared_xaxes=True, vertical_spacing=spacing)
    for row, (words, curves) in enumerate(panels, 1):
        for name, y in curves.items():
            figure.add_trace(Scatter(x=x, y=y, name=name), row, 1)
        figure.update_yaxes(title_text=words, row=row, col=1)
    figure.update_xaxes(type=scale)
    figure.update_xaxes(title_text=title, row=len(panels), col=1)
    figure.update_layout(height=80 + 220 * len(panels), template="plotly_white")
    return figure
