"""Who is in charge of a trial, and which answers are lost: it is known before the flight."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexslew_lab.studies.lanes.groups.strikes import struck
from flexslew_lab.studies.ways import Way
from flexslew_lab.trial.trial import Trial
from flexslew_plant.events import (
    AnswerMissed,
    Event,
    Fact,
    FallbackTookOver,
    FaultChanged,
    Switched,
    event_of,
)
from flexslew_plant.faults import Timed
from flexslew_plant.faults.commands import (
    CommandLate,
    CommandLost,
    CommandReordered,
    ControllerSilent,
)
from flexslew_plant.refusal import Cause

_LOSING = (CommandLost, CommandLate, CommandReordered)  # what comes late counts as missed, too


class Charge(NamedTuple):
    """What the bench's handover does in a trial."""

    legs: tuple[tuple[int, str], ...]  # controllers, each with the tick from which on it leads
    missed: NDArray[np.bool_] | None  # ticks without an answer; None: there are none
    events: tuple[Event, ...]  # that metrics count


def charge_of(trial: Trial, faults: Sequence[Timed] = ()) -> Charge | Way:
    """Return who is in charge of a trial when; a way where only the bench can tell.

    Args:
        trial: with switches and fallbacks.
        faults: of its schedule.
    """
    end = round(trial.duration / trial.period)
    switches = [(round(e.at / trial.period), e.switch) for e in trial.schedule if e.switch]
    due = sorted((switch for switch in switches if switch[0] < end), key=lambda s: s[0])
    legs, facts = [(0, trial.active)], list[Fact]()
    missed, fallen = np.zeros(end, np.bool_), set[str]()  # silent since the last answer
    losing = [t for t in faults if isinstance(t.fault, (*_LOSING, ControllerSilent))]
    lost = _lost([t for t in losing if isinstance(t.fault, _LOSING)], trial.seed, end)
    while legs[-1][0] < end:
        first, name = legs[-1]
        until = due[0][0] if due else end
        silent = missed[first:until]
        silent[:] = _silenced(lost, losing, name)[first:until]
        count = _in_a_row(silent, trial.max_missed) if losing else None
        if count is not None:
            fallen = {name} | (fallen if silent[:count].all() else set())
            heir = next((heir for heir in trial.fallback if heir not in fallen), None)
            if heir is None:
                return Way.BRAKE
            silent[count:] = False
            facts.append(FallbackTookOver(heir, name, Cause.NO_ANSWER))
            legs.append((first + count, heir))
            continue
        if not due:
            break
        newcomers = [newcomer for tick, newcomer in due if tick == until]
        due, newcomer = due[len(newcomers) :], newcomers[-1]  # the others never answer
        if set(newcomers) == {name}:
            continue
        if first == until:  # nor does the heir
            legs.pop()
        led = legs[-1][1] if legs else newcomer
        if newcomer in (name, led) or _silenced(lost, losing, newcomer)[until]:
            return Way.SCHEDULE  # who goes on does so with a step
        facts.append(Switched(name, newcomer, 0.0))
        legs.append((until, newcomer))
    if missed.any():
        facts.append(AnswerMissed(ticks=int(missed.sum())))
    facts += [FaultChanged(True) for timed in faults if timed.start <= end]
    return Charge(
        tuple(leg for leg in legs if leg[0] < end),
        missed if missed.any() else None,
        tuple(event_of(fact, 0, 0.0, 0, "") for fact in facts),
    )


def _lost(faults: Sequence[Timed], seed: int, ticks: int) -> NDArray[np.bool_]:
    """Return at which ticks an answer is lost, whoever gives it."""
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
