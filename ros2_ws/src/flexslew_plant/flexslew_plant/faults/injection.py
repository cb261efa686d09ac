"""The faults at work: between drive and motors, sensors and question, answer and drive."""

from functools import partial
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.faults import Timed
from flexslew_plant.faults.effects import Effect, Fate, FaultContext, Names
from flexslew_plant.hardware.sensors import Readings
from flexslew_plant.measurement import EffortCommand


class SwitchedEffect(NamedTuple):
    """A fault set in or ended at this tick."""

    timed: Timed
    on: bool


class _Delayed(NamedTuple):
    tick: int  # at which it reaches the drive
    first: bool  # before the answer of that tick
    command: EffortCommand


class Faults:
    """Breaks what passes through it while a fault acts.

    What happens by chance is drawn for each tick from the trial's seed, the epoch, the fault's
    first tick, kind and own seed, so it does not depend on what else has been drawn.

    Args:
        names: joints and appendages of the testbed.
        seed: of the trial.
        epoch: counts resets.
        timed: the faults of the schedule.
    """

    def __init__(self, names: Names, seed: int, epoch: int, timed: tuple[Timed, ...]) -> None:
        self._names, self._seed, self._epoch = names, seed, epoch
        self._waiting = list(timed)
        self._acting: list[tuple[Timed, Effect]] = []
        self._ends: dict[int, int] = {}  # set by an operator, by the identity of a fault
        self._late: list[_Delayed] = []
        self._tick = 0
        self._last_demand: Vector = np.zeros(len(names.joints))
        self._last_effort: Vector = np.zeros(len(names.joints))

    def add(self, timed: Timed) -> None:
        """Let one more fault act at its time."""
        self._waiting.append(timed)

    def end(self, timed: Timed, tick: int) -> None:
        """Let a fault end at this tick, or never begin."""
        self._ends[id(timed)] = tick
        self._waiting = [other for other in self._waiting if other is not timed]

    def begin(self, tick: int) -> list[SwitchedEffect]:
        """Start a tick; return what sets in and what ends with it."""
        self._tick = tick
        if not self._acting and not self._waiting:
            return []
        ended = [t for t, _ in self._acting if tick >= min(t.end, self._ends.get(id(t), t.end))]
        begun = [timed for timed in self._waiting if tick >= timed.start]
        if ended or begun:
            over = set(map(id, ended))
            self._acting = [(t, effect) for t, effect in self._acting if id(t) not in over]
            self._acting += [(t, t.fault.begin(self._context(t))) for t in begun]
            self._waiting = [t for t in self._waiting if tick < t.start]
        return [SwitchedEffect(t, False) for t in ended] + [SwitchedEffect(t, True) for t in begun]

    def read(self, readings: Readings) -> Readings:
        """Return what the question says instead of what the sensors read."""
        for _, effect in self._acting:
            if effect.read is not None:
                readings = effect.read(readings)
        return readings

    def fate(self, command: EffortCommand) -> Fate:
        """Return what becomes of the answer of this tick; what reaches the drive later is kept."""
        for _, effect in self._acting:
            fate = Fate.ARRIVES if effect.fate is None else effect.fate(command)
            if fate is not Fate.ARRIVES:
                return fate
        return Fate.ARRIVES

    def old_answers(self, first: bool) -> list[EffortCommand]:
        """Return the old answers that reach the drive at this tick.

        Args:
            first: those before the tick's own answer, else those after it.
        """
        if not self._late:
            return []
        due = [g for g in self._late if g.tick <= self._tick and g.first is first]
        self._late = [g for g in self._late if g not in due]
        return [old.command for old in due]

    def demand(self, demand: Vector) -> Vector:
        """Return what reaches the motors instead of what the drive asks for."""
        self._last_demand = demand
        for _, effect in self._acting:
            if effect.demand is not None:
                demand = effect.demand(demand)
        return demand

    def effort(self, effort: Vector) -> Vector:
        """Return what the motors give instead of what they would."""
        for _, effect in self._acting:
            if effect.effort is not None:
                effort = effect.effort(effort)
        self._last_effort = effort
        return effort

    def _context(self, timed: Timed) -> FaultContext:
        """Return what a fault sees of the bench when it sets in."""
        return FaultContext(
            self._names,
            partial(self._happens, timed),
            self._deliver_later,
            self._last_demand,
            self._last_effort,
        )

    def _deliver_later(self, command: EffortCommand, ticks: int, first: bool) -> None:
        self._late.append(_Delayed(self._tick + ticks, first, command))

    def _happens(self, timed: Timed, probability: float) -> bool:
        """Return whether chance strikes at this tick."""
        fault: Any = timed.fault
        key = (self._seed, self._epoch, timed.start, crc32(fault.kind.encode()), fault.seed)
        draw = np.random.default_rng((*key, self._tick)).random()
        return bool(draw < probability)
