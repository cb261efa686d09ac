"""Tachometers and resolvers: the speeds of all wheels, and the angles of all gimbals."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from flexslew_plant.arrays import Vector, compiled_once
from flexslew_plant.settings import NonNegative, section
from flexslew_plant.testbeds.instruments.instrument import (
    WHEELS,
    BodyState,
    CompiledReader,
    Instrument,
    noisy,
)

_LAST = -1  # in place of where readings begin in the body: they are its last entries


@section
class TachometerSettings:
    """One tachometer in each wheel of the platform."""

    kind: Literal["tachometer"]
    noise: NonNegative = 0.0  # standard deviation of a speed, each tick [rad/s]


@section
class ResolverSettings:
    """One resolver in each gimbal of the platform."""

    kind: Literal["resolver"]
    noise: NonNegative = 0.0  # standard deviation of an angle, each tick [rad]


@dataclass(frozen=True)
class Tachometer:
    """s + n, s the speed of each wheel's spin relative to the platform.

    Args:
        name: of its section.
        first: its first channel.
        axes: the wheels, by name.
        settings: its errors.
    """

    name: str
    first: int
    axes: tuple[str, ...]
    settings: TachometerSettings

    def exact(self, body: BodyState) -> Vector:
        """Return the speeds, shape (wheels,) [rad/s]."""
        return body.wheels

    def reader(self, period: float, rng: np.random.Generator | None) -> CompiledReader:
        """Return what reads it; see Instrument."""
        return _white_reader(self, self.settings.noise, WHEELS, rng)


@dataclass(frozen=True)
class Resolver:
    """d + n, d the angle of each gimbal.

    Args:
        name: of its section.
        first: its first channel.
        axes: the gyros, by name.
        settings: its errors.
    """

    name: str
    first: int
    axes: tuple[str, ...]
    settings: ResolverSettings

    def exact(self, body: BodyState) -> Vector:
        """Return the angles, shape (gyros,) [rad]."""
        return body.gimbals

    def reader(self, period: float, rng: np.random.Generator | None) -> CompiledReader:
        """Return what reads it; see Instrument."""
        return _white_reader(self, self.settings.noise, _LAST, rng)


def _white_reader(
    instrument: Instrument, noise: float, begin: int, rng: np.random.Generator | None
) -> CompiledReader:
    """Return the reader of entries of the body with white noise of one size."""
    size = noisy(noise, rng)
    normal = len(instrument.axes) if size else 0
    return CompiledReader(read_rotors, np.array([size, begin]), np.zeros(0), 0, normal)


@compiled_once("memory", "out")
def read_rotors(
    k: int, constants: Vector, body: Vector, samples: Vector, memory: Vector, out: Vector
) -> None:
    """Write the readings of tachometers or resolvers."""
    begin = int(constants[1])
    if begin < 0:
        begin = body.size - out.size
    for i in range(out.size):
        out[i] = body[begin + i] + (constants[0] * samples[i] if samples.size else 0.0)
