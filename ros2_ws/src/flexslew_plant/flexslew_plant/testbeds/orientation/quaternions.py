"""Unit quaternions x y z w, number by number: what compiled code and `attitude` compute with."""

from math import atan2, cos, pi, sin, sqrt
from typing import TypeAlias

from flexslew_plant.arrays import called

RotationVector: TypeAlias = tuple[float, float, float]  # rotation vector [rad]
Quaternion: TypeAlias = tuple[float, float, float, float]


@called
def quaternion_of(x: float, y: float, z: float) -> Quaternion:
    """Return the quaternion of a rotation vector [rad]."""
    angle = sqrt(x * x + y * y + z * z)
    half = sin(0.5 * angle) / angle if angle > 0.0 else 0.5
    return half * x, half * y, half * z, cos(0.5 * angle)


@called
def rotation_vector_of(q: Quaternion) -> RotationVector:
    """Return the rotation vector of a quaternion, the shorter way round [rad]."""
    sign = -1.0 if q[3] < 0.0 else 1.0
    x, y, z, w = sign * q[0], sign * q[1], sign * q[2], sign * q[3]
    size = sqrt(x * x + y * y + z * z)
    ratio = 2.0 * atan2(size, w) / size if size > 0.0 else 2.0
    return ratio * x, ratio * y, ratio * z


@called
def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the quaternion of the turn a and then b about the turned axes."""
    return (
        a[3] * b[0] + b[3] * a[0] + a[1] * b[2] - a[2] * b[1],
        a[3] * b[1] + b[3] * a[1] + a[2] * b[0] - a[0] * b[2],
        a[3] * b[2] + b[3] * a[2] + a[0] * b[1] - a[1] * b[0],
        a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
    )


@called
def to_body_axes(q: Quaternion, x: float, y: float, z: float) -> RotationVector:
    """Return a vector given along inertial axes, along those that q has turned."""
    a, b, c, w = q
    scale, along = w * w - a * a - b * b - c * c, a * x + b * y + c * z
    return (
        scale * x + 2.0 * (along * a - w * (b * z - c * y)),
        scale * y + 2.0 * (along * b - w * (c * x - a * z)),
        scale * z + 2.0 * (along * c - w * (a * y - b * x)),
    )


@called
def way(a: RotationVector, b: RotationVector) -> tuple[bool, RotationVector]:
    """Return whether b - a is the way from one rotation vector to another, and the way [rad].

    It is where both are about one axis and the way is no longer than half a turn; else the way is
    the rotation between them.
    """
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    same_axis = a[1] * b[2] == a[2] * b[1] and a[2] * b[0] == a[0] * b[2]
    same_axis = same_axis and a[0] * b[1] == a[1] * b[0]
    if same_axis and sqrt(x**2 + y**2 + z**2) <= pi:
        return True, (x, y, z)
    return False, rotation_vector_of(
        multiply(quaternion_of(-a[0], -a[1], -a[2]), quaternion_of(b[0], b[1], b[2]))
    )
