"""The multiplicative extended Kalman filter of an attitude and a gyro's bias.

Lefferts, Markley and Shuster 1982; the discrete form is that of Crassidis and Junkins, Optimal
Estimation of Dynamic Systems, 2nd ed., section 7.2. The error of the attitude is a small turn in
body axes, q_true = q dq(theta), that of the bias b_true - b; covariances are of both, in this
order.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.estimators.attitude_steps import (
    carry,
    take_attitude,
    take_direction,
    write_cross_axes,
)
from flexslew_plant.arrays import Matrix, Vector


class GyroNoise(NamedTuple):
    """What a gyro's readings are taken to be wrong by."""

    white: float  # density of its white noise [rad/sqrt(s)]
    walk: float  # of the random walk of its bias [rad/s/sqrt(s)]


class AttitudeEstimate(NamedTuple):
    """An attitude and a bias, and how far off they may be."""

    attitude: Vector  # unit quaternion from body to inertial axes, x y z w, shape (4,)
    bias: Vector  # of the gyro, shape (3,) [rad/s]
    covariance: Matrix  # shape (6, 6)


class Correction(NamedTuple):
    """What became of a reading."""

    belief: Any  # as it was given
    innovation: Vector  # measured minus predicted, shape (l,) [rad]
    nis: float  # innovation^T S^-1 innovation


def propagate(
    estimate: AttitudeEstimate, reading: Vector, noise: GyroNoise, dt: float
) -> AttitudeEstimate:
    """Return the belief a tick later.

    theta+ = R(d)^T theta - dt (1 - d x / 2) e + w, d = (reading - b) dt, e the bias' error; the
    covariance of w is Farrenkopf's.

    Args:
        estimate: at the start of the tick.
        reading: mean rate over the tick, bias and noise in it, shape (3,) [rad/s].
        noise: of the gyro.
        dt: one tick [s].
    """
    after = _copied(estimate)
    carry(*after, reading, noise.white, noise.walk, dt)
    return after


def correct_by_attitude(estimate: AttitudeEstimate, measured: Vector, noise: Matrix) -> Correction:
    """Return the belief after a measured attitude.

    Args:
        estimate: before it.
        measured: quaternion x y z w, q_true dq(n), of either sign, shape (4,).
        noise: covariance of the small turn n in body axes, shape (3, 3) [rad^2].
    """
    after, off = _copied(estimate), np.empty(3)
    nis = take_attitude(*after, measured, noise, off)
    return Correction(after, off, nis)


def correct_by_direction(
    estimate: AttitudeEstimate, measured: Vector, inertial: Vector, sigma: float
) -> Correction:
    """Return the belief after a measured direction, which determines the two turns across it.

    Args:
        estimate: prior belief.
        measured: unit vector in body axes, shape (3,).
        inertial: the same direction in inertial space, a unit vector, shape (3,).
        sigma: standard deviation in each direction across it [rad].
    """
    after, off = _copied(estimate), np.empty(2)
    nis = take_direction(*after, measured, inertial, sigma, off)
    return Correction(after, off, nis)


def cross_axes(seen: Vector) -> Matrix:
    """Return two unit vectors across a direction and each other, shape (2, 3)."""
    two = np.empty((2, 3))
    write_cross_axes(seen[0], seen[1], seen[2], two)
    return two


@dataclass(frozen=True)
class RigidFilter:
    """Implements AttitudeFilter, see attitude_estimator: the gyro carries the attitude.

    Args:
        noise: of the gyro.
        period: one tick [s].
    """

    noise: GyroNoise
    period: float

    @property
    def channels(self) -> int:
        """How many innovations the gyro gives: it is believed."""
        return 0

    def begin(self, attitude: Vector, reading: Vector, sigmas: tuple[float, float]) -> Any:
        """Return a belief in an attitude and no bias."""
        return AttitudeEstimate(attitude, np.zeros(3), np.diag(np.repeat(sigmas, 3) ** 2))

    def propagate(self, estimate: Any, reading: Vector, effort: Vector) -> Correction:
        """Return the belief a tick later, turned by what the gyro has read."""
        after = propagate(estimate, reading, self.noise, self.period)
        return Correction(after, np.zeros(0), 0.0)

    def update_attitude(self, estimate: Any, measured: Vector, noise: Matrix) -> Correction:
        """Return the belief after a measured attitude."""
        return correct_by_attitude(estimate, measured, noise)

    def update_direction(
        self, estimate: Any, measured: Vector, inertial: Vector, sigma: float
    ) -> Correction:
        """Return the belief after a measured direction."""
        return correct_by_direction(estimate, measured, inertial, sigma)

    def initialize_attitude(self, estimate: Any, measured: Vector, noise: Matrix) -> Any:
        """Return the belief in the first measured attitude."""
        covariance = estimate.covariance.copy()
        covariance[:3, :3], covariance[:3, 3:], covariance[3:, :3] = noise, 0.0, 0.0
        return AttitudeEstimate(measured, estimate.bias, covariance)

    def rate(self, estimate: Any, reading: Vector) -> Vector:
        """Return the rate in body axes: what the gyro reads less its bias, shape (3,) [rad/s]."""
        rate: Vector = reading - estimate.bias
        return rate

    def covariance(self, estimate: Any) -> Matrix:
        """Return that of small turn and bias."""
        covariance: Matrix = estimate.covariance
        return covariance


def _copied(estimate: AttitudeEstimate) -> AttitudeEstimate:
    """Return a belief in arrays of its own."""
    return AttitudeEstimate(*(one.copy() for one in estimate))
