"""Whether a plant keeps the rules of docs/external_plant.md, or with its own clock of rig.md."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Matrix
from flexslew_plant.events import Fact
from flexslew_plant.external.messages import PlantFault
from flexslew_plant.external.own_clock import ClockedPlant, ClockLimits
from flexslew_plant.external.plant_link import Hello, PlantLink
from flexslew_plant.external.transport import Transport

_TICKS = 200  # flown by each of the rules
_SHARE = 0.1  # largest effort, of each drive's limit
_SEED = 1
_PERIOD = 0.01  # [s]
_NEAR = 1e-9  # of the positions at tick 0 from those that the description gives [rad or m]


class PlantRule(NamedTuple):
    """What became of one rule."""

    rule: str
    wrong: str  # in words; empty: it is kept

    @property
    def ok(self) -> bool:
        """Whether it is kept."""
        return not self.wrong


class PlantRules:
    """The examination of one plant.

    A plant with its own clock may be a machine that moves: it receives zero efforts.

    Args:
        connect: starts the program, or opens the line to it.
        period: that it is asked for [s].

    Attributes:
        facts: times of its steps, and the ticks that it missed.
    """

    def __init__(self, connect: Callable[[], Transport], period: float = _PERIOD) -> None:
        self._connect, self._period = connect, period
        self._link: PlantLink | None = None
        self._first = np.zeros((0, 0))  # states of the first flight
        self.facts: list[Fact] = []

    def check(self) -> list[PlantRule]:
        """Return what became of each rule, in their order, up to the first that ends the plant."""
        results: list[PlantRule] = []
        for rule, check in self._rules():
            try:
                results.append(PlantRule(rule, check()))
            except PlantFault as error:
                results.append(PlantRule(rule, str(error)))
                break
        if self._link is not None:
            self._link.close()
        return results

    def _rules(self) -> Iterator[tuple[str, Callable[[], str]]]:
        """Yield the rules; which follow depends on the description, the first."""
        yield "description: protocol, joints, units, limits, tips", self._describe
        yield "start: tick 0 is at the positions of the description", self._start
        if self._plant.described["clock"] == "own":
            yield f"ticks: {_TICKS} measurements at its own time, none lost", self._keep_time
            yield "brake: it is acknowledged, and no measurement follows", self._brake
            yield "watchdog: without efforts it brakes by itself and reports it", self._starve
            return
        yield f"ticks: {_TICKS} efforts, each answered once with finite numbers", self._fly
        yield "reset: the next epoch gives the same answers, to the last bit", self._reset
        yield "effort: another effort gives another answer", self._react
        again = "another process, or session on the line,"
        yield f"start again: {again} gives the same answers, to the last bit", self._restart
        yield "end: a process ends by itself after shutdown; a brake is acknowledged", self._end

    @property
    def _plant(self) -> PlantLink:
        """The running plant."""
        if self._link is None:
            self._link = PlantLink(self._connect(), Hello(self._period, {}, {}))
        return self._link

    def _describe(self) -> str:
        return "" if self._plant.described["joints"] else "no joints"

    def _start(self) -> str:
        described = self._plant.described
        state = self._plant.reset()
        for name, at in zip(described["joints"], state.tolist(), strict=False):
            initial = described["initial"].get(name, 0.0)
            if not abs(at - initial) <= _NEAR:
                return f"{name} is at {at:g} at tick 0; its description gives {initial:g}"
        return ""

    def _efforts(self) -> Matrix:
        """Return small random efforts, the same in every call, shape (ticks, joints)."""
        limit = np.array(self._plant.described["effort_limit"])
        rng = np.random.default_rng(_SEED)
        return _SHARE * limit * rng.uniform(-1.0, 1.0, (_TICKS, limit.size))

    def _flight(self, sign: float = 1.0) -> Matrix:
        """Return the states of an epoch, shape (ticks + 1, size of a state)."""
        states = [self._plant.reset()]
        states += [self._plant.advance(sign * effort) for effort in self._efforts()]
        return np.array(states)

    def _fly(self) -> str:
        self._first = self._flight()
        self._plant.stop()
        self._take_facts()
        return ""

    def _reset(self) -> str:
        return _difference(self._first, self._flight())

    def _react(self) -> str:
        same = np.array_equal(self._first, self._flight(-1.0))
        return "efforts of the opposite sign give the same answers" if same else ""

    def _restart(self) -> str:
        self._plant.close()
        self._link = None
        return _difference(self._first, self._flight())

    def _end(self) -> str:
        self._plant.stop()
        code = self._plant.close()
        self._link = None
        if code is None:
            return "it had to be terminated; it ends after shutdown, or at the end of its input"
        return "" if code == 0 else f"it exited with {code}; 0 is due"

    def _keep_time(self) -> str:
        clocked = self._clocked_flight(_TICKS)
        clocked.stop()
        lost = sum(getattr(fact, "lost", 0) for fact in self._take_facts())
        return f"{lost} measurements are lost" if lost else ""

    def _brake(self) -> str:
        return "a measurement after the brake" if self._follows(10.0) else ""

    def _starve(self) -> str:
        self._clocked_flight(1)
        patience = self._plant.timeout
        try:
            for _ in range(int(patience / self._clock_period) + 1):
                if self._plant.measurement(patience) is None:
                    return "it stops without a report"
        except PlantFault:
            return "it reports it and still measures" if self._follows(10.0) else ""
        return f"it still measures after {patience:g} s without efforts"

    def _clocked_flight(self, ticks: int) -> ClockedPlant:
        """Return a plant with its own clock after some ticks of zero efforts."""
        link = self._plant
        watchdog = max(1, round(link.timeout / self._clock_period))
        limits = ClockLimits(link.timeout, watchdog, missed=_TICKS)  # late ones are reported
        clocked = ClockedPlant(link, self._clock_period, limits)
        clocked.reset()
        still = np.zeros(len(link.described["joints"]))
        for _ in range(ticks):
            clocked.advance(still)
        return clocked

    @property
    def _clock_period(self) -> float:
        """Period of its own clock [s]."""
        return self._plant.period or self._period

    def _follows(self, periods: float) -> bool:
        """Return whether a measurement comes within some periods."""
        return self._plant.measurement(periods * self._clock_period) is not None

    def _take_facts(self) -> list[Fact]:
        """Move what the link has noted to the facts; return it."""
        taken = list(self._plant.facts)
        self._plant.facts.clear()
        self.facts += taken
        return taken


def _difference(first: Matrix, second: Matrix) -> str:
    """Return where two flights differ; empty: nowhere."""
    ticks = np.flatnonzero((first != second).any(axis=1))
    return f"tick {ticks[0]}: another answer than the first time" if ticks.size else ""
