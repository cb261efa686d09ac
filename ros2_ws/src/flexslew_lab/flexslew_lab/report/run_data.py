"""What a report shows of one run, thinned for the eye; a day costs no more memory than a minute."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexslew_lab.log.bag_reader import BagReader, Overview
from flexslew_lab.report.metrics import joint_names_of, metrics_from
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.settings import load_yaml

BUCKETS = 1200  # of which each keeps its smallest and its largest value
FRAMES = 500  # of the animation
LOT = 8192  # rows that wait before they are thinned, or one bucket where that is more


class Trace(NamedTuple):
    """Columns over time; each column has times of its own. NaN rows are gaps."""

    time: Matrix  # (points, columns) [s]
    value: Matrix  # (points, columns)


class Phase(NamedTuple):
    """Who was in charge from when to when."""

    start: float  # [s]
    end: float  # [s]
    controller: str  # empty: the drive's brake


class RunData(NamedTuple):
    """One run as figures need it."""

    label: str
    path: Path
    trial: dict[str, Any]
    overview: Overview
    metrics: dict[str, Any]
    joint_names: tuple[str, ...]
    joint_units: tuple[str, ...]
    traces: dict[str, Trace]  # position, tip, effort, disturbance, reference, feedforward, ...
    terms: dict[str, Trace]  # summands of the effort by name
    phases: tuple[Phase, ...]
    frame_time: Vector  # of the animation, (frames,) [s]
    frame_position: Matrix  # joints and modes, (frames, n)


class Thinner:
    """Keeps the smallest and the largest value of every `size` rows, column by column."""

    def __init__(self, size: int) -> None:
        self._size = max(size, 1)
        self._pending: list[tuple[Vector, Matrix]] = []
        self._rows = 0
        self._done: list[tuple[Matrix, Matrix]] = []

    def add(self, time: Vector, value: Matrix) -> None:
        """Take rows, (n,) and (n, columns); a new number of columns starts after a gap."""
        if self._pending and self._pending[-1][1].shape[1] != value.shape[1]:
            self._reduce(everything=True)
        self._pending.append((time, value))
        self._rows += len(time)
        if self._rows >= max(self._size, LOT):
            self._reduce()

    def gap(self) -> None:
        """Break the lines here."""
        self._reduce(everything=True)
        if self._done:
            nothing = np.full((1, self._done[-1][0].shape[1]), np.nan)
            self._done.append((nothing, nothing))

    def trace(self) -> Trace:
        """Return what was kept."""
        self._reduce(everything=True)
        if not self._done:
            return Trace(np.zeros((0, 0)), np.zeros((0, 0)))
        widest = max(t.shape[1] for t, _ in self._done)
        padded = [[_padded(part, widest) for part in pair] for pair in self._done]
        return Trace(*(np.concatenate([pair[k] for pair in padded]) for k in (0, 1)))

    def _reduce(self, everything: bool = False) -> None:
        if not self._rows:
            return
        time = np.concatenate([t for t, _ in self._pending])
        value = np.concatenate([v for _, v in self._pending])
        whole = len(time) // self._size * self._size
        if self._size == 1:
            self._done.append((_repeated(time, value), value.astype(float)))
        elif whole:
            self._done.append(_extremes(time[:whole], value[:whole], self._size))
        if everything and whole < len(time):
            self._done.append(_extremes(time[whole:], value[whole:], len(time) - whole))
            whole = len(time)
        self._pending = [(time[whole:], value[whole:])] if whole < len(time) else []
        self._rows = len(time) - whole


def read_run(path: Path, label: str = "") -> RunData:
    """Return what a report shows of the bag at `path`.

    Args:
        path: the bag's folder or file.
        label: its name in figures; default: the trial's name.

    Raises:
        BadInput: the bag cannot be read, or holds no truth.

    """
    bag = BagReader(path)
    overview = bag.overview
    metrics = metrics_from(bag)
    trial = load_yaml(bag.trial_text, f"{bag.path}: trial") or {}
    trial = trial if isinstance(trial, dict) else {}
    collector = _Collector(overview.counts)
    for block in bag.blocks(["/truth", "/controller_state", "/measurement"]):
        collector.take(block.topic, block.columns)
    traces = {name: thinner.trace() for name, thinner in collector.thinners.items()}
    joints = traces["effort"].value.shape[1]
    names = joint_names_of(overview, joints)
    known = overview.testbed is not None and len(overview.testbed.joint_units) == joints
    units = tuple(overview.testbed.joint_units) if known else ("rad",) * joints
    return RunData(
        label or str(trial.get("name", "")) or Path(path).name,
        bag.path,
        trial,
        overview,
        metrics,
        names,
        units,
        traces,
        {name: thinner.trace() for name, thinner in collector.terms.items()},
        tuple(collector.phases),
        np.array(collector.frame_time),
        np.array(collector.frame_position),
    )


class _Collector:
    """Takes blocks in the order of the bag; joins estimate and truth by tick."""

    def __init__(self, counts: Mapping[str, int]) -> None:
        ticks = counts.get("/truth", 0)
        self._size = -(-ticks // BUCKETS) if ticks > 2 * BUCKETS else 1
        self._frame_step = max(-(-ticks // FRAMES), 1)
        self._seen = 0
        self.thinners: dict[str, Thinner] = {}
        self.terms: dict[str, Thinner] = {}
        self._term_names: tuple[str, ...] = ()
        self.phases: list[Phase] = []
        self.frame_time: list[float] = []
        self.frame_position: list[Vector] = []
        self._truth: list[tuple[NDArray[np.uint64], Matrix]] = []

    def take(self, topic: str, columns: Mapping[str, Any]) -> None:
        time = columns["header.stamp.sec"] + columns["header.stamp.nanosec"] * 1e-9
        if topic == "/truth":
            self._take_truth(time, columns)
        elif topic == "/measurement":
            self._take_measurement(time, columns["controller"])
        else:
            self._take_state(time, columns)

    def _put(self, name: str, time: Vector, value: Matrix) -> None:
        if value.shape[1]:
            self.thinners.setdefault(name, Thinner(self._size)).add(time, value)

    def _take_truth(self, time: Vector, columns: Mapping[str, Any]) -> None:
        joints = columns["applied_effort"].shape[1]
        self._put("position", time, columns["position"][:, :joints])
        self._put("modes", time, columns["position"][:, joints:])
        self._put("tip", time, columns["tip_deflection"])
        self._put("effort", time, columns["applied_effort"])
        self._put("disturbance", time, columns["disturbance"])
        self._put("energy", time, columns["energy"][:, None])
        self._truth = [*self._truth[-32:], (columns["tick"], columns["position"])]
        rows = np.arange(-self._seen % self._frame_step, len(time), self._frame_step)
        self._seen += len(time)
        self.frame_time.extend(time[rows].tolist())
        self.frame_position.extend(columns["position"][rows])

    def _take_measurement(self, time: Vector, names: NDArray[np.str_]) -> None:
        name, start, end = str(names[0]), float(time[0]), float(time[-1])
        if self.phases and self.phases[-1].controller == name:
            self.phases[-1] = self.phases[-1]._replace(end=end)
            return
        if self.phases:
            self.phases[-1] = self.phases[-1]._replace(end=start)
        self.phases.append(Phase(start, end, name))

    def _take_state(self, time: Vector, columns: Mapping[str, Any]) -> None:
        self._put("reference", time, columns["reference_position"])
        self._put("feedforward", time, columns["feedforward"])
        self._put("demand", time, columns["effort"])
        self._join(time, columns["tick"], columns["estimate_position"])
        names = tuple(columns["term_names"][0])
        if names != self._term_names:
            for name in self._term_names:
                self.terms[name].gap()
            self._term_names = names
        joints = columns["effort"].shape[1]
        values = columns["terms"]
        if values.shape[1] == joints * len(names):
            for k, name in enumerate(names):
                part = values[:, k * joints : (k + 1) * joints]
                self.terms.setdefault(name, Thinner(self._size)).add(time, part)

    def _join(self, time: Vector, tick: NDArray[np.uint64], estimate: Matrix) -> None:
        """Put estimate minus truth where both are known; forget the truth that is older."""
        if not self._truth:
            return
        widths = {position.shape[1] for _, position in self._truth}
        if len(widths) > 1:  # another testbed after a reset: nothing to compare across it
            self._truth = self._truth[-1:]
        ticks = np.concatenate([t for t, _ in self._truth])
        truth = np.concatenate([p for _, p in self._truth])
        _, ours, theirs = np.intersect1d(tick, ticks, assume_unique=False, return_indices=True)
        n = min(estimate.shape[1], truth.shape[1])
        if ours.size:
            error = estimate[ours, :n] - truth[theirs, :n]
            self._put("estimate_error", time[ours], error)
        newer = ticks > tick[-1]
        self._truth = [(ticks[newer], truth[newer])]


def _extremes(time: Vector, value: Matrix, size: int) -> tuple[Matrix, Matrix]:
    """Return the smallest and largest value of each bucket with their times, in order of time."""
    buckets = len(time) // size
    grid = value[: buckets * size].reshape(buckets, size, -1)
    picks = np.sort(np.stack((grid.argmin(axis=1), grid.argmax(axis=1)), axis=1), axis=1)
    values = np.take_along_axis(grid, picks, axis=1)
    times = time[: buckets * size].reshape(buckets, size)[np.arange(buckets)[:, None, None], picks]
    columns = value.shape[1]
    return times.reshape(-1, columns), values.reshape(-1, columns).astype(float)


def _repeated(time: Vector, value: Matrix) -> Matrix:
    return np.repeat(time[:, None], value.shape[1], axis=1)


def _padded(part: Matrix, width: int) -> Matrix:
    if part.shape[1] == width:
        return part
    filler = np.full((len(part), width - part.shape[1]), np.nan)
    return np.hstack((part, filler))
