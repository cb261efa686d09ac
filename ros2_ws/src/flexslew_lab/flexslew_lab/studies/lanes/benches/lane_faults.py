"""Faults at work in lanes: at sensors, between law and motors, and on what the motors give.

Lane after lane, by the steps of the bench, in the order in which they set in, as faults.injection
does it for one run.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from flexslew_lab.studies.lanes.groups.charge import OF_ANSWERS
from flexslew_lab.studies.lanes.groups.lane_trial import LaneTrial
from flexslew_lab.studies.lanes.groups.rows import Rows, Sizes
from flexslew_lab.studies.lanes.groups.strikes import struck
from flexslew_plant.arrays import Indices, Tensor, Vector, called, compiled
from flexslew_plant.faults import Fault, Timed
from flexslew_plant.faults.dispatch import any_step, number_of
from flexslew_plant.faults.effects import Names
from flexslew_plant.faults.steps import FaultAction, Where
from flexslew_plant.testbeds.compiled.lanes import LANES

Flags: TypeAlias = NDArray[np.bool_]
_READING, _LATE, _DEMAND, _EFFORT = (int(where) for where in Where)
_CHANNELS = ("joint_position", "joint_velocity", "tip_deflection")  # that a law may read


def is_known(fault: Fault) -> bool:
    """Return whether batches fly a fault: those with a step, and the shipped ones of answers."""
    return number_of(fault) is not None or type(fault) in OF_ANSWERS


class LaneFaults(NamedTuple):
    """The faults of a group; one that never begins stands where a lane has fewer than others."""

    sets_in: Flags  # whether one sets in in any lane, (ticks,), as the three below
    misled: Flags  # sensors are
    weak: Flags  # motors, or what reaches them
    unanswered: Flags  # an answer is lost
    missed: Flags  # answers that are lost, (ticks, lanes)
    kind: Indices  # number of its step, (lanes, faults), as all below
    where: Indices  # it acts
    begin: Indices  # first tick
    end: Indices  # first tick after it
    first: Indices  # entry on which it acts: of joints, rates and tips, or of the efforts
    last: Indices  # first one on which it does not act
    size: Indices  # of its memory, for each entry
    numbers: Tensor  # of its step, (lanes, faults, numbers)
    strikes: Flags  # whether it acts, (lanes, faults, ticks)
    memory: Tensor  # of its entries, one after another, (lanes, faults, numbers)


class _Fault(NamedTuple):
    """A fault of one lane."""

    timed: Timed
    kind: int
    action: FaultAction
    place: int  # of the action's channel among joints, rates and tips

    @property
    def size(self) -> int:
        """Numbers of its memory."""
        return (self.action.last - self.action.first) * self.action.memory


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
    shape, known = (len(lanes), most), [fault for faults in each for fault in faults]
    kind, where, begin, end, first, last, size = (np.zeros(shape, np.int64) for _ in range(7))
    numbers = np.zeros((*shape, max((len(fault.action.numbers) for fault in known), default=0)))
    strikes = np.zeros((*shape, ticks), np.bool_)
    for k, (lane, faults) in enumerate(zip(lanes, each, strict=True)):
        for f, fault in enumerate(faults):
            action, at = fault.action, (k, f)
            start, stop = fault.timed.start, int(min(fault.timed.end, ticks))
            kind[at], where[at], size[at] = fault.kind, action.where, action.memory
            begin[at], end[at] = start, stop
            first[at], last[at] = fault.place + action.first, fault.place + action.last
            numbers[at][: len(action.numbers)] = action.numbers
            strikes[at] = struck(fault.timed, lane.trial.seed, ticks)
            sets_in[start : start + 1] = True
            (misled if action.where is Where.READING else weak)[start:stop] = True
    by_tick = sets_in, misled, weak, np.array(missed.any(axis=1)), missed
    memory = np.zeros((*shape, max((fault.size for fault in known), default=0)))
    each_fault = kind, where, begin, end, first, last, size
    return LaneFaults(*by_tick, *each_fault, numbers, strikes, memory)


def _faults(lane: LaneTrial) -> list[_Fault]:
    """Return what changes readings or efforts, in the order in which it sets in."""
    model = lane.model
    names = Names(model.joint_names, model.appendages.names, ())
    found = [_fault(timed, names) for timed in lane.happens.faults]
    known = [fault for fault in found if fault is not None]
    return sorted(known, key=lambda fault: fault.timed.start)


def _fault(timed: Timed, names: Names) -> _Fault | None:
    """Return a fault with its action; None: it is one of answers, or no law reads the channel."""
    fault: Any = timed.fault
    kind = number_of(fault)
    if kind is None:
        return None
    action: FaultAction = fault.action(names)
    if action.where is not Where.READING:
        return _Fault(timed, kind, action, 0)
    if action.channel not in _CHANNELS:
        return None
    return _Fault(timed, kind, action, _CHANNELS.index(action.channel) * len(names.joints))


@lru_cache
def _changing() -> Callable[..., float]:
    """Return what gives the value of an entry after all faults of a lane.

    It takes (k, lane, LaneFaults, where they act, entry, value).
    """
    step = any_step()

    @called
    def change(k: int, lane: int, faults: LaneFaults, where: int, i: int, value: float) -> float:
        kinds, begin, end, strikes = faults.kind, faults.begin, faults.end, faults.strikes
        firsts, lasts, sizes = faults.first, faults.last, faults.size
        count = kinds.shape[1]
        for n in range(count):
            f = count - 1 - n if where == _LATE else n  # of two delays the later one to set in
            first, size = firsts[lane, f], sizes[lane, f]
            about = faults.where[lane, f] == where and first <= i < lasts[lane, f]
            if about and begin[lane, f] <= k < end[lane, f] and strikes[lane, f, k]:
                own = faults.memory[lane, f, (i - first) * size : (i - first + 1) * size]
                since, numbers = k - begin[lane, f], faults.numbers[lane, f]
                value = step(kinds[lane, f], numbers, own, since, value)
        return value

    return cast(Callable[..., float], change)


@lru_cache
def spoiling() -> Callable[..., None]:
    """Return what puts wrong readings in the place of some of a lane's.

    It takes (k, lane, LaneFaults, entry of joints, rates and tips at which the values begin, values
    of the sensors, changed).
    """
    change = _changing()

    @called
    def spoil(k: int, lane: int, faults: LaneFaults, place: int, values: Vector) -> None:
        for i in range(values.size):
            values[i] = change(k, lane, faults, _READING, place + i, values[i])

    return cast(Callable[..., None], spoil)


def setting_in(rows: Rows, sizes: Sizes, heard: bool) -> Callable[..., None]:
    """Return what lets faults set in at a tick, and sensors read what is wrong.

    It takes (k, LaneFaults, w, number of lanes in use).

    Args:
        rows: of the group.
        sizes: of the group.
        heard: whether instruments read the tips, later in the tick.
    """
    if not sizes.broken:
        return _nothing_sets_in
    reading, begin, spoil = rows.reading, _remembering(rows), spoiling()
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


def _remembering(rows: Rows) -> Callable[..., None]:
    """Return what stores, for a fault that sets in, the demand on the drives or the effort."""
    asked, applied = rows.asked, rows.applied

    @compiled
    def begin(k: int, faults: LaneFaults, w: Vector, filled: int) -> None:
        where, begins, memory = faults.where, faults.begin, faults.memory
        firsts, lasts, sizes = faults.first, faults.last, faults.size
        for lane in range(filled):
            for f in range(where.shape[1]):
                if begins[lane, f] != k or where[lane, f] == _READING:
                    continue
                before = applied if where[lane, f] == _EFFORT else asked
                first, size = firsts[lane, f], sizes[lane, f]
                for i in range((lasts[lane, f] - first) * size):
                    memory[lane, f, i] = w[before + (first + i // size) * LANES + lane]

    return cast(Callable[..., None], begin)


def broken_demand(rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what holds the last demand on a drive where an answer is lost, and changes it.

    It takes (k, joint, LaneFaults, w, number of lanes in use).

    Args:
        rows: of the group.
        sizes: of the group.
    """
    if not sizes.broken:
        return _nothing_breaks
    asked, effort, change = rows.asked, rows.applied, _changing()

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
            for lane in range(filled):
                late = change(k, lane, faults, _LATE, i, w[effort + row + lane])
                w[effort + row + lane] = change(k, lane, faults, _DEMAND, i, late)

    return cast(Callable[..., None], ask)


def broken_motors(rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what changes the efforts that motors give.

    It takes (k, joint, LaneFaults, w, number of lanes in use).

    Args:
        rows: of the group.
        sizes: of the group.
    """
    if not sizes.broken:
        return _nothing_breaks
    effort, change = rows.applied, _changing()

    @compiled
    def give(k: int, i: int, faults: LaneFaults, w: Vector, filled: int) -> None:
        if faults.weak[k]:
            for at in range(effort + i * LANES, effort + i * LANES + filled):
                w[at] = change(k, at - effort - i * LANES, faults, _EFFORT, i, w[at])

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
