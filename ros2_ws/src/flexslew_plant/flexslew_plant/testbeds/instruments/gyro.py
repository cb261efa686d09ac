"""A three-axis rate-integrating gyro.

Farrenkopf 1978; the discrete form is that of Crassidis and Junkins, Optimal Estimation of Dynamic
Systems, 2nd ed., section 7.2.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from flexslew_plant.arrays import NOTHING, Matrix, Vector
from flexslew_plant.settings import NonNegative, section
from flexslew_plant.testbeds.attitude import (
    conjugate,
    product,
    quaternion,
    rotation_vector,
    to_body,
)
from flexslew_plant.testbeds.instruments.instrument import MovingBody

Triple = tuple[float, float, float]


@section
class GyroSettings:
    """A gyro on the platform, along the body axes."""

    kind: Literal["gyro"]
    angle_random_walk: NonNegative = 0.0  # density of a gyro's white noise [rad/sqrt(s)]
    rate_random_walk: NonNegative = 0.0  # of the random walk of its bias [rad/s/sqrt(s)]
    bias: Triple = (0.0, 0.0, 0.0)  # of a gyro at the start, in body axes [rad/s]
    bias_spread: NonNegative = 0.0  # standard deviation about it, drawn by the seed [rad/s]
    scale: Triple = (0.0, 0.0, 0.0)  # errors of the scale factors [-]
    misalignment: Triple = (0.0, 0.0, 0.0)  # rotation vector from the body's axes to its own [rad]


@dataclass(frozen=True)
class Gyro:
    """y = (1 + S) A w + b + n: the mean rate of the last tick, with bias and noise.

    Over a tick T the mean of n has the variance angle_random_walk^2 / T, and b is a random walk,
    whose mean over the tick counts. At tick 0 it reads the rate of that instant.

    Args:
        name: of its section.
        first: its first channel.
        settings: its errors.
    """

    name: str
    first: int
    settings: GyroSettings
    axes: ClassVar[tuple[str, ...]] = ("x", "y", "z")

    def exact(self, body: MovingBody) -> Vector:
        """Return the body rate, shape (3,) [rad/s]."""
        return body.rate

    def begin(self, period: float, rng: np.random.Generator | None) -> "GyroReader":
        """Return what reads it; see Instrument."""
        return GyroReader(self, period, rng)

    @property
    def response(self) -> Matrix:
        """(1 + S) A, shape (3, 3)."""
        s = self.settings
        response: Matrix = np.diag(1.0 + np.array(s.scale)) @ to_body(
            quaternion(np.array(s.misalignment))
        )
        return response


class GyroReader:
    """Reads a gyro tick by tick; see Gyro.

    Args:
        gyro: with its errors.
        period: one tick T [s].
        rng: of its noises; None: it has no errors.
    """

    def __init__(self, gyro: Gyro, period: float, rng: np.random.Generator | None) -> None:
        s = gyro.settings
        self._settings, self._period, self._rng = s, period, rng
        self._response = gyro.response
        self._before = NOTHING  # attitude of the tick before
        self.bias: Vector = np.zeros(3)  # at this tick [rad/s]
        if rng is not None:
            self.bias = np.array(s.bias) + s.bias_spread * rng.standard_normal(3)

    def __call__(self, body: MovingBody) -> Vector:
        """Return the reading of this tick, shape (3,) [rad/s]."""
        first, rate = not self._before.size, body.rate
        if not first:
            turned = product(conjugate(self._before), body.attitude)
            rate = rotation_vector(turned) / self._period
        self._before = body.attitude
        return rate if self._rng is None else self._with_errors(self._rng, rate, first)

    def _with_errors(self, rng: np.random.Generator, rate: Vector, first: bool) -> Vector:
        """Return what it reads of a mean rate; the bias walks on, but for the first tick."""
        s, root = self._settings, np.sqrt(self._period)
        walk, bridge, noise = rng.standard_normal((3, 3))
        step = 0.0 * walk if first else s.rate_random_walk * root * walk
        mean = self.bias + 0.5 * step + s.rate_random_walk * root / np.sqrt(12.0) * bridge
        self.bias = self.bias + step
        reading: Vector = self._response @ rate + mean + s.angle_random_walk / root * noise
        return reading
