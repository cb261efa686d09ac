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
from flexslew_plant.events import (
    AnswerMissing,
    BrakeActivated,
    Event,
    Fact,
    FallbackActivated,
    FaultChanged,
    SwitchCompleted,
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
from flexslew_plant.refusal import Cause

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

    Args:
        trial: with switches and fallbacks.
        faults: of its schedule.
        estimate_loss: which controllers have no estimate when.
    """
    end = round(trial.duration / trial.period)
    switch_events = [(round(e.at / trial.period), e.switch) for e in trial.schedule if e.switch]
    pending = sorted((switch for switch in switch_events if switch[0] < end), key=lambda s: s[0])
    phases, facts, last, failure = [(0, trial.active)], list[Fact](), None, ""
    missing, failed = np.zeros(end, np.bool_), set[str]()  # silent since the last answer
    loss_faults = [t for t in faults if isinstance(t.fault, (*_LOSS_FAULTS, ControllerSilent))]
    lost = _lost([t for t in loss_faults if isinstance(t.fault, _LOSS_FAULTS)], trial.seed, end)
    never = np.zeros(end, np.bool_)
    while phases[-1][0] < end:
        first, name = phases[-1]
        until = pending[0][0] if pending else end
        no_answer = missing[first:until]
        no_answer[:] = (_lost_commands(lost, loss_faults, name) | estimate_loss.get(name, never))[
            first:until
        ]
        count = _in_a_row(no_answer, trial.max_missed) if loss_faults or estimate_loss else None
        if count is not None:
            failed = {name} | (failed if no_answer[:count].all() else set())
            without_estimate = {
                one for one, when in estimate_loss.items() if when[first + count - 1]
            }
            candidates = (
                candidate
                for candidate in trial.fallback
                if candidate not in failed | without_estimate
            )
            candidate = next(candidates, None)
            no_answer[count:] = False
            if candidate is None and pending:
                return Way.BRAKE
            if candidate is None:
                last = first + count - trial.max_missed
                not_ready = dict.fromkeys(without_estimate, str(NOT_FINITE))
                failure = brake_reason(BrakeActivated("", name, Cause.NO_ANSWER), not_ready)
                break
            facts.append(FallbackActivated(candidate, name, Cause.NO_ANSWER))
            phases.append((first + count, candidate))
            continue
        if not pending:
            break
        requested = [next_controller for tick, next_controller in pending if tick == until]
        pending, next_controller = (
            pending[len(requested) :],
            requested[-1],
        )  # the others never answer
        if set(requested) == {name}:
            continue
        if first == until:  # nor does the heir
            phases.pop()
        previous = phases[-1][1] if phases else next_controller
        if (
            next_controller in (name, previous)
            or _lost_commands(lost, loss_faults, next_controller)[until]
        ):
            return Way.SCHEDULE  # the one that goes on does so with a step
        if any(estimate_loss.get(one, never)[until - 1 : until + 1].any() for one in requested):
            return Way.SCHEDULE  # it is not ready, or gives no answer
        facts.append(SwitchCompleted(name, next_controller, 0.0))
        phases.append((until, next_controller))
    if missing.any():
        facts.append(AnswerMissing(ticks=int(missing.sum())))
    facts += [FaultChanged(True) for timed in faults if timed.start <= end]
    until = end if last is None else last
    return Charge(
        _segments(phases, estimate_loss, max(1, until)),
        missing if missing.any() else None,
        tuple(event_of(fact, 0, 0.0, 0, "") for fact in facts),
        frozenset(name for name, when in estimate_loss.items() if when[:until].any()),
        _restarts(estimate_loss, until),
        last,
        failure,
    )


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


def _lost(faults: Sequence[Timed], seed: int, ticks: int) -> NDArray[np.bool_]:
    """Return at which ticks an answer is lost, of any controller."""
    found = np.zeros(ticks, np.bool_)
    for timed in faults:
        found |= active_ticks(timed, seed, ticks)
    return found


def _lost_commands(
    lost: NDArray[np.bool_], faults: Sequence[Timed], controller: str
) -> NDArray[np.bool_]:
    """Return at which ticks an answer of a controller is lost."""
    found = lost.copy()
    for timed in faults:
        if isinstance(timed.fault, ControllerSilent) and timed.fault.controller == controller:
            found |= active_ticks(timed, 0, lost.size)
    return found


def _in_a_row(no_answer: NDArray[np.bool_], most: int) -> int | None:
    """Return how many ticks it takes until so many are missed in a row; None: they never are."""
    ticks = np.flatnonzero(no_answer)
    if ticks.size < most:
        return None
    ends = ticks[most - 1 :]
    whole = np.flatnonzero(ends - ticks[: ends.size] == most - 1)
    return int(ends[whole[0]]) + 1 if whole.size else None
