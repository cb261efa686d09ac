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


def corners(count: int) -> Matrix:
    """Return the corners of the normalised box, shape (2^count, count)."""
    bits = np.arange(2**count)[:, None] >> np.arange(count) & 1
    return np.asarray(2.0 * bits - 1.0, dtype=np.float64)
