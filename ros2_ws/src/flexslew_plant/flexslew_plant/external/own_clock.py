"""A plant with a clock of its own: it measures each period, and the bench keeps up or it stops.

The first effort of an epoch starts the clock of the plant. From then on it sends the measurement of
each tick at its own time, and holds the newest effort. A measurement that does not come is a lost
tick: the one before it stands in its place. An effort that leaves after the next measurement has
come is a late tick, unless its own measurement was lost.
"""

from collections import deque
from collections.abc import Callable
from time import monotonic
from typing import NamedTuple

from flexslew_plant.arrays import Vector
from flexslew_plant.events import Fact, PlantTicksMissed
from flexslew_plant.external.messages import PlantFault
from flexslew_plant.external.plant_link import PlantLink
from flexslew_plant.step_times import StepTimes

_REPEAT = 0.1  # until the effort that starts the clock is sent again [wall s]


class ClockLimits(NamedTuple):
    """When a plant with a clock of its own counts as lost."""

    start: float  # longest wait for the first measurement after tick 0 [wall s]
    watchdog: int  # longest silence [periods]
    missed: int  # most ticks in a row that are lost or late


class _Sample(NamedTuple):
    """A measurement that has come."""

    tick: int
    state: Vector  # see PlantLink
    arrival: float  # when it was read [wall s]


class ClockedPlant:
    """A running plant with a clock of its own; see testbeds.contract.RunningPlant.

    Args:
        link: to it.
        period: of its clock [s].
        limits: beyond which it counts as lost.
        clock: returns the time, never backwards [wall s].
    """

    def __init__(
        self,
        link: PlantLink,
        period: float,
        limits: ClockLimits,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        self._link, self._period, self._limits, self._clock = link, period, limits, clock
        self._response, self._interval = StepTimes(), StepTimes()
        self._queue = deque[_Sample]()

    @property
    def facts(self) -> deque[Fact]:
        """What it has to note in the log."""
        return self._link.facts

    def reset(self) -> Vector:
        """Stop it and return to tick 0 of the next epoch; return the state there.

        Raises:
            PlantFault: it does not brake, or there is no such answer.
        """
        self._link.stop()
        self._queue.clear()
        self._tick = self._newest = 0
        self._lost = self._late = self._gap_end = 0  # ticks of the present gap, and its last one
        self._current: _Sample | None = None  # the measurement of this tick, unless it is lost
        self._state = self._link.reset()
        return self._state

    def advance(self, effort: Vector) -> Vector:
        """Send the efforts, shape (joints,) [N m or N]; return the next measured state.

        Raises:
            PlantFault: it is silent for too long, or too many ticks in a row are missed; its brake
                was requested.
        """
        try:
            self._receive(0.0)
            late = self._current is not None and self._newest > self._tick
            sent = self._send(effort)
            self._wait(effort, sent)
            self._tick += 1
            lost = self._queue[0].tick != self._tick
            if not lost:
                self._take(self._queue.popleft())
            else:
                self._current = None
            self._count(lost, late)
        except PlantFault as error:
            self._note_gap()
            raise self._link.braked(error) from None
        return self._state

    def stop(self) -> None:
        """Brake, and note the times of the epoch; a second call changes nothing.

        Raises:
            PlantFault: the brake is not acknowledged.
        """
        try:
            self._link.stop()
        finally:
            self._note_gap()
            for quantity, times in (("response", self._response), ("interval", self._interval)):
                self._link.note_times(quantity, times)
            self._response, self._interval = StepTimes(), StepTimes()

    def close(self) -> int | None:
        """Brake and end the link; return the exit status of a process."""
        return self._link.close()

    def _send(self, effort: Vector) -> float:
        """Send the efforts of this tick; return when [wall s]."""
        self._link.send(effort, self._tick)
        now = self._clock()
        if self._current is not None:
            self._response.add(now - self._current.arrival)
        return now

    def _wait(self, effort: Vector, sent: float) -> None:
        """Wait until a measurement after this tick has come."""
        starting = not self._newest
        silence = self._limits.start if starting else self._limits.watchdog * self._period
        end = sent + silence
        while not self._queue:
            left = end - self._clock()
            self._receive(max(0.0, min(left, _REPEAT) if starting else left))
            if self._queue:
                return
            if left <= 0.0:
                words = f"no measurement for {silence:g} s"
                raise PlantFault(f"{self._link.name}: {words} after tick {self._tick}")
            if starting:
                self._link.send(effort, self._tick)

    def _receive(self, timeout: float) -> None:
        """Take the measurements that have come; wait for one for a time at most [wall s]."""
        while (found := self._link.measurement(timeout)) is not None:
            timeout = 0.0
            tick, state = found
            if tick > self._newest:
                self._newest = tick
                self._queue.append(_Sample(tick, state, self._clock()))

    def _take(self, sample: _Sample) -> None:
        """Make a measurement that of this tick."""
        if self._current is not None:
            self._interval.add(sample.arrival - self._current.arrival)
        self._current, self._state = sample, sample.state

    def _count(self, lost: bool, late: bool) -> None:
        """Count a missed tick, or end a gap of them."""
        if not (lost or late):
            self._note_gap()
            return
        self._lost, self._late = self._lost + lost, self._late + (late and not lost)
        self._gap_end, count = self._tick, self._lost + self._late
        if count > self._limits.missed:
            words = f"{count} ticks in a row are missed, {self._lost} lost and {self._late} late"
            raise PlantFault(f"{self._link.name}: {words}; {self._limits.missed} are allowed")

    def _note_gap(self) -> None:
        """Note the missed ticks since the last tick that was not."""
        lost, late = self._lost, self._late
        if lost or late:
            self.facts.append(PlantTicksMissed(self._gap_end, lost + late, lost, late))
        self._lost = self._late = 0
