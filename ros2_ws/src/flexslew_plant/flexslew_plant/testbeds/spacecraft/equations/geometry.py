"""Vectors and rotations for compiled kernels: three numbers in a tuple, nine row by row."""

from collections.abc import Sequence
from typing import TypeAlias

from flexslew_plant.arrays import Vector, called

Triple: TypeAlias = tuple[float, float, float]
Matrix3: TypeAlias = tuple[float, float, float, float, float, float, float, float, float]


@called
def cross(a: Triple, b: Triple) -> Triple:
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@called
def dot(a: Triple, b: Triple) -> float:
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@called
def plus(a: Triple, b: Triple) -> Triple:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@called
def scaled(s: float, a: Triple) -> Triple:
    """Return s a."""
    return s * a[0], s * a[1], s * a[2]


@called
def triple(p: Vector, at: int) -> Triple:
    """Return the three numbers of p from `at` on."""
    return p[at], p[at + 1], p[at + 2]


@called
def read_matrix3(p: Vector, at: int) -> Matrix3:
    """Return the nine numbers of p from `at` on: a matrix, row by row."""
    return (
        p[at],
        p[at + 1],
        p[at + 2],
        p[at + 3],
        p[at + 4],
        p[at + 5],
        p[at + 6],
        p[at + 7],
        p[at + 8],
    )


@called
def apply(e: Matrix3, a: Triple) -> Triple:
    """Return E a."""
    return (
        e[0] * a[0] + e[1] * a[1] + e[2] * a[2],
        e[3] * a[0] + e[4] * a[1] + e[5] * a[2],
        e[6] * a[0] + e[7] * a[1] + e[8] * a[2],
    )


@called
def apply_transposed(e: Matrix3, a: Triple) -> Triple:
    """Return E^T a."""
    return (
        e[0] * a[0] + e[3] * a[1] + e[6] * a[2],
        e[1] * a[0] + e[4] * a[1] + e[7] * a[2],
        e[2] * a[0] + e[5] * a[1] + e[8] * a[2],
    )


@called
def symmetric(j: Sequence[float] | Vector, a: Triple) -> Triple:
    """Return J a for a symmetric J given as (xx, yy, zz, xy, xz, yz)."""
    return (
        j[0] * a[0] + j[3] * a[1] + j[4] * a[2],
        j[3] * a[0] + j[1] * a[1] + j[5] * a[2],
        j[4] * a[0] + j[5] * a[1] + j[2] * a[2],
    )


@called
def rotation(x: float, y: float, z: float, w: float) -> Matrix3:
    """Return the rotation from inertial axes to those that a unit quaternion has turned."""
    return (
        w * w + x * x - y * y - z * z,
        2.0 * (x * y + z * w),
        2.0 * (x * z - y * w),
        2.0 * (x * y - z * w),
        w * w - x * x + y * y - z * z,
        2.0 * (y * z + x * w),
        2.0 * (x * z + y * w),
        2.0 * (y * z - x * w),
        w * w - x * x - y * y + z * z,
    )


@called
def rotate_frame(axis: Triple, c: float, s: float, e: Matrix3) -> Matrix3:
    """Return Rot(axis, -angle) E: the direction cosines after a turn about axis (both frames').

    Args:
        axis: unit vector.
        c, s: cosine and sine of the angle.
        e: direction cosines before the turn.
    """
    x, y, z = axis
    d = 1.0 - c
    r = (
        c + d * x * x,
        d * x * y + s * z,
        d * x * z - s * y,
        d * x * y - s * z,
        c + d * y * y,
        d * y * z + s * x,
        d * x * z + s * y,
        d * y * z - s * x,
        c + d * z * z,
    )
    return (
        r[0] * e[0] + r[1] * e[3] + r[2] * e[6],
        r[0] * e[1] + r[1] * e[4] + r[2] * e[7],
        r[0] * e[2] + r[1] * e[5] + r[2] * e[8],
        r[3] * e[0] + r[4] * e[3] + r[5] * e[6],
        r[3] * e[1] + r[4] * e[4] + r[5] * e[7],
        r[3] * e[2] + r[4] * e[5] + r[5] * e[8],
        r[6] * e[0] + r[7] * e[3] + r[8] * e[6],
        r[6] * e[1] + r[7] * e[4] + r[8] * e[7],
        r[6] * e[2] + r[7] * e[5] + r[8] * e[8],
    )
