"""Metrics of a run, from its bag alone. Streaming: a day costs no more memory than a minute."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexslew_control.law import described
from flexslew_lab.log.bag_layout import RUN_RECORD
from flexslew_lab.log.bag_reader import BagReader, Overview
from flexslew_lab.log.record_schema import LoggedEvent
from flexslew_lab.report.pointing_metrics import PointingMetrics
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import Testbed
from flexslew_plant.testbeds.spacecraft.motions import Pointing

BAND = 0.02  # settling band, of the way that the joint has to go [-]


class TrajectoryHash:
    """SHA-256 over the truth: tick, then position and velocity, as little-endian bytes."""

    def __init__(self) -> None:
        self._digest = hashlib.sha256()

    def update(self, tick: int, position: Vector, velocity: Vector) -> None:
        """Add one tick."""
        state = np.concatenate((position, velocity)).astype("<f8", copy=False)
        self._digest.update(tick.to_bytes(8, "little") + state.tobytes())

    def update_many(self, tick: NDArray[np.uint64], position: Matrix, velocity: Matrix) -> None:
        """Add many ticks, in order; the same as one after another."""
        parts = (tick.astype("<u8")[:, None], position.astype("<f8"), velocity.astype("<f8"))
        rows = np.hstack([np.ascontiguousarray(part).view(np.uint8) for part in parts])
        self._digest.update(rows.tobytes())

    def hexdigest(self) -> str:
        """Return the hash so far, hexadecimal."""
        return self._digest.hexdigest()


class Manoeuvre(NamedTuple):
    """What the numbers are measured against."""

    start: float  # [s]
    end: float  # [s]
    goal: Vector | None  # (joints,)
    way: Vector  # goal - position at the start of the plan, (joints,)


class Facts(NamedTuple):
    """What the truth does not say of a run."""

    joint_names: tuple[str, ...]
    events: Sequence[Any]  # each with epoch, kind, level as a word, and data
    wall_times: list[float]  # recorded besides the events [s]
    complete: bool  # the log was finished
    unprotected: tuple[str, ...] = ()  # parts of the log without a checksum, in words


class Running:
    """Numbers of one epoch of the truth, block after block."""

    def __init__(self, epoch: int, joints: int, manoeuvre: Manoeuvre, limit: Vector) -> None:
        self.epoch, self.manoeuvre, self.limit = epoch, manoeuvre, limit
        self.hash = TrajectoryHash()
        self.samples, self.missing = 0, 0
        self.first_tick, self.last_tick = -1, -1
        self.first_time, self.last_time = 0.0, 0.0
        self.residual_tip, self.peak_tip = 0.0, 0.0
        self.seen_end = False
        self.residual = np.zeros(joints)
        self.beyond = np.zeros(joints)
        self.outside = np.full(joints, -np.inf)  # last time outside of the band
        self.final = np.full(joints, np.nan)
        self.terminal: float | None = None
        self.peak_effort, self.square_sum = np.zeros(joints), np.zeros(joints)
        self.integral, self.saturated = 0.0, 0.0
        self.pointing: PointingMetrics | None = None
        self.joints: Callable[[Vector], tuple[Vector, Vector]] | None = None  # of a state

    def add(self, columns: Mapping[str, Any]) -> None:
        """Take the next ticks."""
        tick, q, v = columns["tick"].astype(np.int64), columns["position"], columns["velocity"]
        time = columns["header.stamp.sec"] + columns["header.stamp.nanosec"] * 1e-9
        joints = self.residual.size
        if columns["applied_effort"].shape[1] != joints or q.shape[1] < joints:
            raise BadInput("the truth changes its number of joints in the course of the run")
        self.hash.update_many(columns["tick"], q, v)
        first = self.first_tick < 0
        steps = np.diff(tick, prepend=tick[0] - 1 if first else self.last_tick)
        self.missing += int(np.maximum(steps - 1, 0).sum())
        if first:
            self.first_tick, self.first_time = int(tick[0]), float(time[0])
        self._efforts(time, columns["applied_effort"])
        tip = np.abs(columns["tip_deflection"]).max(axis=1, initial=0.0)
        self.peak_tip = max(self.peak_tip, float(tip.max()))
        over = time >= self.manoeuvre.end - 1e-9
        if over.any():
            self.residual_tip = max(self.residual_tip, float(tip[over].max()))
        if self.pointing is not None:
            self.pointing.add(time, q, v, columns["applied_effort"])
        if self.manoeuvre.goal is not None:
            self._errors(time, over, q, v, self.manoeuvre.goal)
        self.seen_end = self.seen_end or bool(over.any())
        self.samples += len(tick)
        self.last_tick, self.last_time = int(tick[-1]), float(time[-1])

    def _errors(self, time: Vector, over: Any, q: Matrix, v: Matrix, goal: Vector) -> None:
        joints, way = self.residual.size, self.manoeuvre.way
        where = q[:, :joints]
        if self.joints is not None:
            where = np.array([self.joints(x)[0] for x in np.hstack((q, v))])
        error = where - goal
        if over.any():
            self.residual = np.maximum(self.residual, np.abs(error[over]).max(axis=0))
            if not self.seen_end:
                k = int(np.argmax(over))
                rest = np.concatenate((error[k], q[k, joints:], v[k]))
                self.terminal = float(np.linalg.norm(rest))
        started = time >= self.manoeuvre.start - 1e-9
        if started.any():
            beyond = (error[started] * np.sign(way)).max(axis=0)
            self.beyond = np.maximum(self.beyond, beyond)
        band = BAND * np.where(way == 0.0, np.abs(way).max(initial=0.0), np.abs(way))
        for joint in range(joints):
            outside = np.flatnonzero(np.abs(error[:, joint]) > band[joint])
            if outside.size:
                self.outside[joint] = time[outside[-1]]
        self.final = error[-1].copy()

    def _efforts(self, time: Vector, effort: Matrix) -> None:
        """Count the effort held from the tick before to each tick."""
        before = self.last_time if self.samples else float(time[0])
        held = np.diff(time, prepend=before)
        square = effort**2
        self.peak_effort = np.maximum(self.peak_effort, np.abs(effort).max(axis=0))
        self.square_sum += square.T @ held
        self.integral += float(square.sum(axis=1) @ held)
        if self.limit.size == effort.shape[1]:
            full = (np.abs(effort) >= self.limit * (1.0 - 1e-12)).any(axis=1)
            self.saturated += float(held[full].sum())


def metrics_of(path: Path) -> dict[str, Any]:
    """Return the content of metrics.json, keys as in metric_schema.METRICS, from a bag.

    Args:
        path: the bag's folder or file.

    Raises:
        BadInput: there is no bag, it is damaged or foreign, or it holds no truth.

    """
    return metrics_from(BagReader(path))


def metrics_from(bag: BagReader) -> dict[str, Any]:
    """Return the content of metrics.json from an open bag. See `metrics_of`."""
    overview = bag.overview
    limit = np.zeros(0) if overview.testbed is None else overview.testbed.effort_limit
    running: Running | None = None
    for block in bag.blocks(["/truth"]):
        epochs = block.columns["epoch"]
        for epoch in np.unique(epochs):
            part = epochs == epoch
            columns = {k: c[part] for k, c in block.columns.items()}
            if running is None or epoch > running.epoch:
                joints = columns["applied_effort"].shape[1]
                running = Running(int(epoch), joints, _manoeuvre(overview, joints), limit)
                _point(running, overview, joints)
            running.add(columns)
    if running is None:
        raise BadInput(f"{bag.path}: holds no truth, so there is nothing to measure")
    wall = overview.metadata.get(RUN_RECORD, {}).get("wall_time")
    facts = Facts(
        joint_names_of(overview, running.residual.size),
        overview.events,
        [float(wall)] if wall else [],
        overview.cut is None,
        overview.unprotected,
    )
    return result_of(running, facts)


def _point(running: Running, overview: Overview, joints: int) -> None:
    """Let the testbed of the log say where its joints are and where it points."""
    if overview.testbed is None:
        return
    try:
        testbed = described(overview.testbed.settings, "the log").testbed
    except BadInput:  # of a version that this one does not know
        return
    look_with(running, testbed, joint_names_of(overview, joints))


def look_with(running: Running, testbed: Testbed, names: tuple[str, ...]) -> None:
    """Let a testbed say where its joints are and where its appendages point.

    Args:
        running: before its first tick.
        testbed: that is flown.
        names: of its joints.
    """
    running.joints = testbed.model().reading
    if isinstance(testbed, Pointing):
        m = running.manoeuvre
        goal = {} if m.goal is None else dict(zip(names, m.goal.tolist(), strict=True))
        running.pointing = PointingMetrics(testbed, goal, m.end, names)


def joint_names_of(overview: Overview, joints: int) -> tuple[str, ...]:
    """Return the names of the joints as the bag gives them, else joint_1, joint_2, ..."""
    for source in (overview.testbed, *reversed(overview.plans)):
        if source is not None and len(source.joint_names) == joints:
            return tuple(source.joint_names)
    return tuple(f"joint_{k + 1}" for k in range(joints))


def _manoeuvre(overview: Overview, joints: int) -> Manoeuvre:
    if not overview.plans:
        return Manoeuvre(0.0, 0.0, None, np.zeros(joints))
    plan = overview.plans[-1]
    position = np.asarray(plan.position, dtype=float)
    planned = len(plan.joint_names)
    if planned != joints or not len(position) or len(position) % joints:
        raise BadInput(
            f"the plan has {len(position)} positions for {planned} joints, the truth has "
            f"{joints} joints: not one run"
        )
    position = position.reshape(-1, joints)
    return manoeuvre_of(position, plan.start, plan.duration)


def manoeuvre_of(position: Matrix, start: float, duration: float) -> Manoeuvre:
    """Return what a plan's joint references, shape (ticks + 1, joints), are measured against."""
    return Manoeuvre(start, start + duration, position[-1], position[-1] - position[0])


def result_of(r: Running, facts: Facts) -> dict[str, Any]:
    """Return the content of metrics.json, keys as in metric_schema.METRICS.

    Args:
        r: the last epoch of the truth, to its end.
        facts: what else there is to know.
    """
    names = facts.joint_names
    duration = r.last_time - r.first_time
    m = r.manoeuvre

    def by_joint(values: Vector) -> dict[str, float | None]:
        return {n: float(x) if np.isfinite(x) else None for n, x in zip(names, values, strict=True)}

    nowhere = by_joint(np.full(len(names), np.nan))
    settled = np.where(r.outside < r.last_time, np.maximum(r.outside - m.start, 0.0), np.nan)
    way = np.where(m.way == 0.0, np.nan, np.abs(m.way))
    events = [e for e in facts.events if e.epoch == r.epoch]
    steps = [_step(e.data) for e in events if e.kind == "switched"]
    finished = [e.data for e in events if e.kind == "finished" and isinstance(e.data, dict)]
    wall = [float(data["wall_time"]) for data in finished if "wall_time" in data]
    wall += facts.wall_times
    aimed = m.goal is not None
    return {
        "residual_tip_deflection": r.residual_tip if r.seen_end else None,
        "residual_attitude_error": by_joint(r.residual) if aimed and r.seen_end else nowhere,
        "final_error": by_joint(r.final),
        "terminal_error_norm": r.terminal,
        "settling_time": by_joint(settled) if aimed else nowhere,
        "overshoot": by_joint(r.beyond / way) if aimed else nowhere,
        "peak_tip_deflection": r.peak_tip,
        "peak_effort": by_joint(r.peak_effort),
        "rms_effort": by_joint(np.sqrt(r.square_sum / duration) if duration else r.square_sum),
        "control_effort": r.integral,
        "saturated_time": r.saturated,
        "missed_ticks": sum(_ticks(e.data) for e in events if e.kind == "missed"),
        "switches": len(steps),
        "largest_effort_step": max(steps, default=None),
        "faults": sum(e.level == "fault" or _begins(e) for e in events),
        "fallbacks": sum(e.kind in ("fallback", "brake") for e in events),
        "manoeuvre_start": m.start,
        "manoeuvre_end": m.end,
        "ticks": r.last_tick - r.first_tick,
        "duration": duration,
        "wall_time": wall[-1] if wall else None,
        "trajectory_hash": r.hash.hexdigest(),
        "missing_ticks": r.missing,
        "log_complete": facts.complete,
        "warnings": [f"a changed number is not found: {part}" for part in facts.unprotected],
        **({} if r.pointing is None else r.pointing.result()),
    }


def _begins(event: LoggedEvent) -> bool:
    """Return whether an injected fault begins with this event."""
    return event.kind == "fault" and isinstance(event.data, dict) and bool(event.data.get("on"))


def _ticks(data: Any) -> int:
    return int(data.get("ticks", 1)) if isinstance(data, dict) else 1


def _step(data: Any) -> float:
    step = data.get("effort_step", 0.0) if isinstance(data, dict) else 0.0
    return float(np.abs(np.atleast_1d(np.asarray(step, dtype=float))).max(initial=0.0))
