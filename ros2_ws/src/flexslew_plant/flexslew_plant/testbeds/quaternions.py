"""Unit quaternions x y z w, number by number: what compiled code and `attitude` compute with."""

from math import atan2, cos, sin, sqrt
from typing import TypeAlias

from flexslew_plant.arrays import called

Turn: TypeAlias = tuple[float, float, float]  # rotation vector [rad]
Quaternion: TypeAlias = tuple[float, float, float, float]


@called
def of_turn(x: float, y: float, z: float) -> Quaternion:
    """Return the quaternion of a rotation vector [rad]."""
    angle = sqrt(x * x + y * y + z * z)
    half = sin(0.5 * angle) / angle if angle > 0.0 else 0.5
    return half * x, half * y, half * z, cos(0.5 * angle)


@called
def turn_of(q: Quaternion) -> Turn:
    """Return the rotation vector of a quaternion, the shorter way round [rad]."""
    sign = -1.0 if q[3] < 0.0 else 1.0
    x, y, z, w = sign * q[0], sign * q[1], sign * q[2], sign * q[3]
    size = sqrt(x * x + y * y + z * z)
    ratio = 2.0 * atan2(size, w) / size if size > 0.0 else 2.0
    return ratio * x, ratio * y, ratio * z


@called
def multiplied(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the quaternion of the turn a and then b about the turned axes."""
    return (
        a[3] * b[0] + b[3] * a[0] + a[1] * b[2] - a[2] * b[1],
        a[3] * b[1] + b[3] * a[1] + a[2] * b[0] - a[0] * b[2],
        a[3] * b[2] + b[3] * a[2] + a[0] * b[1] - a[1] * b[0],
        a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
    )
