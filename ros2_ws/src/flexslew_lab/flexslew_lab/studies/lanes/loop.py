"""The compiled loop that flies LANES trials at once: readings, law, drive, testbed, metrics.

It is the compiled form of Sensors, Controller, Drive, Actuator, Bench and the metrics
for one run. What differs from lane to lane stands in one flat array, see rows.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from flexslew_lab.studies.lanes.benches.judge import judging
from flexslew_lab.studies.lanes.benches.lane_faults import setting_in
from flexslew_lab.studies.lanes.benches.quanta import quantising
from flexslew_lab.studies.lanes.benches.senses import Filter, sensing
from flexslew_lab.studies.lanes.groups.rows import Rows, Sizes, rows_of
from flexslew_lab.studies.lanes.laws.efforts import LawNumbers, LawTerms, Troubles, efforts_of
from flexslew_lab.studies.lanes.laws.observers import LaneSignals, Observe
from flexslew_lab.studies.lanes.laws.turned import about_reference
from flexslew_lab.studies.lanes.laws.watch import watching
from flexslew_plant.arrays import Matrix, Tensor, Vector, vectorised
from flexslew_plant.testbeds.compiled.lanes import LANES, KernelRows, LaneKernel

MARGIN = 1.0 - 1e-12  # of the limit: an effort from there on is saturated, as in metrics.efforts


class Schedule(NamedTuple):
    """What is the same in every lane, tick by tick."""

    time: Vector  # stamps, (ticks + 1,) [s]
    over: NDArray[np.bool_]  # the manoeuvre is, (ticks + 1,)
    started: NDArray[np.bool_]  # it has, (ticks + 1,)
    position: Matrix  # reference, (ticks, joints)
    velocity: Matrix


Loop = Callable[..., None]


@lru_cache
def lane_loop(
    kernel: LaneKernel,
    sizes: Sizes,
    terms: LawTerms,
    observe: Observe,
    push: Callable[..., None],
    move: Callable[..., None],
    recorded: bool,
    turns: bool,
    heard: bool,
    filtered: Filter | None,
) -> Loop:
    """Return the loop for a testbed and a law of these sizes.

    It takes (w, dt, steps, Schedule, Troubles, LawNumbers, error, LaneJudge, Watch, turned, Senses,
    LanePushes, LaneFriction, observer, z, memory, filled, first, last, record, draws): w of
    lanes.Advance with the rows of `rows` behind; `error` of the readings, (ticks + 1 or 1, outputs
    LANES); TurnedJoints, if `turns`; w, z and memory in and out; `observer` as `observe` takes it,
    which serves the first `filled` lanes at least; ticks from `first` to before `last`. If
    `recorded`, the truth goes into `record`, (LANES, ticks, states + joints), and is measured
    afterwards; else the loop counts what the metrics need. `draws` are the instruments', (ticks,
    lanes, draws).

    Args:
        kernel: of the testbed.
        sizes: of the group.
        terms: of the law.
        observe: of the law.
        push: what acts from outside; see pushed.pushes_of.
        move: what takes the testbed one tick on; see lane_friction.movement_of.
        recorded: whether the truth is.
        turns: whether the joints read an attitude.
        heard: whether there are instruments.
        filtered: the filters that estimate the joints; None: there are none.
    """
    m, modes, ny = sizes.joints, sizes.modes, sizes.outputs
    rows, of_kernel = rows_of(kernel.size, sizes), kernel.rows
    efforts = efforts_of(of_kernel.effort, rows, sizes, terms)
    metrics = (
        _recorded(of_kernel.effort, rows, sizes) if recorded else _measure(of_kernel, rows, sizes)
    )
    locate, position, velocity, mode = kernel.read, *of_kernel[1:4]
    reading, earlier, effort, own = rows.reading, rows.earlier, rows.applied, rows.own
    tip, tip_rate, mode_rate = rows.tip, rows.tip_rate, of_kernel.mode_rate
    about = about_reference(m, rows.reading, turns and filtered is None)
    quantise = quantising(rows, sizes)
    compare, watch = judging(rows, sizes), watching(rows, sizes)
    kept = ny * LANES * sizes.remembered
    set_in, sense = setting_in(rows, sizes, heard), sensing(rows, sizes, heard, filtered)

    @vectorised
    def read(k: int, error: Matrix, w: Vector) -> None:
        """Write the readings: joints, rates, the first of the tips."""
        row, rates = k if error.shape[0] > 1 else 0, m * LANES
        for i in range(kept):
            w[earlier + i] = w[reading + i]
        for i in range(m * LANES):
            w[reading + i] = w[position + i] + error[row, i]
            w[reading + rates + i] = w[velocity + i] + error[row, rates + i]
        for i in range(2 * m, ny):
            for lane in range(LANES):
                at = error[row, i * LANES + lane]
                for j in range(modes):
                    share = ((i - 2 * m) * modes + j) * LANES + lane
                    at += w[tip + share] * w[mode + j * LANES + lane]
                    at += w[tip_rate + share] * w[mode_rate + j * LANES + lane]
                w[reading + i * LANES + lane] = at

    @vectorised
    def loop(
        w: Vector,
        dt: float,
        steps: int,
        schedule: Any,
        troubles: Troubles,
        law: LawNumbers,
        error: Matrix,
        judge: Any,
        watched: Any,
        turned: Any,
        senses: Any,
        pushes: Any,
        friction: Any,
        observer: Any,
        z: Vector,
        memory: Vector,
        filled: int,
        first: int,
        last: int,
        record: Tensor,
        draws: Tensor,
    ) -> None:
        ticks = schedule.position.shape[0]
        signals = LaneSignals(
            w[reading : reading + ny * LANES],
            w[earlier : earlier + ny * LANES],
            w[effort : effort + m * LANES],
            w[own : own + m * LANES],
        )
        for k in range(first, last):
            locate(filled, w)
            metrics(k, first, schedule, record, w)
            if k == ticks:
                break
            read(k, error, w)
            quantise(w)
            set_in(k, troubles.faults, w, filled)
            compare(k, dt, judge, w)
            if heard:
                draw, reference = draws[k - first], schedule.position[k]
                sense(k, senses, draw, reference, troubles.faults, w, filled)
            about(w, turned, schedule.position[k], filled)
            observe(k, schedule.time[k], dt, observer, signals, z, memory, filled)
            watch(k, watched, z, memory, w)
            efforts(k, schedule.time[k], dt, troubles, law, turned, z, w, filled)
            push(k * dt, 0.5 * dt, pushes, filled, w)
            move(k * dt, dt, steps, friction, filled, w)
            push(k * dt + dt, -0.5 * dt, pushes, filled, w)

    return cast(Loop, loop)


def _recorded(states: int, rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what keeps states and applied efforts of a tick; states: entries times LANES."""
    applied, count, m = rows.applied, states // LANES, sizes.joints

    @vectorised
    def keep(k: int, first: int, schedule: Any, record: Tensor, w: Vector) -> None:
        for lane in range(LANES):
            for i in range(count):
                record[lane, k - first, i] = w[i * LANES + lane]
            for i in range(m):
                record[lane, k - first, count + i] = w[applied + i * LANES + lane]

    return cast(Callable[..., None], keep)


class _Moment(NamedTuple):
    """What a tick is to the metrics."""

    time: float  # [s]
    held: float  # how long the effort before it was [s]
    over: float  # 1: the manoeuvre is
    started: float  # 0: it has; else -inf
    ends: bool  # it is over from here on


@vectorised
def _moment(k: int, schedule: Any) -> _Moment:
    """Return what a tick is to the metrics.

    By numbers alone, and no branch on the way to them: arrays that the compiler has to hold across
    one are counted in and out at every tick, which takes as long as the metrics.
    """
    before = max(k - 1, 0)
    time, over, was_over = schedule.time[k], schedule.over[k], schedule.over[before] & (k > 0)
    held, begun = time - schedule.time[before], schedule.started[k]
    return _Moment(
        time, held, 1.0 if over else 0.0, 0.0 if begun else -np.inf, over and not was_over
    )


def _measure(of_kernel: KernelRows, rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what counts the truth of a tick and the effort that was held before it.

    Lanes are the innermost loop: only such loops become vector instructions.
    """
    m, modes, tips = sizes.joints, sizes.modes, sizes.measured
    effort, tip, goal, sign, band = rows.applied, rows.tip, rows.goal, rows.sign, rows.band
    limit, residual_tip, peak_tip = rows.limit, rows.residual_tip, rows.peak_tip
    bent, full = rows.bent, rows.full
    residual, beyond, outside = rows.residual, rows.beyond, rows.outside
    peak_effort = rows.peak_effort
    square_sum, saturated = rows.square_sum, rows.saturated
    _, position, _, mode, _, _ = of_kernel
    finish = _terminal(of_kernel, rows, sizes)

    @vectorised
    def count(now: _Moment, w: Vector) -> None:
        time, held, over, started = now.time, now.held, now.over, now.started
        for i in range(tips):
            first_share = tip + i * modes * LANES
            for lane in range(LANES):
                w[bent + lane] = w[first_share + lane] * w[mode + lane]
            for j in range(1, modes):
                share = first_share + j * LANES
                for lane in range(LANES):
                    w[bent + lane] += w[share + lane] * w[mode + j * LANES + lane]
            for lane in range(LANES):
                deflection = abs(w[bent + lane])
                w[peak_tip + lane] = max(w[peak_tip + lane], deflection)
                w[residual_tip + lane] = max(w[residual_tip + lane], over * deflection)
        for i in range(m):
            for lane in range(LANES):
                at = i * LANES + lane
                error, push = w[position + at] - w[goal + at], abs(w[effort + at])
                w[residual + at] = max(w[residual + at], over * abs(error))
                w[beyond + at] = max(w[beyond + at], error * w[sign + at] + started)
                w[outside + at] = time if abs(error) > w[band + at] else w[outside + at]
                w[peak_effort + at] = max(w[peak_effort + at], push)
                w[square_sum + at] += held * push * push
                most = push >= w[limit + at] * MARGIN
                w[saturated + lane] += held if most and w[full + lane] < time else 0.0
                w[full + lane] = time if most else w[full + lane]

    @vectorised
    def measure(k: int, first: int, schedule: Any, record: Tensor, w: Vector) -> None:
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
        for i in range(m * LANES):
            w[terminal + i % LANES] += (w[position + i] - w[goal + i]) ** 2
            w[terminal + i % LANES] += w[velocity + i] ** 2
        for i in range(modes * LANES):
            w[terminal + i % LANES] += w[mode + i] ** 2 + w[mode_rate + i] ** 2
        for lane in range(LANES):
            w[terminal + lane] = np.sqrt(w[terminal + lane])

    return cast(Callable[..., None], finish)
