"""Which controller of a trial is active, and which answers are lost: both before the flight."""

from collections.abc import Sequence
from itertools import pairwise
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexslew_control.controllers.controller import NOT_FINITE
from flexslew_lab.studies.batch.groups.blindness import EstimateLoss
from flexslew_lab.studies.batch.groups.strikes import active_ticks
from flexslew_lab.studies.flight import brake_reason
from flexslew_lab.studies.ways import Way
from flexslew_lab.trial.trial import Trial
from flexslew_plant.bench.handover import Handover
from flexslew_plant.bench.records import SwitchRequest
from flexslew_plant.events import (
    AnswerMissing,
    Event,
    Fact,
    FallbackActivated,
    FaultChanged,
    SwitchCompleted,
    SwitchDropped,
    event_of,
)
from flexslew_plant.faults import Timed
from flexslew_plant.faults.commands import (
    CommandDuplicated,
    CommandLate,
    CommandLost,
    CommandReordered,
    ControllerSilent,
)
from flexslew_plant.hardware.drive import Drive
from flexslew_plant.refusal import Cause

_NO_EFFORT = np.zeros(1)  # of a handover without a testbed
_LOSS_FAULTS = (CommandLost, CommandLate, CommandReordered)  # what comes late counts as missed, too
# all faults of answers: a duplicate changes nothing
COMMAND_FAULTS: tuple[type[Any], ...] = (*_LOSS_FAULTS, ControllerSilent, CommandDuplicated)


class Charge(NamedTuple):
    """What the bench's handover does in a trial."""

    segments: tuple[tuple[int, str], ...]  # controllers, each with the tick from which on it leads
    missed: NDArray[np.bool_] | None  # ticks without an answer; None: there are none
    events: tuple[Event, ...]  # that metrics count
    without_estimate: frozenset[str] = (
        frozenset()
    )  # controllers that are without an estimate at times
    restarts: tuple[tuple[int, str], ...] = ()  # tick from which on one of them has one again
    last: int | None = None  # first tick without an answer until the brake; None: to the end
    failure: str = ""  # why the trial fails


def charge_of(
    trial: Trial, faults: Sequence[Timed] = (), estimate_loss: EstimateLoss = MappingProxyType({})
) -> Charge | Way:
    """Return which controller is active at which ticks; a way if only the bench can find it.

    The handover of the bench finds it, at those ticks at which something happens to it.

    Args:
        trial: with switches and fallbacks.
        faults: of its schedule.
        estimate_loss: which controllers have no estimate when.
    """
    end = round(trial.duration / trial.period)
    silent = _silent_ticks(trial, faults, estimate_loss, end)
    requests = [
        SwitchRequest(entry.switch, round(entry.at / trial.period))
        for entry in trial.schedule
        if entry.switch and round(entry.at / trial.period) < end
    ]
    phases, facts, missing = list[tuple[int, str]](), list[Fact](), np.zeros(end, np.bool_)
    drive = Drive(trial.active, trial.max_missed, _NO_EFFORT)
    handover = Handover(drive, trial.fallback, facts.append)
    handover.reset(requests)
    tick = 0
    while tick < end and drive.active:
        before, known = phases[-1][1] if phases else "", len(facts)
        _set_ready_status(handover, estimate_loss, max(tick - 1, 0))
        outgoing = drive.active
        handover.begin(tick)
        _set_ready_status(handover, estimate_loss, tick)
        active = drive.active
        missing[tick] = silent[active][tick]
        if any(map(_is_unready, facts[known:])) or (missing[tick] and active != outgoing):
            return Way.SCHEDULE  # it is not ready, or gives no answer
        if active != before:
            phases.append((tick, active))
        if missing[tick]:
            handover.count_missing_answer()
        else:
            handover.answered(_NO_EFFORT, _NO_EFFORT)
            drive.take(_NO_EFFORT)
        switched = any(isinstance(fact, SwitchCompleted) for fact in facts[known:])
        if switched and active in (outgoing, before or active):
            return Way.SCHEDULE  # the one that goes on does so with a step
        ahead = [request.tick for request in requests if request.tick > tick]
        ahead += [tick + 1] if missing[tick] else _first(silent[active], tick + 1)
        tick = min(ahead, default=end)
    if not drive.active and handover.waiting:
        return Way.BRAKE
    last = None if drive.active else int(np.flatnonzero(missing)[-1]) + 1 - trial.max_missed
    until = end if last is None else last
    counted: list[Fact] = [
        SwitchCompleted(fact.from_, fact.to, 0.0) if isinstance(fact, SwitchCompleted) else fact
        for fact in facts
        if isinstance(fact, SwitchCompleted | FallbackActivated)
    ]
    if missing.any():
        counted.append(AnswerMissing(ticks=int(missing.sum())))
    counted += [FaultChanged(True) for timed in faults if timed.start <= end]
    return Charge(
        _segments(phases, estimate_loss, max(1, until)),
        missing if missing.any() else None,
        tuple(event_of(fact, 0, 0.0, 0, "") for fact in counted),
        frozenset(name for name, when in estimate_loss.items() if when[:until].any()),
        _restarts(estimate_loss, until),
        last,
        brake_reason(facts),
    )


def _silent_ticks(
    trial: Trial, faults: Sequence[Timed], estimate_loss: EstimateLoss, ticks: int
) -> dict[str, NDArray[np.bool_]]:
    """Return at which ticks each controller of a trial gives no answer that arrives."""
    lost = np.zeros(ticks, np.bool_)
    for timed in faults:
        if isinstance(timed.fault, _LOSS_FAULTS):
            lost |= active_ticks(timed, trial.seed, ticks)
    silent = {name: lost | estimate_loss.get(name, lost) for name in trial.controllers}
    for timed in faults:
        if isinstance(timed.fault, ControllerSilent) and timed.fault.controller in silent:
            silent[timed.fault.controller] |= active_ticks(timed, 0, ticks)
    return silent


def _set_ready_status(handover: Handover, estimate_loss: EstimateLoss, tick: int) -> None:
    """Report to a handover which controllers have an estimate at a tick."""
    for name, when in estimate_loss.items():
        handover.set_ready_status(name, NOT_FINITE if when[tick] else None)


def _is_unready(fact: Fact) -> bool:
    """Return whether a switch did not take place because its controller had no estimate."""
    return isinstance(fact, SwitchDropped) and fact.cause is Cause.NOT_READY


def _first(when: NDArray[np.bool_], start: int) -> list[int]:
    """Return the first tick from `start` on at which something is so; empty: none."""
    return [start + int(tick) for tick in np.flatnonzero(when[start:])[:1]]


def _segments(
    phases: Sequence[tuple[int, str]], estimate_loss: EstimateLoss, end: int
) -> tuple[tuple[int, str], ...]:
    """Return which controller computes efforts from which tick, also after a missing estimate."""
    segments = list[tuple[int, str]]()
    for (first, name), (until, _) in pairwise([*phases, (end, "")]):
        has_estimate = np.ones(max(0, min(until, end) - first), np.bool_)
        if name in estimate_loss:
            has_estimate = ~estimate_loss[name][first : first + has_estimate.size]
        starts = np.flatnonzero(has_estimate & ~np.concatenate(([False], has_estimate[:-1])))
        segments += [(first + int(tick), name) for tick in starts]
    return tuple(segments) if segments and segments[0][0] == 0 else (phases[0], *segments)


def _restarts(estimate_loss: EstimateLoss, end: int) -> tuple[tuple[int, str], ...]:
    """Return at which ticks a controller has an estimate again."""
    found = [
        (int(tick) + 1, name)
        for name, when in estimate_loss.items()
        for tick in np.flatnonzero(when[:end][:-1] & ~when[:end][1:])
    ]
    return tuple(sorted(found))
