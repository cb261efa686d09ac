"""Testbeds with axes that point into the sky, and the cones that they keep out of."""

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.orientation.attitude import cross, to_inertial


class Cone(NamedTuple):
    """A cone in the sky, and the axis of the platform that must not look into it."""

    name: str
    boresight: Vector  # in body axes, a unit vector, (3,)
    axis: Vector  # in inertial space, a unit vector, (3,)
    half_angle: float  # [rad]

    def margin(self, attitude: Matrix) -> Vector:
        """Return the angle by which the boresight stays outside; negative: inside, (...) [rad].

        Args:
            attitude: quaternions x y z w from inertial to body axes, shape (..., 4).
        """
        direction = to_inertial(attitude, self.boresight)
        sine = np.linalg.norm(cross(direction, self.axis), axis=-1)
        angle: Vector = np.arctan2(sine, direction @ self.axis)
        return angle - self.half_angle


class Sky(NamedTuple):
    """The axes of a platform that point into the sky, and the cones around directions in it.

    Args:
        boresights: unit vectors in body axes, by name.
        cones: cones that they must keep out of.
    """

    boresights: dict[str, Vector]
    cones: tuple[Cone, ...]


@runtime_checkable
class HasSky(Protocol):
    """A testbed with axes that look somewhere in inertial space."""

    def sky(self) -> Sky | None:
        """Return its axes and cones; None: its platform is not free."""

    def attitudes(self, position: Matrix) -> Matrix:
        """Return the quaternions of positions q, shape (k, positions), as shape (k, 4)."""
