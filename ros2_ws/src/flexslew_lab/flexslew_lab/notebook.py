"""The bench in a few lines of a notebook: build a trial, fly it in process, get arrays, plot them.

from flexslew_lab.notebook import fly, trial

flight = fly(trial("m1", {"testbed.modes": 5}))
flight["position.hub"], flight.units["position.hub"]
flight.plot("position", "tip")
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping
from contextlib import ExitStack
from decimal import Decimal
from fractions import Fraction
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
from yaml.representer import RepresenterError

from flexslew_control.analysis.save_law import law_of_system
from flexslew_control.law import WrongShape
from flexslew_control.plan import Plan
from flexslew_lab.flight import Flight as Flight
from flexslew_lab.given_objects import MODULE, Given, is_system, with_law, with_plan
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.metrics.from_bag import metrics_from, user_keys_of
from flexslew_lab.named import BySignal, Named
from flexslew_lab.progress import display_library_progress
from flexslew_lab.report.signals import read_signals
from flexslew_lab.run.run_trial import Result, RunFeedback, run_trial
from flexslew_lab.trial.outputs import bag_folder
from flexslew_lab.trial.sources import changed_values, label_of, trial_path
from flexslew_lab.trial.trial import Trial, checked_trial, parse_trial, plant_of, text_of
from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import ANY_CODE, NO_CODE, Trust
from flexslew_plant.settings import is_section, plain
from flexslew_plant.yaml_data import load_yaml, yaml_text

if TYPE_CHECKING:
    import control

What = Trial | str | Path | Mapping[str, Any]


def trial(
    source: What = "m1",
    changes: Mapping[str, Any] | None = None,
    trust: Trust = ANY_CODE,
    law: Given | None = None,
    plan: Given | Plan | Matrix | None = None,
) -> Trial:
    """Return a trial, validated as the command line does it.

    Args:
        source: the name of a shipped trial, a file, the keys of a trial file, or a Trial, with the
            defaults and files that it was read with.
        changes: path to value, for example {"testbed.modes": 5, "plan.duration": 30.0}; a section
            of another Trial, as its testbed, is a value.
        trust: which classes it may name, of a Trial those that it trusts; for keys from the log of
            another user: NO_CODE.
        law: law in place of the trial's: a class as in own_controller.md, a function of
            (measurement, reference) that returns the efforts, a state space or transfer function
            of python-control with signals by name as inputs and outputs as for save_law, or a
            name: of one of its controllers, or of a law, which has its defaults.
        plan: plan in place of the trial's: positions of the joints at every tick from 0 on, shape
            (ticks + 1, joints) [rad or m], a Plan, a planner class as in own_planner.md, or the
            name of a method, which takes over the goal, the start and what else it has of them.

    Raises:
        BadInput: no such trial, or one of its values is not allowed.
    """
    label, values = _keys(source)
    trust = source.trust if isinstance(source, Trial) else trust
    values = changed_values(values, plain_data(by_path(changes, "changes")), label, trust)
    if law is not None:
        values = with_law(values, law)
    if plan is not None:
        values = with_plan(values, plan, label, trust)
    try:
        text = yaml_text(plain_data(values))
    except RepresenterError as error:
        words = "give numbers, texts, lists and keys"
        raise BadInput(f"{label}: {error.args[-1]!r} is not allowed: {words}") from None
    return checked_trial(parse_trial(text, label, trust), label)


def fly(what: What = "m1", folder: Path | str | None = None) -> Flight:
    """Return the flight of a trial in process, without ROS.

    Warnings of the command line are UserWarnings here.

    Args:
        what: as from `trial`, or what `trial` takes.
        folder: of the run, with bag, metrics.json and report.html; None: nothing stays on disk.

    Raises:
        BadInput, PlanFailed: before anything was written; or BadInput after the run, if a law has
            returned efforts of a wrong shape.
    """
    what = trial_from(what)
    keep = folder is not None
    warn = partial(warnings.warn, stacklevel=3)
    with ExitStack() as stack:
        run = place(folder, "folder") if keep else Path(stack.enter_context(TemporaryDirectory()))
        count = stack.enter_context(display_library_progress(what.name, "ticks", "flying"))
        result = run_trial(what, "notebook", run, True, keep, RunFeedback(count, warn=warn))
        return _flight_of(result, what.trust)


def _flight_of(result: Result, trust: Trust) -> Flight:
    """Return the flight of a run.

    Raises:
        BadInput: if a law has returned efforts of a wrong shape.
    """
    for error in result.errors:
        if isinstance(error, WrongShape):
            raise BadInput(str(error).replace(f"{MODULE}.", ""), "law")
    return read(result.folder, trust)


def read(run: Path | str, trust: Trust = NO_CODE) -> Flight:
    """Return a flight that was recorded before, in process or over ROS 2.

    Args:
        run: the folder of the run, its bag, or an .mcap file.
        trust: which classes that the log names may be loaded, for example
            Trust.of(["my_metric.py:MyMetric"]); of others the metrics are left out.

    Raises:
        BadInput: there is no bag, or it is damaged.
    """
    bag = BagReader(bag_folder(place(run, "run")), trust=trust)
    signals = read_signals(bag)
    keys = load_yaml(bag.trial_text, f"{bag.path}: trial") or {}
    events = bag.overview.events
    return Flight(
        keys,
        Named(metrics_from(bag), "metric"),
        events,
        signals.time,
        Named(signals.values, "signal"),
        BySignal(signals.units, "signal"),
        user_keys_of(bag),
    )


def linear_model(
    what: What, at: float | str | None = None, sampled: bool = False, **joints: float | str
) -> control.StateSpace:
    """Return the small motions of a trial's testbed about a rest, from efforts to sensors.

    Signals are named as in the log, with a colon for the dot: `effort:yaw`, `tip:left`.

    Args:
        what: as from `trial`, or what `trial` takes.
        at: simulated time [s], or with a unit: the rest that the plan passes then; None: the start.
        sampled: as the bench ticks, with hold, delay and motor lag; else continuous.
        joints: where joints rest instead, by name [rad or m], or with a unit: `30 deg`.

    Raises:
        BadInput: the time is none, or a name is no joint.
    """
    from flexslew_lab.analysis.trial_models import model_of, point_of

    given = trial_from(what)
    return model_of(point_of(given, at, joints), sampled).state_space(given.name)


def nonlinear_model(what: What) -> control.NonlinearIOSystem:
    """Return the whole plant of a trial as python-control simulates it; see linear_model."""
    from flexslew_control.analysis.nonlinear_plant import nonlinear_system

    given = trial_from(what)
    return nonlinear_system(plant_of(given).testbed, given.name)


def trial_from(what: What) -> Trial:
    """Return a trial as it is; of what `trial` takes the trial."""
    return what if isinstance(what, Trial) else trial(what)


def plain_data(value: Any) -> Any:
    """Return a value as YAML holds it: arrays of NumPy, pandas and xarray, sections of a Trial.

    A system of python-control becomes the keys of a `system`.
    """
    if is_section(value):
        return plain(value)
    if is_system(value):
        return law_of_system(value, "system")
    if isinstance(value, Mapping):
        return {str(key): plain_data(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | range):
        return [plain_data(entry) for entry in value]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Fraction | Decimal):
        return float(value)
    return np.asarray(value).tolist() if hasattr(value, "__array__") else value


def place(given: Any, key: str) -> Path:
    """Return a path of the file system.

    Args:
        given: a text, or a path.
        key: that holds it, for the error.

    Raises:
        BadInput: it is neither.
    """
    if not isinstance(given, str | os.PathLike):
        raise BadInput("give a path", key=key, value=given)
    return Path(given)


def by_path(given: Any, key: str) -> dict[str, Any]:
    """Return values by path of a trial; of None none.

    Raises:
        BadInput: they have no paths; with the key that holds them.
    """
    try:
        return dict(given if given is not None else {})
    except (TypeError, ValueError):
        words = "give keys, for example {'testbed.modes': 5}"
        raise BadInput(words, key=key, value=given) from None


def _keys(source: What) -> tuple[str, dict[str, Any]]:
    """Return a name for messages and the keys of a trial."""
    if isinstance(source, Trial):
        return source.name, plain(source)
    if isinstance(source, Mapping):
        return "trial", dict(source)
    path = trial_path(source)
    values = load_yaml(text_of(path), str(path))
    if not isinstance(values, dict):
        raise BadInput("holds no keys", path)
    return label_of(path), values
