"""Faults at work in a batch: at sensors, between law and motors, and on what the motors give.

Member after member, by the steps of the bench, in the order in which they begin, as
faults.injection does it for one run.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from flexslew_lab.studies.batch.groups.batch_trial import BatchTrial
from flexslew_lab.studies.batch.groups.charge import COMMAND_FAULTS
from flexslew_lab.studies.batch.groups.rows import Rows, Sizes
from flexslew_lab.studies.batch.groups.strikes import active_ticks
from flexslew_plant.arrays import Indices, Tensor, Vector, called, compiled
from flexslew_plant.faults import Fault, Timed
from flexslew_plant.faults.dispatch import any_step, number_of
from flexslew_plant.faults.effects import Names
from flexslew_plant.faults.steps import FaultAction, Where
from flexslew_plant.hardware.sensors import Readings
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH, member_rows, skip

Flags: TypeAlias = NDArray[np.bool_]
_READING, _LATE, _DEMAND, _EFFORT = (int(where) for where in Where)
_CHANNELS = Readings._fields[:3]  # that a law may read


def is_supported(fault: Fault) -> bool:
    """Return whether batches fly a fault: those with a step, and the shipped ones of answers."""
    return number_of(fault) is not None or type(fault) in COMMAND_FAULTS


class BatchFaults(NamedTuple):
    """The faults of a group; one that never begins stands where a member has fewer than others."""

    starts: Flags  # whether one sets in in any member, (ticks,), as the three below
    reading_faults: Flags  # sensors are
    weak: Flags  # motors, or what reaches them
    answer_lost: Flags  # an answer is lost
    missed: Flags  # answers that are lost, (ticks, members)
    kind: Indices  # number of its step, (members, faults), as all below
    where: Indices  # it acts
    begin: Indices  # first tick
    end: Indices  # first tick after it
    first: Indices  # entry on which it acts: of joints, rates and tips, or of the efforts
    last: Indices  # first one on which it does not act
    size: Indices  # of its memory, for each entry
    numbers: Tensor  # of its step, (members, faults, numbers)
    is_active: Flags  # whether it acts, (members, faults, ticks)
    memory: Tensor  # of its entries, one after another, (members, faults, numbers)


class _Fault(NamedTuple):
    """A fault of one member."""

    timed: Timed
    kind: int
    action: FaultAction
    place: int  # of the action's channel among joints, rates and tips

    @property
    def size(self) -> int:
        """Numbers of its memory."""
        return (self.action.last - self.action.first) * self.action.memory


def faults_of(members: Sequence[BatchTrial], ticks: int) -> BatchFaults | None:
    """Return the faults of a group; None: there are none that change a motion."""
    if not any(
        member.happens.faults or member.happens.charge.missed is not None for member in members
    ):
        return None
    each = [_faults(member) for member in members]
    lost = np.zeros((ticks, len(members)), np.bool_)
    for k, member in enumerate(members):
        if member.happens.charge.missed is not None:
            lost[:, k] = member.happens.charge.missed
    most = max(map(len, each))
    if not (most or lost.any()):
        return None
    starts, reading_faults, weak = (np.zeros(ticks, np.bool_) for _ in range(3))
    shape, known = (len(members), most), [fault for faults in each for fault in faults]
    kind, where, begin, end, first, last, size = (np.zeros(shape, np.int64) for _ in range(7))
    numbers = np.zeros((*shape, max((len(fault.action.numbers) for fault in known), default=0)))
    is_active = np.zeros((*shape, ticks), np.bool_)
    for k, (member, faults) in enumerate(zip(members, each, strict=True)):
        for f, fault in enumerate(faults):
            action, at = fault.action, (k, f)
            start, stop = fault.timed.start, int(min(fault.timed.end, ticks))
            kind[at], where[at], size[at] = fault.kind, action.where, action.memory
            begin[at], end[at] = start, stop
            first[at], last[at] = fault.place + action.first, fault.place + action.last
            numbers[at][: len(action.numbers)] = action.numbers
            is_active[at] = active_ticks(fault.timed, member.trial.seed, ticks)
            starts[start : start + 1] = True
            (reading_faults if action.where is Where.READING else weak)[start:stop] = True
    by_tick = starts, reading_faults, weak, np.array(lost.any(axis=1)), lost
    memory = np.zeros((*shape, max((fault.size for fault in known), default=0)))
    each_fault = kind, where, begin, end, first, last, size
    return BatchFaults(*by_tick, *each_fault, numbers, is_active, memory)


def _faults(member: BatchTrial) -> list[_Fault]:
    """Return what changes readings or efforts, in the order in which it sets in."""
    model = member.model
    names = Names(model.joint_names, model.appendages.names, ())
    found = [_fault(timed, names) for timed in member.happens.faults]
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
def _value_after_faults() -> Callable[..., float]:
    """Return what gives the value of an entry after all faults of a member.

    It takes (k, member, BatchFaults, where they act, entry, value).
    """
    step = any_step()

    @called
    def change(k: int, member: int, faults: BatchFaults, where: int, i: int, value: float) -> float:
        kinds, begin, end, is_active = faults.kind, faults.begin, faults.end, faults.is_active
        first_entries, last_entries, sizes = faults.first, faults.last, faults.size
        count = kinds.shape[1]
        for n in range(count):
            f = count - 1 - n if where == _LATE else n  # of two delays the later one to set in
            first, size = first_entries[member, f], sizes[member, f]
            matched = faults.where[member, f] == where and first <= i < last_entries[member, f]
            if matched and begin[member, f] <= k < end[member, f] and is_active[member, f, k]:
                fault_memory = faults.memory[member, f, (i - first) * size : (i - first + 1) * size]
                since, numbers = k - begin[member, f], faults.numbers[member, f]
                value = step(kinds[member, f], numbers, fault_memory, since, value)
        return value

    return cast(Callable[..., float], change)


@lru_cache
def reading_step() -> Callable[..., None]:
    """Return what puts wrong readings in the place of some of a member's.

    It takes (k, member, BatchFaults, entry of joints, rates and tips at which the values begin,
    values of the sensors, changed).
    """
    change = _value_after_faults()

    @called
    def apply_faults(k: int, member: int, faults: BatchFaults, place: int, values: Vector) -> None:
        for i in range(values.size):
            values[i] = change(k, member, faults, _READING, place + i, values[i])

    return cast(Callable[..., None], apply_faults)


def setting_in(rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what lets faults set in at a tick, and sensors read what is wrong.

    It takes (k, BatchFaults, w, number of members in use).

    Args:
        rows: of the group.
        sizes: of the group; instruments read the tips later in the tick.
    """
    if not sizes.has_faults:
        return skip
    reading, begin, apply_faults = rows.reading, _store_initial(rows), reading_step()
    count = 2 * sizes.joints if sizes.has_instruments else sizes.outputs

    @compiled
    def set_in(k: int, faults: BatchFaults, w: Vector, filled: int) -> None:
        if faults.starts[k]:
            begin(k, faults, w, filled)
        if not faults.reading_faults[k]:
            return
        for member in range(filled):
            apply_faults(k, member, faults, 0, member_rows(w, reading, count, member))

    return cast(Callable[..., None], set_in)


def _store_initial(rows: Rows) -> Callable[..., None]:
    """Return what stores, for a fault that sets in, the demand on the drives or the effort."""
    requested, applied = rows.request, rows.applied

    @compiled
    def begin(k: int, faults: BatchFaults, w: Vector, filled: int) -> None:
        where, starts, memory = faults.where, faults.begin, faults.memory
        first_entries, last_entries, sizes = faults.first, faults.last, faults.size
        for member in range(filled):
            for f in range(where.shape[1]):
                if starts[member, f] != k or where[member, f] == _READING:
                    continue
                before = applied if where[member, f] == _EFFORT else requested
                first, size = first_entries[member, f], sizes[member, f]
                for i in range((last_entries[member, f] - first) * size):
                    memory[member, f, i] = w[before + (first + i // size) * BATCH_WIDTH + member]

    return cast(Callable[..., None], begin)


def effort_faults(rows: Rows, sizes: Sizes) -> tuple[Callable[..., None], Callable[..., None]]:
    """Return what faults make of the demand on a drive, and of the effort that its motor gives.

    Where an answer is lost the last demand holds. Both take (k, joint, BatchFaults, w, number of
    members in use).

    Args:
        rows: of the group.
        sizes: of the group.
    """
    if not sizes.has_faults:
        return skip, skip
    requested, effort, change = rows.request, rows.applied, _value_after_faults()

    @compiled
    def change_request(k: int, i: int, faults: BatchFaults, w: Vector, filled: int) -> None:
        row = i * BATCH_WIDTH
        if faults.answer_lost[k]:
            lost = faults.missed
            for member in range(filled):
                if lost[k, member]:
                    w[effort + row + member] = w[requested + row + member]
        for member in range(BATCH_WIDTH):
            w[requested + row + member] = w[effort + row + member]
        if faults.weak[k]:
            for member in range(filled):
                late = change(k, member, faults, _LATE, i, w[effort + row + member])
                w[effort + row + member] = change(k, member, faults, _DEMAND, i, late)

    @compiled
    def change_effort(k: int, i: int, faults: BatchFaults, w: Vector, filled: int) -> None:
        if faults.weak[k]:
            for at in range(effort + i * BATCH_WIDTH, effort + i * BATCH_WIDTH + filled):
                w[at] = change(k, at - effort - i * BATCH_WIDTH, faults, _EFFORT, i, w[at])

    return cast(Callable[..., None], change_request), cast(Callable[..., None], change_effort)
