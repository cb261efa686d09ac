"""A Sun sensor: the direction to the Sun in body axes, as long as it is in the field of view."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from flexslew_plant.arrays import Vector
from flexslew_plant.settings import NonNegative, section
from flexslew_plant.testbeds.attitude import to_body
from flexslew_plant.testbeds.instruments.instrument import MovingBody, Reader

_DARK = np.zeros(3)


@section
class SunSensorSettings:
    """A Sun sensor on the platform."""

    kind: Literal["sun_sensor"]
    # of a Sun sensor, in body axes, of any length
    boresight: tuple[float, float, float] = (0.0, 0.0, 1.0)
    half_angle: Annotated[float, Field(gt=0.0, le=np.pi)] = 1.0  # of its field of view [rad]
    noise: NonNegative = 0.0  # standard deviation, in each direction across the Sun's [rad]
    # direction to the Sun in inertial space, of any length; null: that of `orbit`
    sun: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class SunSensor:
    """s + n, normalised, s the Sun's direction in body axes; zeros out of the field of view.

    Args:
        name: of its section.
        first: its first channel.
        settings: its errors.
        sun: direction to the Sun in inertial space, a unit vector, shape (3,).
    """

    name: str
    first: int
    settings: SunSensorSettings
    sun: Vector
    axes: ClassVar[tuple[str, ...]] = ("x", "y", "z")

    def exact(self, body: MovingBody) -> Vector:
        """Return the Sun's direction in body axes, in view or not, shape (3,)."""
        return to_body(body.attitude) @ self.sun

    def begin(self, period: float, rng: np.random.Generator | None) -> Reader:
        """Return what reads it; see Instrument."""
        s = self.settings
        along = np.array(s.boresight) / np.linalg.norm(s.boresight)
        edge = np.cos(s.half_angle)

        def read(body: MovingBody) -> Vector:
            noise = rng.standard_normal(3) if rng else np.zeros(3)
            sun = self.exact(body)
            if along @ sun < edge:
                return _DARK
            off = sun + s.noise * (noise - (noise @ sun) * sun)
            reading: Vector = off / np.linalg.norm(off)
            return reading

        return read
