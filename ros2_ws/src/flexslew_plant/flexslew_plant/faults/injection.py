"""The faults at work: between drive and motors, sensors and question, answer and drive."""

from collections import deque
from enum import Enum
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.bench.measurement import EffortCommand
from flexslew_plant.bench.sensors import Readings
from flexslew_plant.faults.kinds import (
    ActuatorGain,
    ActuatorStuck,
    CommandDelay,
    CommandDuplicated,
    CommandLate,
    CommandLost,
    CommandReordered,
    ControllerSilent,
    Names,
    SensorBias,
    SensorDropout,
    SensorFault,
    SensorFreeze,
    Timed,
)


class Fate(Enum):
    """What becomes of an answer on its way to the drive."""

    ARRIVES = "arrives"
    LOST = "lost"
    LATE = "late"
    OVERTAKEN = "overtaken"


class Switched(NamedTuple):
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
        self._acting: list[Timed] = []
        self._frozen: dict[int, Vector] = {}  # by the identity of an acting fault
        self._delayed: dict[int, deque[Vector]] = {}
        self._ends: dict[int, int] = {}  # set by an operator, by the identity of a fault
        self._late: list[_Delayed] = []
        self._last_demand: Vector = np.zeros(len(names.joints))
        self._last_effort: Vector = np.zeros(len(names.joints))
        self._tick = 0

    def add(self, timed: Timed) -> None:
        """Let one more fault act at its time."""
        self._waiting.append(timed)

    def end(self, timed: Timed, tick: int) -> None:
        """Let a fault end at this tick, or never begin."""
        self._ends[id(timed)] = tick
        self._waiting = [other for other in self._waiting if other is not timed]

    def begin(self, tick: int) -> list[Switched]:
        """Start a tick; return what sets in and what ends with it."""
        self._tick = tick
        if not self._acting and not self._waiting:
            return []
        ended = [t for t in self._acting if tick >= min(t.end, self._ends.get(id(t), t.end))]
        begun = [timed for timed in self._waiting if tick >= timed.start]
        if ended or begun:
            over = set(map(id, ended))
            self._acting = [t for t in self._acting if id(t) not in over] + begun
            self._waiting = [t for t in self._waiting if tick < t.start]
            for timed in ended:
                self._frozen.pop(id(timed), None)
                self._delayed.pop(id(timed), None)
        return [Switched(t, False) for t in ended] + [Switched(t, True) for t in begun]

    def read(self, readings: Readings) -> Readings:
        """Return what the question says instead of what the sensors read."""
        for timed in self._acting:
            if isinstance(timed.fault, SensorFault):
                channel = timed.fault.channel
                wrong = self._wrong(timed, getattr(readings, channel))
                readings = readings._replace(**{channel: wrong})
        return readings

    def fate(self, command: EffortCommand) -> Fate:
        """Return what becomes of the answer of this tick; what reaches the drive later is kept."""
        for timed in self._acting:
            match timed.fault:
                case ControllerSilent(controller=name) if name == command.controller:
                    return Fate.LOST
                case CommandLost() if self._happens(timed):
                    return Fate.LOST
                case CommandLate(ticks=ticks) if self._happens(timed):
                    self._late.append(_Delayed(self._tick + ticks, True, command))
                    return Fate.LATE
                case CommandReordered() if self._happens(timed):
                    self._late.append(_Delayed(self._tick + 1, False, command))
                    return Fate.OVERTAKEN
                case CommandDuplicated() if self._happens(timed):
                    self._late.append(_Delayed(self._tick + 1, True, command))
        return Fate.ARRIVES

    def old_answers(self, first: bool) -> list[EffortCommand]:
        """Return the old answers that reach the drive at this tick.

        Args:
            first: those before the tick's own answer, else those behind it.
        """
        if not self._late:
            return []
        due = [g for g in self._late if g.tick <= self._tick and g.first is first]
        self._late = [g for g in self._late if g not in due]
        return [old.command for old in due]

    def demand(self, demand: Vector) -> Vector:
        """Return what reaches the motors instead of what the drive asks for."""
        before, self._last_demand = self._last_demand, demand
        for timed in self._acting:
            match timed.fault:
                case CommandDelay(ticks=ticks):
                    queue = self._delayed.setdefault(id(timed), deque([before] * ticks))
                    queue.append(demand)
                    demand = queue.popleft()
                case ActuatorGain(joint=joint, gain=gain):
                    share = np.ones(len(demand))
                    share[self._names.joints.index(joint)] = gain
                    demand = demand * share
        return demand

    def effort(self, effort: Vector) -> Vector:
        """Return what the motors give instead of what they would."""
        for timed in self._acting:
            match timed.fault:
                case ActuatorStuck(joint=joint, effort=stuck):
                    k = self._names.joints.index(joint)
                    effort = effort.copy()
                    effort[k] = self._last_effort[k] if stuck is None else stuck
        self._last_effort = effort
        return effort

    def _wrong(self, timed: Timed, reading: Vector) -> Vector:
        fault: Any = timed.fault
        chosen = slice(None)
        if fault.of is not None:
            k = self._names.of(fault.channel).index(fault.of)
            chosen = slice(k, k + 1)
        wrong = reading.copy()
        match fault:
            case SensorBias(bias=bias):
                wrong[chosen] += bias
            case SensorFreeze():
                wrong[chosen] = self._frozen.setdefault(id(timed), reading)[chosen]
            case SensorDropout():
                if self._happens(timed):
                    wrong[chosen] = 0.0
            case _:
                wrong[chosen] = np.nan
        return wrong

    def _happens(self, timed: Timed) -> bool:
        """Return whether chance strikes at this tick."""
        fault: Any = timed.fault
        key = (self._seed, self._epoch, timed.start, crc32(fault.kind.encode()), fault.seed)
        draw = np.random.default_rng((*key, self._tick)).random()
        return bool(draw < fault.probability)
