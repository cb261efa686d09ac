"""Rigid bodies, directions and axes of a trial file in SI, checked."""

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.orientation.attitude import skew
from flexslew_plant.testbeds.spacecraft.settings import (
    Body,
    Inertia,
    Rows,
    Triple,
)
from flexslew_plant.testbeds.spacecraft.shapes.integrals import point_inertia
from flexslew_plant.testbeds.spacecraft.units import Units


def require_physical(mass: float, first: Vector, inertia: Matrix, key: str) -> None:
    """Check that a mass, first moment and inertia are those of a body.

    Args:
        mass: [kg].
        first: about the origin, shape (3,) [kg m].
        inertia: about the origin, shape (3, 3) [kg m^2].
        key: of the settings, for the message.

    Raises:
        BadInput: the mass is not positive or the inertia about the centre of mass violates the
            triangle inequality.
    """
    if not mass > 0.0:
        raise BadInput(f"{key}: mass {mass:g} kg is not positive")
    a, b, c = np.linalg.eigvalsh(inertia - mass * point_inertia(first / mass))
    rounding = 1e-12 * abs(inertia).max()  # of a point mass, which has no inertia of its own
    if a < -1e-9 * abs(c) - rounding or a + b < c * (1.0 - 1e-5) - rounding:
        raise BadInput(
            f"{key}: principal inertias {a:.6g}, {b:.6g}, {c:.6g} kg m^2 about the centre of mass "
            f"violate the triangle inequality: {a:.6g} + {b:.6g} < {c:.6g}"
        )


def matrix_of(i: Inertia) -> Matrix:
    """Return the entries as a matrix, shape (3, 3)."""
    return np.array([[i.xx, i.xy, i.xz], [i.xy, i.yy, i.yz], [i.xz, i.yz, i.zz]])


def rigid_body(body: Body, units: Units, key: str) -> tuple[float, Vector, Matrix]:
    """Return mass, first moment and inertia about the origin, in SI and checked."""
    mass, inertia = body.mass * units.mass, matrix_of(body.inertia) * units.torque
    first = mass * np.array(body.centre) * units.length
    require_physical(mass, first, inertia, key)
    return mass, first, inertia


def unit_direction(direction: Triple, key: str) -> Vector:
    """Return a direction of length one, shape (3,); refused if it has none."""
    vector = np.array(direction, dtype=float)
    finite = abs(vector).max() < 1e150  # its square
    size = float(np.linalg.norm(vector)) if finite else 0.0
    if size < 1e-9:
        raise BadInput(f"{key}: {list(direction)} has no direction")
    return vector / size


def orthonormal(rows: Rows, key: str) -> Matrix:
    """Return direction cosines, refused unless orthonormal and right-handed."""
    e = np.array(rows, dtype=float)
    off = float(abs(e @ e.T - np.eye(3)).max())
    if off > 1e-6 or np.linalg.det(e) < 0.0:
        hand = "left-handed" if off <= 1e-6 else f"off by {off:.3g}"
        raise BadInput(f"{key}: {e.tolist()} is not orthonormal and right-handed: {hand}")
    return e


def rotation_matrix(axis: Vector, angle: float) -> Matrix:
    """Return the direction cosines of a frame turned by angle about axis, shape (3, 3)."""
    across = skew(axis)
    cosines: Matrix = np.eye(3) - np.sin(angle) * across + (1.0 - np.cos(angle)) * across @ across
    return cosines
