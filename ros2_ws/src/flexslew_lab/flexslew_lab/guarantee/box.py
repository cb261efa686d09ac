"""A box of uncertain parameters, in their own units."""

from dataclasses import dataclass, replace

import numpy as np

from flexslew_plant.arrays import Matrix, Vector


@dataclass(frozen=True)
class Box:
    """All values between two corners: p = centre + radius delta with |delta_i| <= 1.

    Args:
        centre: shape (m,).
        radius: half of each side, shape (m,).
    """

    centre: Vector
    radius: Vector

    def at(self, delta: Vector) -> Vector:
        """Return the values at normalised coordinates, both of shape (..., m)."""
        return np.asarray(self.centre + self.radius * delta)

    def scaled(self, factor: float) -> "Box":
        """Return a box about the same centre, its sides times a factor [-]."""
        return replace(self, radius=self.radius * factor)


def halves(centre: Vector, radius: Vector, axis: int) -> list[tuple[Vector, Vector]]:
    """Return the centres and radii of both halves of a box, divided across an axis."""
    one = np.eye(len(centre))[axis] * radius
    return [(centre + side * one, radius - 0.5 * one) for side in (-0.5, 0.5)]


def corners(count: int) -> Matrix:
    """Return the corners of the normalised box, shape (2^count, count)."""
    bits = np.arange(2**count)[:, None] >> np.arange(count) & 1
    return np.asarray(2.0 * bits - 1.0, dtype=np.float64)


def corners_and_inner(
    count: int, most_corners: int, inner: int, rng: np.random.Generator
) -> Matrix:
    """Return corners of the normalised box, then random points within, shape (k, count).

    Args:
        count: number of parameters.
        most_corners: more are replaced by a random choice of so many.
        inner: number of random points.
        rng: of both.
    """
    outer = corners(count)
    if len(outer) > most_corners:
        outer = outer[rng.choice(len(outer), most_corners, replace=False)]
    return np.vstack((outer, rng.uniform(-1.0, 1.0, (inner, count))))
