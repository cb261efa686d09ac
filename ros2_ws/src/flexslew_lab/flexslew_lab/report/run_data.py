"""What a report shows of one run, thinned for the eye; a day costs no more memory than a minute."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexslew_lab.log.bag_reader import BagReader, Overview
from flexslew_lab.log.messages.logged_text import logged_yaml
from flexslew_lab.metrics.from_bag import joint_names_of, metrics_from
from flexslew_plant.arrays import Matrix, Vector

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


class Span(NamedTuple):
    """A fault or a disturbance from its beginning to its end."""

    kind: str  # fault or disturbance
    words: str  # what it is, for a person
    start: float  # [s]
    end: float  # [s]


class RunData(NamedTuple):
    """One run as figures need it."""

    label: str
    path: Path
    trial: dict[str, Any]
    overview: Overview
    metrics: dict[str, Any]
    joint_names: tuple[str, ...]
    joint_units: tuple[str, ...]
    appendage_names: tuple[str, ...]
    goal: dict[str, float]  # by joint [rad or m]; empty without a plan
    spans: tuple[Span, ...]  # faults and disturbances
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
    trial = logged_yaml(bag.trial_text, f"{bag.path}: trial")
    testbed = overview.testbed
    collector = _Collector(
        overview.counts, len(testbed.joint_names) if testbed is not None else None
    )
    for block in bag.blocks(["/truth", "/controller_state", "/measurement"]):
        collector.take(block.topic, block.columns)
    traces = {name: thinner.trace() for name, thinner in collector.thinners.items()}
    joints = collector.joints or 0
    names = joint_names_of(overview, joints)
    known = testbed is not None and len(testbed.joint_units) == joints
    tips = traces["tip"].value.shape[1] if "tip" in traces else 0
    end = float(np.nanmax(traces["effort"].time, initial=0.0))
    return RunData(
        label or str(trial.get("name", "")) or Path(path).name,
        bag.path,
        trial,
        overview,
        metrics,
        names,
        tuple(testbed.joint_units) if known else ("rad",) * joints,
        appendage_names_of(overview, tips),
        _goal(overview),
        tuple(_spans(overview, end)),
        traces,
        {name: thinner.trace() for name, thinner in collector.terms.items()},
        tuple(collector.phases),
        np.array(collector.frame_time),
        np.array(collector.frame_position),
    )


def appendage_names_of(overview: Overview, count: int) -> tuple[str, ...]:
    """Return the names of the appendages as the bag gives them, else appendage_1, ..."""
    testbed = overview.testbed
    if testbed is not None and len(testbed.appendage_names) == count:
        return tuple(testbed.appendage_names)
    return tuple(f"appendage_{k + 1}" for k in range(count))


def _goal(overview: Overview) -> dict[str, float]:
    """Return where the last plan ends, by joint."""
    if not overview.plans:
        return {}
    plan = overview.plans[-1]
    position = np.asarray(plan.position, dtype=float).reshape(-1, max(len(plan.joint_names), 1))
    return dict(zip(plan.joint_names, position[-1].tolist(), strict=True))


def _spans(overview: Overview, end: float) -> Iterator[Span]:
    """Yield faults and disturbances from their events, in the order of their beginnings."""
    testbed = overview.testbed
    units = dict(zip(testbed.joint_names, testbed.joint_units, strict=True)) if testbed else {}
    known = [
        e
        for e in overview.events
        if e.kind in ("fault", "disturbance") and isinstance(e.data, dict)
    ]
    for k, event in enumerate(known):
        data = {key: value for key, value in event.data.items() if key != "on"}
        if not event.data.get("on"):
            continue
        over = (
            e.time
            for e in known[k + 1 :]
            if e.kind == event.kind and not e.data.get("on")
            and {key: value for key, value in e.data.items() if key != "on"} == data
        )  # fmt: skip
        until = next(over, max(end, event.time))
        yield Span(event.kind, _words(event.kind, data, units), event.time, until)


def _words(kind: str, data: Mapping[str, Any], units: Mapping[str, str]) -> str:
    """Return a fault or a disturbance in words, as its settings have it."""
    if kind == "fault":
        settings = dict(data.get("fault") or {})
        name = settings.pop("kind", "fault")
        said = [f"{key} {value}" for key, value in settings.items() if value is not None]
        return f"{name} ({', '.join(said)})" if said else str(name)
    shapes = [
        f"{_shape(shape)} {'N' if units.get(joint) == 'm' else 'N m'} on {joint}"
        for joint, shape in data.items()
    ]
    return f"disturbance of {' and '.join(shapes)}"


def _shape(shape: Any) -> str:
    if not isinstance(shape, dict):
        return f"{shape:g}"
    return ", ".join(
        f"{form}: " + ", ".join(f"{k} {v:g}" for k, v in values.items() if v is not None)
        for form, values in shape.items()
        if isinstance(values, dict)
    )


class _Collector:
    """Takes blocks in the order of the bag; joins estimate and truth by epoch and tick."""

    def __init__(self, counts: Mapping[str, int], joints: int | None) -> None:
        self.joints = joints  # None: as many as efforts
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
        self._truth, self._estimate = _Waiting(), _Waiting()

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
        efforts = columns["applied_effort"].shape[1]
        if self.joints is None or self.joints > columns["position"].shape[1]:
            self.joints = efforts
        joints = self.joints
        self._put("position", time, columns["position"][:, :joints])
        self._put("modes", time, columns["position"][:, joints:])
        self._put("tip", time, columns["tip_deflection"])
        self._put("effort", time, columns["applied_effort"])
        self._put("disturbance", time, columns["disturbance"])
        self._put("energy", time, columns["energy"][:, None])
        self._truth.add(_keys(columns), columns["position"])
        self._join()
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
        self._estimate.add(
            _keys(columns), np.column_stack((time, columns["estimate_position"].astype(float)))
        )
        self._join()
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

    def _join(self) -> None:
        """Put estimate minus truth where both are known; the rest waits for its counterpart."""
        for estimate, truth in self._estimate.matched(self._truth):
            n = min(estimate.shape[1] - 1, truth.shape[1])
            self._put("estimate_error", estimate[:, 0], estimate[:, 1 : n + 1] - truth[:, :n])


class _Waiting:
    """Rows by epoch and tick that wait for those of another topic."""

    def __init__(self) -> None:
        self._parts: list[tuple[NDArray[np.uint64], Matrix]] = []  # of one width each

    def add(self, keys: NDArray[np.uint64], rows: Matrix) -> None:
        """Take rows, newer than those before."""
        if self._parts and self._parts[-1][1].shape[1] == rows.shape[1]:
            before = self._parts.pop()
            keys = np.concatenate((before[0], keys))
            rows = np.concatenate((before[1], rows))
        self._parts.append((keys, rows))

    def matched(self, other: "_Waiting") -> list[tuple[Matrix, Matrix]]:
        """Return rows of both with equal keys, in order; forget what will find no counterpart."""
        found = []
        for keys, rows in self._parts:
            for their_keys, their_rows in other._parts:
                _, ours, theirs = np.intersect1d(keys, their_keys, return_indices=True)
                if ours.size:
                    found.append((rows[ours], their_rows[theirs]))
        if self._parts and other._parts:
            last = min(self._last, other._last)
            self._forget(last)
            other._forget(last)
        return found

    @property
    def _last(self) -> int:
        return max(int(keys.max(initial=0)) for keys, _ in self._parts)

    def _forget(self, last: int) -> None:
        kept = [(keys, rows, keys > np.uint64(last)) for keys, rows in self._parts]
        self._parts = [(k[newer], r[newer]) for k, r, newer in kept if newer.any()]


def _keys(columns: Mapping[str, Any]) -> NDArray[np.uint64]:
    """Return epoch and tick as one number that rises, (rows,)."""
    keys = (columns["epoch"].astype(np.uint64) << np.uint64(40)) + columns["tick"].astype(np.uint64)
    return np.asarray(keys)


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
