"""Resolvers: the angles of the gimbals of all control moment gyros of a platform."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.settings import NonNegative, section
from flexslew_plant.testbeds.instruments.instrument import MovingBody, Reader, with_noise


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

    def exact(self, body: MovingBody) -> Vector:
        """Return the angles, shape (gyros,) [rad]."""
        return body.gimbals

    def begin(self, period: float, rng: np.random.Generator | None) -> Reader:
        """Return what reads it; see Instrument."""
        return with_noise(self.exact, self.settings.noise, rng)
