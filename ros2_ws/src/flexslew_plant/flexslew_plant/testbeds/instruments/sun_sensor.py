"""A Sun sensor: the direction to the Sun in body axes, as long as it is in the field of view."""

from dataclasses import dataclass
from math import sqrt
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from flexslew_plant.arrays import Vector, compiled_once
from flexslew_plant.settings import NonNegative, section
from flexslew_plant.testbeds.instruments.instrument import BodyState, CompiledReader, noisy
from flexslew_plant.testbeds.orientation.attitude import to_body
from flexslew_plant.testbeds.orientation.quaternions import to_body_axes


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

    def exact(self, body: BodyState) -> Vector:
        """Return the Sun's direction in body axes, in view or not, shape (3,)."""
        return to_body(body.attitude) @ self.sun

    def reader(self, period: float, rng: np.random.Generator | None) -> CompiledReader:
        """Return what reads it; see Instrument."""
        s = self.settings
        along = np.array(s.boresight) / np.linalg.norm(s.boresight)
        constants = np.array([*along, np.cos(s.half_angle), noisy(s.noise, rng), *self.sun])
        return CompiledReader(read_sun_sensor, constants, np.zeros(0), 0, 3)


@compiled_once("memory", "out")
def read_sun_sensor(
    k: int, constants: Vector, body: Vector, samples: Vector, memory: Vector, out: Vector
) -> None:
    """Write the reading of a Sun sensor."""
    bx, by, bz, edge, noise = constants[:5]
    now = (body[0], body[1], body[2], body[3])
    x, y, z = to_body_axes(now, constants[5], constants[6], constants[7])
    if bx * x + by * y + bz * z < edge:
        out[:3] = 0.0
        return
    along = samples[0] * x + samples[1] * y + samples[2] * z
    a, b, c = samples[0] - along * x, samples[1] - along * y, samples[2] - along * z
    x, y, z = x + noise * a, y + noise * b, z + noise * c
    size = sqrt(x * x + y * y + z * z)
    out[0], out[1], out[2] = x / size, y / size, z / size
