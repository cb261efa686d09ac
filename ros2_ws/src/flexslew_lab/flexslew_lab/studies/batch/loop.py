"""The compiled loop that flies BATCH_WIDTH trials at once: readings, law, drive, testbed, metrics.

It is the compiled form of Sensors, Controller, Drive, Actuator, Bench and the metrics
for one run. What differs from member to member stands in one flat array, see rows.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from flexslew_lab.metrics.efforts import saturation_excess, squared_effort
from flexslew_lab.metrics.settling import band_excess, goal_excess
from flexslew_lab.studies.batch.benches.batch_faults import setting_in
from flexslew_lab.studies.batch.benches.judge import sensor_check_step
from flexslew_lab.studies.batch.benches.readings import sensor_readings, tip_deflection
from flexslew_lab.studies.batch.benches.senses import Filter, instrument_step
from flexslew_lab.studies.batch.groups.rows import Rows, Sizes, rows_of
from flexslew_lab.studies.batch.laws.efforts import FlightNumbers, LawTerms, efforts_of
from flexslew_lab.studies.batch.laws.observers import BatchSignals, ObserverStep
from flexslew_lab.studies.batch.laws.turned import relative_to_reference
from flexslew_lab.studies.batch.laws.watch import innovation_monitor
from flexslew_plant.arrays import Matrix, Tensor, Vector, called, vectorised
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH, BatchKernel, KernelRows

_saturation_excess, _squared_effort = called(saturation_excess), called(squared_effort)
_goal_excess, _band_excess = called(goal_excess), called(band_excess)


class Schedule(NamedTuple):
    """What is the same in every member, tick by tick."""

    time: Vector  # stamps, (ticks + 1,) [s]
    over: NDArray[np.bool_]  # the manoeuvre is, (ticks + 1,)
    started: NDArray[np.bool_]  # it has, (ticks + 1,)
    position: Matrix  # reference, (ticks, joints)
    velocity: Matrix


Loop = Callable[..., None]


class LoopParts(NamedTuple):
    """The steps of a tick that are made for the sizes of a group, in the order of a loop."""

    read_joints: Callable[..., None]  # (filled, w)
    metrics: Callable[..., None]  # (k, first, schedule, record, w)
    read: Callable[..., None]  # (k, noise, w)
    set_in: Callable[..., None]  # (k, faults, w, filled)
    compare: Callable[..., None]  # (k, dt, sensor check, w)
    read_instruments: Callable[..., None]  # (k, instruments, draws, reference, faults, w, filled)
    replace_positions: Callable[..., None]  # (w, rotation joints, reference, filled)
    watch: Callable[..., None]  # (k, monitor, z, memory, w)
    efforts: Callable[..., None]  # (k, t, flight, z, w)


def loop_parts(
    kernel: BatchKernel, sizes: Sizes, terms: LawTerms, filtered: Filter | None
) -> LoopParts:
    """Return the steps of a tick; see batch_loop for the arguments."""
    rows, of_kernel = rows_of(kernel.size, sizes), kernel.rows
    turns = sizes.reads_attitude and filtered is None
    return LoopParts(
        kernel.read,
        (_recorded if sizes.recorded else _measure)(of_kernel, rows, sizes),
        sensor_readings(of_kernel, rows, sizes),
        setting_in(rows, sizes),
        sensor_check_step(rows, sizes),
        instrument_step(rows, sizes, filtered),
        relative_to_reference(sizes.joints, rows.reading, turns),
        innovation_monitor(rows, sizes),
        efforts_of(of_kernel.effort, rows, sizes, terms),
    )


def batch_signals(kernel: BatchKernel, sizes: Sizes) -> Callable[[Vector], BatchSignals]:
    """Return what gives the views of the flat array that an observer reads."""
    rows = rows_of(kernel.size, sizes)
    read, joints = sizes.outputs * BATCH_WIDTH, sizes.joints * BATCH_WIDTH
    reading, previous, effort, demand = rows.reading, rows.previous, rows.applied, rows.own

    @vectorised
    def signals(w: Vector) -> BatchSignals:
        return BatchSignals(
            w[reading : reading + read],
            w[previous : previous + read],
            w[effort : effort + joints],
            w[demand : demand + joints],
        )

    return cast(Callable[[Vector], BatchSignals], signals)


@lru_cache
def batch_loop(
    kernel: BatchKernel,
    sizes: Sizes,
    terms: LawTerms,
    observer_step: ObserverStep,
    push: Callable[..., None],
    move: Callable[..., None],
    filtered: Filter | None,
) -> Loop:
    """Return the loop for a testbed and a law of these sizes.

    It takes (FlightNumbers, w, z, memory, first, last, record, draws): w of batch_kernel.Advance
    with the rows of `rows` behind; w, z and memory in and out; the observer serves the first
    members in use at least; ticks from `first` to before `last`. If `sizes.recorded`, the truth
    goes into `record`, (BATCH_WIDTH, ticks, states + joints), and is measured afterwards; else the
    loop counts what the metrics need. `draws` are the instruments', (ticks, members, draws).

    Args:
        kernel: of the testbed.
        sizes: of the group.
        terms: of the law.
        observer_step: of the law.
        push: what acts from outside; see pushed.forces_of.
        move: what takes the testbed one tick on; see batch_friction.motion_of.
        filtered: the filters that estimate the joints; None: there are none.
    """
    parts = loop_parts(kernel, sizes, terms, filtered)
    read_joints, metrics, read, set_in, compare = parts[:5]
    read_instruments, replace_positions, watch, efforts = parts[5:]
    signals_of, has_instruments = batch_signals(kernel, sizes), sizes.has_instruments

    @vectorised
    def loop(
        flight: FlightNumbers,
        w: Vector,
        z: Vector,
        memory: Vector,
        first: int,
        last: int,
        record: Tensor,
        samples: Tensor,
    ) -> None:
        dt, _, filled, schedule, disturbances = flight[:5]
        ticks = schedule.position.shape[0]
        signals = signals_of(w)
        for k in range(first, last):
            read_joints(filled, w)
            metrics(k, first, schedule, record, w)
            if k == ticks:
                break
            read(k, flight.noise, w)
            set_in(k, disturbances.faults, w, filled)
            compare(k, dt, flight.sensor_check, w)
            if has_instruments:
                draws = samples[k - first], schedule.position[k], disturbances.faults
                read_instruments(k, flight.instruments, *draws, w, filled)
            replace_positions(w, flight.rotation_joints, schedule.position[k], filled)
            observer_step(k, schedule.time[k], dt, flight.observer, signals, z, memory, filled)
            watch(k, flight.monitor, z, memory, w)
            efforts(k, schedule.time[k], flight, z, w)
            push(k * dt, 0.5 * dt, flight.external_forces, filled, w)
            move(k * dt, dt, flight.steps, flight.friction, filled, w)
            push(k * dt + dt, -0.5 * dt, flight.external_forces, filled, w)

    return cast(Loop, loop)


def _recorded(of_kernel: KernelRows, rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what keeps states and applied efforts of a tick."""
    applied, count, m = rows.applied, of_kernel.effort // BATCH_WIDTH, sizes.joints

    @vectorised
    def keep(k: int, first: int, schedule: Schedule, record: Tensor, w: Vector) -> None:
        for member in range(BATCH_WIDTH):
            for i in range(count):
                record[member, k - first, i] = w[i * BATCH_WIDTH + member]
            for i in range(m):
                record[member, k - first, count + i] = w[applied + i * BATCH_WIDTH + member]

    return cast(Callable[..., None], keep)


class _Moment(NamedTuple):
    """What a tick is to the metrics."""

    time: float  # [s]
    held: float  # how long the effort before it was [s]
    over: float  # 0: the manoeuvre is; else -inf
    started: float  # 0: it has; else -inf
    ends: bool  # it is over from here on


@vectorised
def _moment(k: int, schedule: Schedule) -> _Moment:
    """Return what a tick is to the metrics.

    By numbers alone, and no branch on the way to them: arrays that the compiler has to hold across
    one are counted in and out at every tick, which takes as long as the metrics.
    """
    before = max(k - 1, 0)
    time, over, was_over = schedule.time[k], schedule.over[k], schedule.over[before] & (k > 0)
    hold_time, started = time - schedule.time[before], schedule.started[k]
    return _Moment(
        time,
        hold_time,
        0.0 if over else -np.inf,
        0.0 if started else -np.inf,
        over and not was_over,
    )


def _measure(of_kernel: KernelRows, rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what counts the truth of a tick and the effort that was held before it.

    Members are the innermost loop: only such loops become vector instructions.
    """
    m, tips, deflect = sizes.joints, sizes.measured, tip_deflection(of_kernel, rows, sizes)
    effort, goal, sign, band = rows.applied, rows.goal, rows.sign, rows.band
    limit, residual_tip, peak_tip = rows.limit, rows.residual_tip, rows.peak_tip
    deflections, full = rows.deflection, rows.full
    residual, overshoot, outside = rows.residual, rows.limit_excess, rows.outside
    peak_effort = rows.peak_effort
    square_sum, saturated = rows.square_sum, rows.saturated
    position = of_kernel.position
    finish = _terminal(of_kernel, rows, sizes)

    @vectorised
    def count(now: _Moment, w: Vector) -> None:
        time, hold_time, over, started = now.time, now.held, now.over, now.started
        for i in range(tips):
            deflect(i, deflections, w)
            for member in range(BATCH_WIDTH):
                deflection = abs(w[deflections + member])
                w[peak_tip + member] = max(w[peak_tip + member], deflection)
                w[residual_tip + member] = max(w[residual_tip + member], deflection + over)
        for i in range(m):
            for member in range(BATCH_WIDTH):
                at = i * BATCH_WIDTH + member
                error, push = w[position + at] - w[goal + at], abs(w[effort + at])
                w[residual + at] = max(w[residual + at], abs(error) + over)
                excess = _goal_excess(error, w[sign + at])
                w[overshoot + at] = max(w[overshoot + at], excess + started)
                is_outside = _band_excess(error, w[band + at]) > 0.0
                w[outside + at] = time if is_outside else w[outside + at]
                w[peak_effort + at] = max(w[peak_effort + at], push)
                w[square_sum + at] += _squared_effort(push, hold_time)
                most = _saturation_excess(push, w[limit + at]) >= 0.0
                w[saturated + member] += hold_time if most and w[full + member] < time else 0.0
                w[full + member] = time if most else w[full + member]

    @vectorised
    def measure(k: int, first: int, schedule: Schedule, record: Tensor, w: Vector) -> None:
        now = _moment(k, schedule)
        count(now, w)
        if now.ends:
            finish(w)

    return cast(Callable[..., None], measure)


def _terminal(of_kernel: KernelRows, rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what writes the norm of the error at the end of the manoeuvre."""
    m, modes, terminal, goal = sizes.joints, sizes.modes, rows.terminal, rows.goal
    _, position, velocity, mode, mode_rate, _ = of_kernel

    @vectorised
    def finish(w: Vector) -> None:
        for i in range(m * BATCH_WIDTH):
            w[terminal + i % BATCH_WIDTH] += (w[position + i] - w[goal + i]) ** 2
            w[terminal + i % BATCH_WIDTH] += w[velocity + i] ** 2
        for i in range(modes * BATCH_WIDTH):
            w[terminal + i % BATCH_WIDTH] += w[mode + i] ** 2 + w[mode_rate + i] ** 2
        for member in range(BATCH_WIDTH):
            w[terminal + member] = np.sqrt(w[terminal + member])

    return cast(Callable[..., None], finish)
