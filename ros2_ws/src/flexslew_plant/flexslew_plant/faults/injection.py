"""The faults at work: between drive and motors, sensors and question, answer and drive."""

from functools import partial
from typing import Any, NamedTuple

from flexslew_plant.arrays import Vector
from flexslew_plant.faults import Timed
from flexslew_plant.faults.chance import key_of, random_number
from flexslew_plant.faults.dispatch import effect_of
from flexslew_plant.faults.effects import CommandStatus, Effect, FaultContext, Names
from flexslew_plant.hardware.sensors import Readings
from flexslew_plant.measurement import EffortCommand


class FaultChange(NamedTuple):
    """A fault set in or ended at this tick."""

    timed: Timed
    on: bool


class LateCommand(NamedTuple):
    """An answer on its way to the drive."""

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

    Attributes:
        waiting: those that have not started.
        at_work: some act: then, and only then, `fate`, `demand`, `effort` and `read` change what
            passes through them.
        late: the answers that are still to reach the drive, see late_commands.
    """

    def __init__(self, names: Names, seed: int, epoch: int, timed: tuple[Timed, ...]) -> None:
        self._names, self._seed, self._epoch = names, seed, epoch
        self.waiting = list(timed)
        self.at_work = False
        self.late: list[LateCommand] = []
        self._active: list[tuple[Timed, Effect]] = []
        self._ends: dict[int, int] = {}  # set by an operator, by the identity of a fault
        self._tick = 0

    def add(self, timed: Timed) -> None:
        """Let one more fault act at its time."""
        self.waiting.append(timed)

    def end(self, timed: Timed, tick: int) -> None:
        """Let a fault end at this tick, or never begin."""
        self._ends[id(timed)] = tick
        self.waiting = [other for other in self.waiting if other is not timed]

    def begin(self, tick: int, demand: Vector, effort: Vector) -> list[FaultChange]:
        """Start a tick; return what sets in and what ends with it.

        Args:
            tick: of the bench.
            demand: last demand on the motors, shape (joints,) [N m or N].
            effort: that they gave during the last tick, shape (joints,) [N m or N].
        """
        self._tick = tick
        finished = [t for t, _ in self._active if tick >= min(t.end, self._ends.get(id(t), t.end))]
        started = [timed for timed in self.waiting if tick >= timed.start]
        if finished or started:
            over = set(map(id, finished))
            self._active = [(t, effect) for t, effect in self._active if id(t) not in over]
            self._active += [
                (t, effect_of(t.fault, self._context(t, demand, effort))) for t in started
            ]
            self.at_work = bool(self._active)
            self.waiting = [t for t in self.waiting if tick < t.start]
        return [FaultChange(t, False) for t in finished] + [FaultChange(t, True) for t in started]

    def read(self, readings: Readings) -> Readings:
        """Return the readings of the measurement for those of the sensors."""
        for _, effect in self._active:
            if effect.read is not None:
                readings = effect.read(readings)
        return readings

    def command_status(self, command: EffortCommand) -> CommandStatus:
        """Return what becomes of the answer of this tick; what reaches the drive later is kept."""
        for _, effect in self._active:
            command_status = (
                CommandStatus.ON_TIME
                if effect.command_status is None
                else effect.command_status(command)
            )
            if command_status is not CommandStatus.ON_TIME:
                return command_status
        return CommandStatus.ON_TIME

    def late_commands(self, first: bool) -> list[EffortCommand]:
        """Return the old answers that reach the drive at this tick.

        Args:
            first: those before the tick's own answer, else those after it.
        """
        ready = [g for g in self.late if g.tick <= self._tick and g.first is first]
        self.late = [g for g in self.late if g not in ready]
        return [old.command for old in ready]

    def demand(self, demand: Vector) -> Vector:
        """Return the demand that reaches the motors for the demand of the drive.

        What is late arrives before a motor makes less of it. Of two delays the later one to set in
        comes first: what it begins with is what the drive let go last.
        """
        for _, effect in reversed(self._active):
            if effect.late is not None:
                demand = effect.late(demand)
        for _, effect in self._active:
            if effect.demand is not None:
                demand = effect.demand(demand)
        return demand

    def effort(self, effort: Vector) -> Vector:
        """Return what the motors give instead of what they would."""
        for _, effect in self._active:
            if effect.effort is not None:
                effort = effect.effort(effort)
        return effort

    def _context(self, timed: Timed, demand: Vector, effort: Vector) -> FaultContext:
        """Return what a fault sees of the bench when it sets in."""
        return FaultContext(
            self._names,
            partial(self._draw_event, timed),
            self._delay_command,
            demand,
            effort,
            partial(self._since, self._tick),
        )

    def _since(self, tick: int) -> int:
        return self._tick - tick

    def _delay_command(self, command: EffortCommand, ticks: int, first: bool) -> None:
        self.late.append(LateCommand(self._tick + ticks, first, command))

    def _draw_event(self, timed: Timed, probability: float) -> bool:
        """Return whether chance strikes at this tick."""
        fault: Any = timed.fault
        key = key_of(self._seed, self._epoch, timed.start, fault.kind, fault.seed)
        return random_number(key, self._tick) < probability
