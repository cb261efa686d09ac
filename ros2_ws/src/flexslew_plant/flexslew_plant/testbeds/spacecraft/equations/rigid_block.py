"""Rigid bodies in the mass matrix: a point mass, a first moment, an inertia."""

from flexslew_plant.arrays import Matrix, Vector, called
from flexslew_plant.testbeds.spacecraft.equations.geometry import (
    Matrix3,
    Triple,
    apply_transposed,
    dot,
    symmetric,
)


@called
def add_point_mass_row(
    mass: Matrix, s: Triple, j: tuple[float, float, float, float, float, float], m: float
) -> None:
    """Add the rigid block [m, -s~; s~, J] to the platform's rows."""
    mass[0, 0] += m
    mass[1, 1] += m
    mass[2, 2] += m
    mass[0, 4] += s[2]
    mass[0, 5] -= s[1]
    mass[1, 3] -= s[2]
    mass[1, 5] += s[0]
    mass[2, 3] += s[1]
    mass[2, 4] -= s[0]
    mass[3, 3] += j[0]
    mass[4, 4] += j[1]
    mass[5, 5] += j[2]
    mass[3, 4] += j[3]
    mass[3, 5] += j[4]
    mass[4, 5] += j[5]


@called
def put(a: Vector, i: int, f: Triple) -> None:
    """Add f to three numbers of a."""
    a[i] += f[0]
    a[i + 1] += f[1]
    a[i + 2] += f[2]


@called
def inertia_at_origin(
    e: Matrix3,
    j: tuple[float, float, float, float, float, float],
    s: Triple,
    r: Triple,
    m: float,
) -> tuple[float, float, float, float, float, float]:
    """Return E^T J E + m (r.r 1 - r r^T) + 2 r.s 1 - r s^T - s r^T: inertia about the body origin.

    Args:
        e: direction cosines, body to appendage.
        j: inertia about the hinge in appendage axes.
        s: first moment about the hinge in body axes.
        r: place of the hinge.
        m: mass.
    """
    x = apply_transposed(e, symmetric(j, (e[0], e[3], e[6])))
    y = apply_transposed(e, symmetric(j, (e[1], e[4], e[7])))
    z = apply_transposed(e, symmetric(j, (e[2], e[5], e[8])))
    diagonal = m * dot(r, r) + 2.0 * dot(r, s)
    return (
        x[0] + diagonal - m * r[0] * r[0] - 2.0 * r[0] * s[0],
        y[1] + diagonal - m * r[1] * r[1] - 2.0 * r[1] * s[1],
        z[2] + diagonal - m * r[2] * r[2] - 2.0 * r[2] * s[2],
        y[0] - m * r[0] * r[1] - r[0] * s[1] - s[0] * r[1],
        z[0] - m * r[0] * r[2] - r[0] * s[2] - s[0] * r[2],
        z[1] - m * r[1] * r[2] - r[1] * s[2] - s[1] * r[2],
    )
