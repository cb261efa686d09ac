"""A smooth rotation through attitudes: continuous body rates and accelerations.

Between two knots the attitude is R_0 exp(phi(t)); phi is the polynomial of fifth degree that has
the attitudes, rates and accelerations of the knots at its ends. With
c = (1 - cos |phi|) / |phi|^2 and d = (|phi| - sin |phi|) / |phi|^3 body rates are

    w = phi' - c phi x phi' + d phi x (phi x phi')                        (Bortz 1971, inverted)
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BPoly

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.orientation.attitude import (
    conjugate,
    product,
    quaternion,
    rotation_vector,
    skew,
)

_SMALL = 1e-3  # angle below which series are exact to rounding [rad]


class Knot(NamedTuple):
    """An attitude on the way."""

    at: float  # [s]
    attitude: Vector  # quaternion x y z w, (4,)
    rate: Vector | None = None  # in body axes, (3,) [rad/s]; None: between its neighbours'
    acceleration: Vector | None = None  # in body axes, (3,) [rad/s^2]; None: by the rates


class AttitudeMotion(NamedTuple):
    """Attitudes and body rates over time."""

    attitude: Matrix  # quaternions x y z w, (k, 4)
    rate: Matrix  # (k, 3) [rad/s]


def completed(knots: Sequence[Knot]) -> tuple[Knot, ...]:
    """Return knots with the rates and accelerations that they leave open.

    Those of an inner knot are slopes of the parabola through it and its neighbours; its rates are
    exact about one axis under constant acceleration. At both ends rates must be given, and
    accelerations are zero.
    """
    times = np.array([knot.at for knot in knots])
    rotations = [_rotation(one, other) for one, other in pairwise(knots)]
    means = np.array(rotations) / np.diff(times)[:, None]
    rates = [
        knot.rate
        if knot.rate is not None
        else _weighted_slope(means[k - 1], means[k], times[k - 1 : k + 2])
        for k, knot in enumerate(knots)
    ]
    mean_acceleration = np.diff(rates, axis=0) / np.diff(times)[:, None]
    last, zero = len(knots) - 1, np.zeros(3)
    found = []
    for k, knot in enumerate(knots):
        inner = 0 < k < last
        push = (
            _weighted_slope(mean_acceleration[k - 1], mean_acceleration[k], times[k - 1 : k + 2])
            if inner
            else zero
        )
        acceleration = knot.acceleration
        found.append(
            knot._replace(
                rate=rates[k], acceleration=push if acceleration is None else acceleration
            )
        )
    return tuple(found)


def interpolate(knots: Sequence[Knot], times: Vector) -> AttitudeMotion:
    """Return the motion at rising times between the first knot and the last one.

    Args:
        knots: completed, less than half a turn from one to the next.
        times: shape (k,) [s].
    """
    parts = []
    ends = np.searchsorted(times, [knot.at for knot in knots[1:-1]], side="right")
    for one, other, part_times in zip(knots[:-1], knots[1:], np.split(times, ends), strict=True):
        rotation = _rotation(one, other)
        given = [_derivatives(np.zeros(3), one), _derivatives(rotation, other)]
        path = BPoly.from_derivatives([0.0, other.at - one.at], given)
        phi, slope = path(part_times - one.at), path.derivative()(part_times - one.at)
        parts.append(AttitudeMotion(product(one.attitude, quaternion(phi)), body_rates(phi, slope)))
    return AttitudeMotion(*(np.concatenate(rows) for rows in zip(*parts, strict=True)))


def spinning(attitude: Vector, rate: Vector, times: Vector) -> AttitudeMotion:
    """Return the motion with constant body rates from an attitude at time 0 on."""
    path_attitude = product(attitude, quaternion(np.outer(times, rate)))
    return AttitudeMotion(path_attitude, np.tile(rate, (len(times), 1)))


def spin_up(attitude: Vector, rate: Vector, duration: float, times: Vector) -> AttitudeMotion:
    """Return the motion from rest at time 0 to body rates, about their axis, which it then keeps.

    The rate is that of the polynomial 10 s^3 - 15 s^4 + 6 s^5, s = t / duration.

    Args:
        attitude: quaternion x y z w, shape (4,).
        rate: at the end, shape (3,) [rad/s].
        duration: until then [s].
        times: shape (k,) [s].
    """
    s = np.clip(times / duration, 0.0, 1.0)
    share = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    elapsed = duration * s**4 * (2.5 - 3.0 * s + s**2) + np.maximum(times - duration, 0.0)
    path_attitude = product(attitude, quaternion(np.outer(elapsed, rate)))
    return AttitudeMotion(path_attitude, np.outer(share, rate))


def _rotation(one: Knot, other: Knot) -> Vector:
    """Return the rotation vector from a knot to the next, the shorter way, shape (3,) [rad]."""
    return rotation_vector(product(conjugate(one.attitude), other.attitude))


def _weighted_slope(before: Vector, after: Vector, times: Vector) -> Vector:
    """Return the slope in the middle of a parabola with these mean slopes before and after it."""
    first, then = np.diff(times)
    slope: Vector = (then * before + first * after) / (first + then)
    return slope


def body_rates(phi: Matrix, slope: Matrix) -> Matrix:
    """Return body rates of rotation vectors and their slopes, shape (k, 3) [rad/s]."""
    c, d = (factor[:, None] for factor in _factors(np.linalg.norm(phi, axis=1)))
    cross_rate = np.cross(phi, slope)
    rates: Matrix = slope - c * cross_rate + d * np.cross(phi, cross_rate)
    return rates


def _factors(angle: Vector) -> tuple[Vector, Vector]:
    """Return c and d of the equation above."""
    small = angle < _SMALL
    a = np.where(small, 1.0, angle)
    c = np.where(small, 0.5 - angle**2 / 24.0, 2.0 * (np.sin(0.5 * a) / a) ** 2)
    d = np.where(small, 1.0 / 6.0 - angle**2 / 120.0, (a - np.sin(a)) / a**3)
    return c, d


def _derivatives(phi: Vector, knot: Knot) -> Matrix:
    """Return phi, phi' and phi'' with which a knot is passed, shape (3, 3).

    With J(phi) = 1 - c phi x + d (phi x)^2: w = J phi', and w' = J phi'' + J' phi', of which
    J' phi' = -c' phi x phi' + d' phi x (phi x phi') + d phi' x (phi x phi').
    """
    assert knot.rate is not None
    assert knot.acceleration is not None
    angle = float(np.linalg.norm(phi))
    c, d = (float(factor[0]) for factor in _factors(np.array([angle])))
    cross = skew(phi)
    jacobian = np.eye(3) - c * cross + d * cross @ cross
    slope = np.linalg.solve(jacobian, knot.rate)
    along = float(phi @ slope)  # angle times its derivative
    if angle < _SMALL:
        c_slope, d_slope = -along / 12.0, -along / 60.0
    else:
        c_slope = along * (1.0 - angle**2 * d - 2.0 * c) / angle**2
        d_slope = along * (c - 3.0 * d) / angle**2
    cross_rate = np.cross(phi, slope)
    rate_term = (
        -c_slope * cross_rate
        + d_slope * np.cross(phi, cross_rate)
        + d * np.cross(slope, cross_rate)
    )
    return np.array([phi, slope, np.linalg.solve(jacobian, knot.acceleration - rate_term)])
