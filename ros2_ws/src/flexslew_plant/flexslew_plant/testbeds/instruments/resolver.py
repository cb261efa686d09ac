"""Resolvers: the angles of the gimbals of all control moment gyros of a platform."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from flexslew_plant.arrays import Vector, compiled_once
from flexslew_plant.settings import NonNegative, section
from flexslew_plant.testbeds.instruments.instrument import (
    BodyState,
    CompiledReader,
    white_reader,
    write_white,
)


@section
class ResolverSettings:
    """One resolver in each gimbal of the platform."""

    kind: Literal["resolver"]
    noise: NonNegative = 0.0  # standard deviation of an angle, each tick [rad]


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
        return white_reader(read_resolver, self, self.settings.noise, rng)


@compiled_once("memory", "out")
def read_resolver(
    k: int, constants: Vector, body: Vector, samples: Vector, memory: Vector, out: Vector
) -> None:
    """Write the readings of resolvers."""
    write_white(body[body.size - out.size :], constants, samples, out)
