"""Which controller of a trial is active, and which answers are lost: both before the flight."""

from collections.abc import Sequence
from itertools import pairwise
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexslew_control.controllers.controller import NOT_FINITE
from flexslew_lab.studies.flight import braked
from flexslew_lab.studies.lanes.groups.blindness import Blindness
from flexslew_lab.studies.lanes.groups.strikes import struck
from flexslew_lab.studies.ways import Way
from flexslew_lab.trial.trial import Trial
from flexslew_plant.events import (
    AnswerMissed,
    BrakeTookOver,
    Event,
    Fact,
    FallbackTookOver,
    FaultChanged,
    Switched,
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

_LOSING = (CommandLost, CommandLate, CommandReordered)  # what comes late counts as missed, too
# all faults of answers: a duplicate changes nothing
OF_ANSWERS: tuple[type[Any], ...] = (*_LOSING, ControllerSilent, CommandDuplicated)


class Charge(NamedTuple):
    """What the bench's handover does in a trial."""

    legs: tuple[tuple[int, str], ...]  # controllers, each with the tick from which on it leads
    missed: NDArray[np.bool_] | None  # ticks without an answer; None: there are none
    events: tuple[Event, ...]  # that metrics count
    blinded: frozenset[str] = frozenset()  # controllers that are without an estimate at times
    restarts: tuple[tuple[int, str], ...] = ()  # tick from which on one of them has one again
    last: int | None = None  # first tick without an answer until the brake; None: to the end
    failure: str = ""  # why the trial fails


def charge_of(
    trial: Trial, faults: Sequence[Timed] = (), blind: Blindness = MappingProxyType({})
) -> Charge | Way:
    """Return which controller is active at which ticks; a way if only the bench can find it.

    Args:
        trial: with switches and fallbacks.
        faults: of its schedule.
        blind: which controllers have no estimate when.
    """
    end = round(trial.duration / trial.period)
    switches = [(round(e.at / trial.period), e.switch) for e in trial.schedule if e.switch]
    due = sorted((switch for switch in switches if switch[0] < end), key=lambda s: s[0])
    turns, facts, last, failure = [(0, trial.active)], list[Fact](), None, ""
    missed, fallen = np.zeros(end, np.bool_), set[str]()  # silent since the last answer
    losing = [t for t in faults if isinstance(t.fault, (*_LOSING, ControllerSilent))]
    lost = _lost([t for t in losing if isinstance(t.fault, _LOSING)], trial.seed, end)
    never = np.zeros(end, np.bool_)
    while turns[-1][0] < end:
        first, name = turns[-1]
        until = due[0][0] if due else end
        silent = missed[first:until]
        silent[:] = (_silenced(lost, losing, name) | blind.get(name, never))[first:until]
        count = _in_a_row(silent, trial.max_missed) if losing or blind else None
        if count is not None:
            fallen = {name} | (fallen if silent[:count].all() else set())
            blinded = {one for one, when in blind.items() if when[first + count - 1]}
            heirs = (heir for heir in trial.fallback if heir not in fallen | blinded)
            heir = next(heirs, None)
            silent[count:] = False
            if heir is None and due:
                return Way.BRAKE
            if heir is None:
                last = first + count - trial.max_missed
                unready = dict.fromkeys(blinded, str(NOT_FINITE))
                failure = braked(BrakeTookOver("", name, Cause.NO_ANSWER), unready)
                break
            facts.append(FallbackTookOver(heir, name, Cause.NO_ANSWER))
            turns.append((first + count, heir))
            continue
        if not due:
            break
        newcomers = [newcomer for tick, newcomer in due if tick == until]
        due, newcomer = due[len(newcomers) :], newcomers[-1]  # the others never answer
        if set(newcomers) == {name}:
            continue
        if first == until:  # nor does the heir
            turns.pop()
        led = turns[-1][1] if turns else newcomer
        if newcomer in (name, led) or _silenced(lost, losing, newcomer)[until]:
            return Way.SCHEDULE  # the one that goes on does so with a step
        if any(blind.get(one, never)[until - 1 : until + 1].any() for one in newcomers):
            return Way.SCHEDULE  # it is not ready, or gives no answer
        facts.append(Switched(name, newcomer, 0.0))
        turns.append((until, newcomer))
    if missed.any():
        facts.append(AnswerMissed(ticks=int(missed.sum())))
    facts += [FaultChanged(True) for timed in faults if timed.start <= end]
    until = end if last is None else last
    return Charge(
        _legs(turns, blind, max(1, until)),
        missed if missed.any() else None,
        tuple(event_of(fact, 0, 0.0, 0, "") for fact in facts),
        frozenset(name for name, when in blind.items() if when[:until].any()),
        _restarts(blind, until),
        last,
        failure,
    )


def _legs(
    turns: Sequence[tuple[int, str]], blind: Blindness, end: int
) -> tuple[tuple[int, str], ...]:
    """Return which controller computes efforts from which tick, also after a missing estimate."""
    legs = list[tuple[int, str]]()
    for (first, name), (until, _) in pairwise([*turns, (end, "")]):
        sees = np.ones(max(0, min(until, end) - first), np.bool_)
        if name in blind:
            sees = ~blind[name][first : first + sees.size]
        begins = np.flatnonzero(sees & ~np.concatenate(([False], sees[:-1])))
        legs += [(first + int(tick), name) for tick in begins]
    return tuple(legs) if legs and legs[0][0] == 0 else (turns[0], *legs)


def _restarts(blind: Blindness, end: int) -> tuple[tuple[int, str], ...]:
    """Return at which ticks a controller has an estimate again."""
    found = [
        (int(tick) + 1, name)
        for name, when in blind.items()
        for tick in np.flatnonzero(when[:end][:-1] & ~when[:end][1:])
    ]
    return tuple(sorted(found))


def _lost(faults: Sequence[Timed], seed: int, ticks: int) -> NDArray[np.bool_]:
    """Return at which ticks an answer is lost, of any controller."""
    found = np.zeros(ticks, np.bool_)
    for timed in faults:
        found |= struck(timed, seed, ticks)
    return found


def _silenced(
    lost: NDArray[np.bool_], faults: Sequence[Timed], controller: str
) -> NDArray[np.bool_]:
    """Return at which ticks an answer of a controller is lost."""
    found = lost.copy()
    for timed in faults:
        if isinstance(timed.fault, ControllerSilent) and timed.fault.controller == controller:
            found |= struck(timed, 0, lost.size)
    return found


def _in_a_row(silent: NDArray[np.bool_], most: int) -> int | None:
    """Return how many ticks it takes until so many are missed in a row; None: they never are."""
    ticks = np.flatnonzero(silent)
    if ticks.size < most:
        return None
    ends = ticks[most - 1 :]
    whole = np.flatnonzero(ends - ticks[: ends.size] == most - 1)
    return int(ends[whole[0]]) + 1 if whole.size else None
