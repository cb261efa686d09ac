"""Whether a controller on a serial line keeps the rules of docs/rig.md, and how fast it answers."""

from collections.abc import Callable
from time import perf_counter
from typing import NamedTuple

import numpy as np

from flexslew_plant.errors import FlexslewError
from flexslew_plant.external.controller_link import ControllerHello, RemoteController
from flexslew_plant.serial_line.exchange import Exchange
from flexslew_plant.serial_line.port import Port
from flexslew_plant.step_times import StepTimes, TimeSummary

STEPS = 500  # of the lock-step
_NOISE = bytes(range(1, 256)) * 2 + b"\0\x01\x02\0"
_AMPLITUDE = 0.01  # of the measurements [rad or m, and per s]


class BoardResult(NamedTuple):
    """A rule, and what is wrong; empty: it is kept."""

    rule: str
    wrong: str


class BoardTimes(NamedTuple):
    """Wall times of the questions with their answers, and what the line lost."""

    steps: TimeSummary
    repeats: int
    damaged: int

    def __str__(self) -> str:
        """Return it as one line for people."""
        return f"{self.steps}; {self.repeats} repeats, {self.damaged} damaged frames"


class _Wrong(Exception):
    """A rule is broken."""


class BoardRules:
    """The questions of a bad day, for a board.

    Args:
        port: its line.
        exchange: over this line.
        hello: of the testbed.
    """

    def __init__(self, port: Port, exchange: Exchange, hello: ControllerHello) -> None:
        self._port, self._exchange, self._hello = port, exchange, hello
        self._first: list[bytes] = []  # answers of the first epoch
        self.times: BoardTimes | None = None  # of the lock-step

    def check(self) -> list[BoardResult]:
        """Return the rules, in order, until one is broken."""
        results: list[BoardResult] = []
        rules: dict[str, Callable[[], None]] = {
            "description": self._description,
            "lock-step": self._lockstep,
            "repeat": self._repeat,
            "noise": self._noise,
            "reset": self._reset,
        }
        for rule, keep in rules.items():
            try:
                keep()
            except (FlexslewError, _Wrong) as error:
                return [*results, BoardResult(rule, str(error))]
            results.append(BoardResult(rule, ""))
        return results

    def _description(self) -> None:
        self._link = RemoteController(self._exchange, self._hello)

    def _lockstep(self) -> None:
        none = np.zeros(len(self._hello.effort_limit))
        self._link.reset(0, 0, none)
        before, steps = self._exchange.count.repeats, StepTimes()
        for tick in range(STEPS):
            began = perf_counter()
            self._first.append(self._answer(0, tick))
            steps.add(perf_counter() - began)
        count, summary = self._exchange.count, steps.summary()
        if summary is not None:
            self.times = BoardTimes(summary, count.repeats - before, count.damaged)

    def _repeat(self) -> None:
        for _ in range(3):
            if self._answer(0, STEPS - 1) != self._first[-1]:
                raise _Wrong(f"another answer to the repeated question of tick {STEPS - 1}")

    def _noise(self) -> None:
        try:
            self._port.write(_NOISE)
        except OSError as error:
            raise _Wrong(f"the line is gone ({error})") from None
        if self._answer(0, STEPS - 1) != self._first[-1]:
            raise _Wrong("another answer after noise on the line")

    def _reset(self) -> None:
        self._link.reset(1, 0, np.zeros(len(self._hello.effort_limit)))
        for tick, first in enumerate(self._first):
            if self._answer(1, tick) != first:
                raise _Wrong(f"another answer at tick {tick} of the next epoch")

    def _answer(self, epoch: int, tick: int) -> bytes:
        phase = tick * self._hello.period + np.arange(self._link.numbers)
        return self._link.efforts(epoch, tick, _AMPLITUDE * np.sin(phase)).tobytes()
