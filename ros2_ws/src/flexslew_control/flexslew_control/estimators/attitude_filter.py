"""The filter of an attitude and a gyro's bias, and what a filter with modes shares with it."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flexslew_control.estimators.attitude_steps import (
    BIAS,
    MODES,
    AttitudeEstimate,
    ErrorMap,
    carry,
    rigid_errors,
)
from flexslew_plant.arrays import EMPTY, Matrix, Vector


class GyroNoise(NamedTuple):
    """What a gyro's readings are taken to be wrong by."""

    white: float  # density of its white noise [rad/sqrt(s)]
    walk: float  # of the random walk of its bias [rad/s/sqrt(s)]


class Correction(NamedTuple):
    """An estimate after a reading."""

    estimate: AttitudeEstimate
    innovation: Vector  # measured minus predicted, shape (l,) [rad]
    nis: float  # innovation^T S^-1 innovation


def copied(estimate: AttitudeEstimate) -> AttitudeEstimate:
    """Return an estimate in arrays of its own."""
    return AttitudeEstimate(estimate.state.copy(), estimate.covariance.copy())


@dataclass(frozen=True)
class RigidFilter:
    """A filter of attitude and bias alone: the gyro carries the attitude.

    Args:
        noise: of the gyro.
        period: one tick [s].
    """

    noise: GyroNoise
    period: float
    errors: ErrorMap = field(init=False, default_factory=rigid_errors)
    channels: int = field(init=False, default=0)

    def begin(
        self, attitude: Vector, reading: Vector, sigmas: tuple[float, float]
    ) -> AttitudeEstimate:
        """Return the estimate of an attitude and no bias."""
        state = np.concatenate((attitude, np.zeros(3)))
        return AttitudeEstimate(state, np.diag(np.repeat(sigmas, 3) ** 2))

    def propagate(self, estimate: AttitudeEstimate, reading: Vector, effort: Vector) -> Correction:
        """Return the estimate a tick later, turned by the gyro's reading."""
        after = copied(estimate)
        carry(after, reading, np.array(self.noise), self.period)
        return Correction(after, EMPTY, 0.0)

    def rate(self, estimate: AttitudeEstimate, reading: Vector) -> Vector:
        """Return the rate in body axes: the gyro's reading less its bias, shape (3,) [rad/s]."""
        rate: Vector = reading - estimate.state[BIAS:MODES]
        return rate

    def covariance(self, estimate: AttitudeEstimate) -> Matrix:
        """Return that of small turn and bias."""
        return estimate.covariance
