"""The contract of a sensor with readings that depend on what it has measured before."""

from collections.abc import Callable
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np

from flexslew_plant.arrays import EMPTY, Matrix, Vector, compiled

# from the platform at a tick to the reading; called once a tick, in order
Reader: TypeAlias = Callable[["BodyState"], Vector]

# (k, constants, body, draws, memory, out): writes the reading of tick k and advances the memory;
# body: the parts of a BodyState, one after another; draws: the random numbers of this tick
Read: TypeAlias = Callable[[int, Vector, Vector, Vector, Vector, Vector], None]
RATE, WHEELS = 4, 7  # where rate and wheels begin in the body


class BodyState(NamedTuple):
    """How the platform stands and turns."""

    attitude: Vector  # unit quaternion from body to inertial axes, x y z w, shape (4,)
    rate: Vector  # in body axes, shape (3,) [rad/s]
    wheels: Vector = EMPTY  # speeds of its wheels relative to it, shape (wheels,) [rad/s]
    gimbals: Vector = EMPTY  # angles of its control moment gyros, shape (gyros,) [rad]


class CompiledReader(NamedTuple):
    """What reads an instrument in compiled code, before tick 0."""

    read: Read
    constants: Vector
    memory: Vector
    uniform: int  # random numbers of a tick: first so many, at least 0 and below 1
    normal: int  # then so many

    def draw(self, rng: np.random.Generator | None, ticks: int) -> Matrix:
        """Return the random numbers of the next ticks, a row each; zeros without a generator."""
        rows = np.zeros((ticks, self.uniform + self.normal))
        if rng is not None:
            _draw(rng, self.uniform, rows)
        return rows


@compiled
def _draw(rng: np.random.Generator, uniform: int, rows: Matrix) -> None:
    for k in range(len(rows)):
        for i in range(uniform):
            rows[k, i] = rng.random()
        for i in range(uniform, rows.shape[1]):
            rows[k, i] = rng.standard_normal()


class Instrument(Protocol):
    """A sensor on the platform with one or more channels."""

    @property
    def name(self) -> str:
        """Of its section."""

    @property
    def first(self) -> int:
        """Where its channels begin among the readings of the tips."""

    @property
    def axes(self) -> tuple[str, ...]:
        """What is appended to its name, one per channel."""

    def exact(self, body: BodyState) -> Vector:
        """Return what it reads without errors, delay and gaps, shape (channels,)."""

    def reader(self, period: float, rng: np.random.Generator | None) -> CompiledReader:
        """Return what reads it from tick 0 on.

        Args:
            period: one tick [s].
            rng: generator of its noises, which then draws those of every tick; None: it has no
                errors, but its delay and gaps.
        """


class TickReader:
    """Reads an instrument tick by tick from tick 0 on.

    Args:
        instrument: the instrument to read.
        period: one tick [s].
        rng: generator of its noises; see Instrument.reader.
    """

    def __init__(
        self, instrument: Instrument, period: float, rng: np.random.Generator | None
    ) -> None:
        self._reader, self._rng, self._tick = instrument.reader(period, rng), rng, 0
        self._channels = len(instrument.axes)
        self._samples: Vector = np.zeros(self._reader.uniform + self._reader.normal)
        self.memory = self._reader.memory

    def __call__(self, body: BodyState) -> Vector:
        """Return the reading of this tick, shape (channels,)."""
        read, constants, _, uniform, _ = self._reader
        if self._rng is not None:  # as CompiledReader.drawn, which takes longer for one tick
            self._rng.random(out=self._samples[:uniform])
            self._rng.standard_normal(out=self._samples[uniform:])
        out = np.empty(self._channels)
        read(self._tick, constants, np.concatenate(body), self._samples, self.memory, out)
        self._tick += 1
        return out


def channels(instrument: Instrument) -> slice:
    """Return where an instrument's channels stand among the readings of the tips."""
    return slice(instrument.first, instrument.first + len(instrument.axes))


def noisy(noise: float, rng: np.random.Generator | None) -> float:
    """Return what a noise is with a generator of random numbers; without one there is none."""
    return 0.0 if rng is None else noise
