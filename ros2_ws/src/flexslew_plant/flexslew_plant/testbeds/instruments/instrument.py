"""The contract of a sensor whose readings depend on what it has measured before."""

from collections.abc import Callable
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np

from flexslew_plant.arrays import NOTHING, Vector


class MovingBody(NamedTuple):
    """How the platform stands and turns."""

    attitude: Vector  # unit quaternion from body to inertial axes, x y z w, shape (4,)
    rate: Vector  # in body axes, shape (3,) [rad/s]
    wheels: Vector = NOTHING  # speeds of its wheels relative to it, shape (wheels,) [rad/s]
    gimbals: Vector = NOTHING  # angles of its control moment gyros, shape (gyros,) [rad]


# from the platform at a tick to the reading; called once a tick, in order
Reader: TypeAlias = Callable[[MovingBody], Vector]


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

    def exact(self, body: MovingBody) -> Vector:
        """Return what it reads without errors, delay and gaps, shape (channels,)."""

    def begin(self, period: float, rng: np.random.Generator | None) -> Reader:
        """Return what reads it from tick 0 on.

        Args:
            period: one tick [s].
            rng: of its noises; None: it has no errors, but its delay and gaps.
        """


def channels(instrument: Instrument) -> slice:
    """Return where an instrument's channels stand among the readings of the tips."""
    return slice(instrument.first, instrument.first + len(instrument.axes))


def with_noise(exact: Reader, noise: float, rng: np.random.Generator | None) -> Reader:
    """Return a reader with white noise of a standard deviation; without a generator there is none.

    Args:
        exact: without it.
        noise: in the unit of the readings, each tick.
        rng: of the noise.
    """
    if rng is None or not noise:
        return exact

    def read(body: MovingBody) -> Vector:
        reading = exact(body)
        return np.asarray(reading + noise * rng.standard_normal(reading.size))

    return read
