"""The bench in a few lines of a notebook: build a trial, fly it in process, get arrays, plot them.

from flexslew_lab.notebook import fly, trial

flight = fly(trial("m1", {"testbed.modes": 5}))
flight["position.hub"], flight.units["position.hub"]
flight.plot("position", "tip")
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.metrics.from_bag import metrics_from
from flexslew_lab.report.signals import read_signals
from flexslew_lab.trial.overrides import overridden
from flexslew_lab.trial.run import run_trial
from flexslew_lab.trial.sources import trial_path
from flexslew_lab.trial.trial import Trial, checked_trial, parse_trial, plant_of, text_of
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.events import Event
from flexslew_plant.own_code import ANY_CODE, NO_CODE, Trust
from flexslew_plant.settings import load_yaml, yaml_text

if TYPE_CHECKING:
    import control
    import pandas
    import plotly.graph_objects


@dataclass(frozen=True)
class Flight:
    """What a run was: every signal over the ticks of the truth, by name and with its unit.

    Signals are called `quantity.joint`, `quantity.mode_1` or `tip.appendage`; `energy` stands
    alone. Where a signal has no value at a tick (nobody answered, say) it is NaN.
    """

    trial: dict[str, Any]  # the keys of the trial with every default written out
    metrics: dict[str, Any]  # the content of metrics.json
    events: tuple[Event, ...]
    time: Vector  # simulated, of every tick, (ticks,) [s]
    signals: dict[str, Vector]  # by name, each (ticks,)
    units: dict[str, str]  # by name

    def __getitem__(self, name: str) -> Vector | Matrix:
        """Return the signal `name`, (ticks,), or all of a quantity side by side, (ticks, n).

        Raises:
            KeyError: there is no such signal; it says which there are.
        """
        if name in self.signals:
            return self.signals[name]
        return np.column_stack([self.signals[full] for full in self.names(name)])

    def names(self, quantity: str) -> tuple[str, ...]:
        """Return the signals of a quantity (position, effort, ...), or the one of that name.

        Raises:
            KeyError: there is no such signal; it says which there are.
        """
        found = [n for n in self.signals if n == quantity or n.startswith(f"{quantity}.")]
        if not found:
            raise KeyError(f"{quantity} is not a signal; there are {', '.join(self.signals)}")
        return tuple(found)

    def frame(self) -> pandas.DataFrame:
        """Return all signals as a pandas DataFrame over the time [s], units in `attrs`.

        Raises:
            ModuleNotFoundError: pandas is not installed.
        """
        import pandas

        frame = pandas.DataFrame(self.signals, index=pandas.Index(self.time, name="time"))
        frame.attrs["units"] = {"time": "s", **self.units}
        return frame

    def plot(self, *quantities: str) -> plotly.graph_objects.Figure:
        """Return a Plotly figure, one panel per quantity over the same time axis.

        Args:
            quantities: as for `names`; without any: position, tip and effort.

        Raises:
            KeyError: there is no such signal.
        """
        from plotly.graph_objects import Scatter
        from plotly.subplots import make_subplots

        panels = quantities or ("position", "tip", "effort")
        figure = make_subplots(rows=len(panels), shared_xaxes=True, vertical_spacing=0.06)
        for row, quantity in enumerate(panels, 1):
            names = self.names(quantity)
            for name in names:
                figure.add_trace(Scatter(x=self.time, y=self.signals[name], name=name), row, 1)
            units = ", ".join(dict.fromkeys(self.units[name] for name in names))
            figure.update_yaxes(title_text=f"{quantity} [{units}]", row=row, col=1)
        figure.update_xaxes(title_text="time [s]", row=len(panels), col=1)
        figure.update_layout(height=80 + 220 * len(panels), template="plotly_white")
        return figure


def trial(
    source: str | Path | Mapping[str, Any] = "m1",
    changes: Mapping[str, Any] | None = None,
    trust: Trust = ANY_CODE,
) -> Trial:
    """Return a trial, validated as the command line does it.

    Args:
        source: the name of a shipped trial, a file, or the keys of a trial file.
        changes: path to value, for example {"testbed.modes": 5, "plan.duration": 30.0}.
        trust: which classes it may name; for keys that come from somebody else's log: NO_CODE.

    Raises:
        BadInput: no such trial, or one of its values is not allowed.
    """
    label, values = _keys(source)
    text = yaml_text(_plain(overridden(values, dict(changes or {}))))
    return checked_trial(parse_trial(text, label, trust), label)


def fly(what: Trial, folder: Path | None = None) -> Flight:
    """Return the flight of a trial in process, without ROS.

    Args:
        what: as from `trial`.
        folder: of the run, with bag, metrics.json and report.html; None: nothing stays on disk.

    Raises:
        BadInput, PlanFailed: before anything was written.
    """
    if folder is not None:
        return read(run_trial(what, "notebook", folder, in_process=True).folder, what.trust)
    with tempfile.TemporaryDirectory() as passing:
        result = run_trial(what, "notebook", Path(passing, "run"), in_process=True, report=False)
        return read(result.folder, what.trust)


def read(run: Path | str, trust: Trust = NO_CODE) -> Flight:
    """Return a flight that was recorded before, in process or over ROS 2.

    Args:
        run: the folder of the run, its bag, or an .mcap file.
        trust: which classes that the log names may be loaded, for example
            Trust.of(["my_metric.py:MyMetric"]); of others the metrics are left out.

    Raises:
        BadInput: there is no bag, or it is damaged.
    """
    path = Path(run)
    bag = BagReader(path / "bag" if (path / "bag").is_dir() else path, trust=trust)
    signals = read_signals(bag)
    keys = load_yaml(bag.trial_text, f"{bag.path}: trial") or {}
    events = bag.overview.events
    return Flight(keys, metrics_from(bag), events, signals.time, signals.values, signals.units)


def linear_model(
    what: Trial, at: float | None = None, sampled: bool = False, **joints: float
) -> control.StateSpace:
    """Return the small motions of a trial's testbed about a rest, from efforts to sensors.

    Signals are named as in the log, with a colon for the dot: `effort:yaw`, `tip:left`.

    Args:
        what: as from `trial`.
        at: simulated time [s]: the rest that the plan passes then; None: the start.
        sampled: as the bench ticks, with hold, delay and motor lag; else continuous.
        joints: where joints rest instead, by name [rad or m].

    Raises:
        BadInput: the time is none, or a name is no joint.
    """
    from flexslew_lab.analysis.trial_models import model_of, point_of

    return model_of(point_of(what, at, joints), sampled).state_space(what.name)


def nonlinear_model(what: Trial) -> control.NonlinearIOSystem:
    """Return the whole plant of a trial as python-control simulates it; see linear_model."""
    from flexslew_control.analysis.nonlinear_plant import nonlinear_system

    return nonlinear_system(plant_of(what).testbed, what.name)


def _plain(value: Any) -> Any:
    """Return a value with NumPy's arrays and numbers as those of Python."""
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _keys(source: str | Path | Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """Return a name for messages and the keys of a trial."""
    if isinstance(source, Mapping):
        return "trial", dict(source)
    path = trial_path(source)
    values = load_yaml(text_of(path), str(path))
    if not isinstance(values, dict):
        raise BadInput("holds no keys", path)
    return str(path), values
