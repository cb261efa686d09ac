"""Tachometers: the speeds of all wheels of a platform."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from flexslew_plant.arrays import Vector, compiled_once
from flexslew_plant.settings import NonNegative, section
from flexslew_plant.testbeds.instruments.instrument import (
    WHEELS,
    BodyState,
    CompiledReader,
    white_reader,
    write_white,
)


@section
class TachometerSettings:
    """One tachometer in each wheel of the platform."""

    kind: Literal["tachometer"]
    noise: NonNegative = 0.0  # standard deviation of a speed, each tick [rad/s]


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
        return white_reader(read_tachometer, self, self.settings.noise, rng)


@compiled_once("memory", "out")
def read_tachometer(
    k: int, constants: Vector, body: Vector, samples: Vector, memory: Vector, out: Vector
) -> None:
    """Write the readings of tachometers."""
    write_white(body[WHEELS:], constants, samples, out)
