"""Faults at work in lanes: at sensors, between law and motors, and on what the motors give.

Lane after lane, in the order in which they set in, as faults.injection does it for one run.
"""

from collections.abc import Callable, Sequence
from math import ceil
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from flexslew_lab.studies.lanes.groups.charge import OF_ANSWERS
from flexslew_lab.studies.lanes.groups.lane_trial import LaneTrial
from flexslew_lab.studies.lanes.groups.rows import Rows, Sizes
from flexslew_lab.studies.lanes.groups.strikes import struck
from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector, called, compiled
from flexslew_plant.faults import Fault, Timed
from flexslew_plant.faults.actuators import ActuatorGain, ActuatorStuck, CommandDelay
from flexslew_plant.faults.effects import Names
from flexslew_plant.faults.sensors import SensorBias, SensorDropout, SensorFreeze, SensorNan
from flexslew_plant.testbeds.compiled.lanes import LANES

Flags: TypeAlias = NDArray[np.bool_]
BIAS, DROPOUT, FREEZE, NAN, STUCK, GAIN, DELAY = range(7)
_KINDS: dict[type[Any], int] = {
    SensorBias: BIAS,
    SensorDropout: DROPOUT,
    SensorFreeze: FREEZE,
    SensorNan: NAN,
    ActuatorStuck: STUCK,
    ActuatorGain: GAIN,
    CommandDelay: DELAY,
}
_OF_SENSORS = NAN  # kinds up to this one
_CHANNELS = ("joint_position", "joint_velocity", "tip_deflection")  # that a law may read


def is_known(fault: Fault) -> bool:
    """Return whether batches fly a fault: of these kinds themselves, as a new one may do more."""
    return type(fault) in _KINDS or type(fault) in OF_ANSWERS


class LaneFaults(NamedTuple):
    """The faults of a group; one that never begins stands where a lane has fewer than others."""

    sets_in: Flags  # whether one sets in in any lane, (ticks,), as the three below
    misled: Flags  # sensors are
    weak: Flags  # motors, or what reaches them
    unanswered: Flags  # an answer is lost
    missed: Flags  # answers that are lost, (ticks, lanes)
    kind: Indices  # (lanes, faults), as all below
    begin: Indices  # first tick
    end: Indices  # first tick after it
    first: Indices  # entry that it is about: of joints, rates and tips, or of the efforts
    last: Indices  # first one that it is not about
    number: Matrix  # bias, gain, delay [ticks], or effort; NaN: the last one before it
    strikes: Flags  # whether a dropout does, (lanes, faults, ticks)
    memory: Tensor  # (lanes, faults, numbers): frozen readings, the stuck effort, a queue


class _Fault(NamedTuple):
    """A fault of one lane."""

    timed: Timed
    kind: int
    first: int
    last: int
    number: float
    size: int  # of its memory


def faults_of(lanes: Sequence[LaneTrial], ticks: int) -> LaneFaults | None:
    """Return the faults of a group; None: there are none that change a motion."""
    if not any(lane.happens.faults or lane.happens.charge.missed is not None for lane in lanes):
        return None
    each = [_faults(lane) for lane in lanes]
    missed = np.zeros((ticks, len(lanes)), np.bool_)
    for k, lane in enumerate(lanes):
        if lane.happens.charge.missed is not None:
            missed[:, k] = lane.happens.charge.missed
    most = max(map(len, each))
    if not (most or missed.any()):
        return None
    sets_in, misled, weak = (np.zeros(ticks, np.bool_) for _ in range(3))
    shape = len(lanes), most
    size = max((fault.size for faults in each for fault in faults), default=0)
    kind, begin, end, first, last = (np.zeros(shape, np.int64) for _ in range(5))
    number, strikes = np.zeros(shape), np.zeros((*shape, ticks), np.bool_)
    for k, (lane, faults) in enumerate(zip(lanes, each, strict=True)):
        for f, fault in enumerate(faults):
            start, stop = fault.timed.start, int(min(fault.timed.end, ticks))
            kind[k, f], number[k, f] = fault.kind, fault.number
            begin[k, f], end[k, f], first[k, f], last[k, f] = start, stop, fault.first, fault.last
            sets_in[start : start + 1] = True
            (misled if fault.kind <= _OF_SENSORS else weak)[start:stop] = True
            if fault.kind == DROPOUT:
                strikes[k, f] = struck(fault.timed, lane.trial.seed, ticks)
    by_tick = sets_in, misled, weak, np.array(missed.any(axis=1)), missed
    memory = np.zeros((*shape, size))
    return LaneFaults(*by_tick, kind, begin, end, first, last, number, strikes, memory)


def _faults(lane: LaneTrial) -> list[_Fault]:
    """Return what changes readings or efforts, in the order in which it sets in."""
    model = lane.model
    names = Names(model.joint_names, model.appendages.names, ())
    acting = [timed for timed in lane.happens.faults if type(timed.fault) not in OF_ANSWERS]
    found = [_fault(timed, names) for timed in acting]
    known = [fault for fault in found if fault is not None]
    return sorted(known, key=lambda fault: fault.timed.start)


def _fault(timed: Timed, names: Names) -> _Fault | None:
    """Return a fault by its numbers; None: no law reads that channel."""
    fault: Any = timed.fault
    kind, number, m = _KINDS[type(fault)], 0.0, len(names.joints)
    if kind > _OF_SENSORS:
        first, last = 0, m
        if fault.joint is not None:
            first = names.joints.index(fault.joint)
            last = first + 1
        size = 1
        if kind == DELAY:
            number, size = fault.ticks, ceil(fault.ticks) * m
        elif kind == GAIN:
            number = fault.gain
        else:
            number = np.nan if fault.effort is None else fault.effort
        return _Fault(timed, kind, first, last, number, size)
    if fault.channel not in _CHANNELS:
        return None
    channel = _CHANNELS.index(fault.channel)
    first, all_names = channel * m, names.of(fault.channel)
    last = first + len(all_names)
    if fault.of is not None:
        first += all_names.index(fault.of)
        last = first + 1
    if kind == BIAS:
        number = fault.bias
    return _Fault(timed, kind, first, last, number, last - first)


@called
def spoil(k: int, lane: int, faults: LaneFaults, place: int, values: Vector) -> None:
    """Put wrong readings in the place of some of a lane's.

    Args:
        k: tick.
        lane: of the group.
        faults: of it.
        place: entry of joints, rates and tips at which the values begin.
        values: of the sensors, changed.
    """
    kinds, begin, end, memory = faults.kind, faults.begin, faults.end, faults.memory
    firsts, lasts, number, strikes = faults.first, faults.last, faults.number, faults.strikes
    for f in range(kinds.shape[1]):
        kind, first = kinds[lane, f], firsts[lane, f]
        if kind > _OF_SENSORS or not begin[lane, f] <= k < end[lane, f]:
            continue
        for i in range(max(first, place), min(lasts[lane, f], place + values.size)):
            if kind == BIAS:
                values[i - place] += number[lane, f]
            elif kind == DROPOUT:
                values[i - place] = 0.0 if strikes[lane, f, k] else values[i - place]
            elif kind == NAN:
                values[i - place] = np.nan
            else:
                if k == begin[lane, f]:
                    memory[lane, f, i - first] = values[i - place]
                values[i - place] = memory[lane, f, i - first]


def setting_in(rows: Rows, sizes: Sizes, heard: bool) -> Callable[..., None]:
    """Return what lets faults set in at a tick, and sensors read what is wrong.

    It takes (k, LaneFaults, w, first lanes to be asked for).

    Args:
        rows: of the group.
        sizes: of the group.
        heard: whether instruments read the tips, later in the tick.
    """
    if not sizes.broken:
        return _nothing_sets_in
    reading, begin = rows.reading, _remembering(rows, sizes)
    count = 2 * sizes.joints if heard else sizes.outputs

    @compiled
    def set_in(k: int, faults: LaneFaults, w: Vector, filled: int) -> None:
        if faults.sets_in[k]:
            begin(k, faults, w, filled)
        if not faults.misled[k]:
            return
        values = np.empty(count)
        for lane in range(filled):
            for i in range(count):
                values[i] = w[reading + i * LANES + lane]
            spoil(k, lane, faults, 0, values)
            for i in range(count):
                w[reading + i * LANES + lane] = values[i]

    return cast(Callable[..., None], set_in)


def _remembering(rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what keeps for a fault that sets in what was asked of the drives, or applied."""
    asked, applied, m = rows.asked, rows.applied, sizes.joints

    @compiled
    def begin(k: int, faults: LaneFaults, w: Vector, filled: int) -> None:
        kind, begins, memory = faults.kind, faults.begin, faults.memory
        number, first = faults.number, faults.first
        for lane in range(filled):
            for f in range(kind.shape[1]):
                if begins[lane, f] != k:
                    continue
                if kind[lane, f] == STUCK:
                    memory[lane, f, 0] = number[lane, f]
                    if np.isnan(number[lane, f]):
                        memory[lane, f, 0] = w[applied + first[lane, f] * LANES + lane]
                elif kind[lane, f] == DELAY:
                    for i in range(int(np.ceil(number[lane, f])) * m):
                        memory[lane, f, i] = w[asked + i % m * LANES + lane]

    return cast(Callable[..., None], begin)


def broken_demand(rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what holds the last demand on a drive where an answer is lost, and changes it.

    It takes (k, joint, LaneFaults, w, first lanes to be asked for).

    Args:
        rows: of the group.
        sizes: of the group.
    """
    if not sizes.broken:
        return _nothing_breaks
    asked, effort, m = rows.asked, rows.applied, sizes.joints

    @compiled
    def change(k: int, i: int, faults: LaneFaults, w: Vector, filled: int) -> None:
        kind, begin, end, memory = faults.kind, faults.begin, faults.end, faults.memory
        first, last, number = faults.first, faults.last, faults.number
        for lane in range(filled):
            at, most = effort + i * LANES + lane, kind.shape[1]
            for n in range(2 * most):  # delays, the last one to set in first, then gains
                f = most - 1 - n if n < most else n - most
                about = first[lane, f] <= i < last[lane, f]
                if not (about and begin[lane, f] <= k < end[lane, f]):
                    continue
                if n >= most and kind[lane, f] == GAIN:
                    w[at] *= number[lane, f]
                elif n < most and kind[lane, f] == DELAY:
                    since, queued = k - begin[lane, f], int(np.ceil(number[lane, f]))
                    oldest, part = since % queued * m + i, number[lane, f] % 1.0
                    before, memory[lane, f, oldest] = memory[lane, f, oldest], w[at]
                    then = memory[lane, f, (since + 1) % queued * m + i]
                    w[at] = (1.0 - part) * then + part * before if part > 0.0 else before

    @compiled
    def ask(k: int, i: int, faults: LaneFaults, w: Vector, filled: int) -> None:
        row = i * LANES
        if faults.unanswered[k]:
            missed = faults.missed
            for lane in range(filled):
                if missed[k, lane]:
                    w[effort + row + lane] = w[asked + row + lane]
        for lane in range(LANES):
            w[asked + row + lane] = w[effort + row + lane]
        if faults.weak[k]:
            change(k, i, faults, w, filled)

    return cast(Callable[..., None], ask)


def broken_motors(rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what puts stuck efforts in the place of those that motors would give.

    It takes (k, joint, LaneFaults, w, first lanes to be asked for).

    Args:
        rows: of the group.
        sizes: of the group.
    """
    if not sizes.broken:
        return _nothing_breaks
    effort = rows.applied

    @compiled
    def give(k: int, i: int, faults: LaneFaults, w: Vector, filled: int) -> None:
        if not faults.weak[k]:
            return
        kind, begin, end, memory = faults.kind, faults.begin, faults.end, faults.memory
        first = faults.first
        for lane in range(filled):
            for f in range(kind.shape[1]):
                stuck = kind[lane, f] == STUCK and first[lane, f] == i
                if stuck and begin[lane, f] <= k < end[lane, f]:
                    w[effort + i * LANES + lane] = memory[lane, f, 0]

    return cast(Callable[..., None], give)


@compiled
def _nothing_sets_in(k: int, faults: Any, w: Vector, filled: int) -> None:
    pass


@compiled
def nothing_spoilt(k: int, lane: int, faults: Any, place: int, values: Vector) -> None:
    """Leave the readings as they are."""


@compiled
def _nothing_breaks(k: int, i: int, faults: Any, w: Vector, filled: int) -> None:
    pass
