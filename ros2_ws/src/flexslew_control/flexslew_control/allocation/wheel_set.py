"""Reaction wheels, any number: a torque by the pseudo-inverse, and null motion on top."""

from dataclasses import dataclass, field

import numpy as np

from flexslew_control.allocation.room import scaled_to, with_null_motion
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput


@dataclass(frozen=True)
class WheelSet:
    """u = A^+ T + k P (h - b), P = 1 - A^+ A, with A the axes and h = I s the wheels' momenta.

    The second part turns no platform: it brings the part of the momenta that stores nothing to
    that of the bias b, with which wheels evade saturation (b = 0: the least momenta that store as
    much) and stay away from zero. It has what the first part leaves of the limits.

    Args:
        torque: A, shape (3, wheels).
        limit: of the motors, shape (wheels,) [N m].
        inertia: I, shape (wheels,) [kg m^2].
        gain: k [1/s].
        bias: b, shape (wheels,) [N m s].
    """

    torque: Matrix
    limit: Vector
    inertia: Vector
    gain: float
    bias: Vector
    _inverse: Matrix = field(init=False)
    _null: Matrix = field(init=False)

    def __post_init__(self) -> None:
        """Prepare the inverses.

        Raises:
            BadInput: the axes lie in a plane.
        """
        if np.linalg.matrix_rank(self.torque, tol=1e-6) < 3:
            raise BadInput("the axes of the wheels lie in a plane", key="allocation.drives")
        inverse = np.asarray(np.linalg.pinv(self.torque))
        object.__setattr__(self, "_inverse", inverse)
        object.__setattr__(self, "_null", np.eye(self.limit.size) - inverse @ self.torque)

    def stored(self, speeds: Vector) -> Vector:
        """Return the momentum that spins of these speeds [rad/s] store, shape (3,) [N m s]."""
        return np.asarray(self.torque @ (self.inertia * speeds))

    def efforts(self, torque: Vector, speeds: Vector | None) -> Vector:
        """Return the motors' efforts that give a torque, scaled where one is beyond its limit.

        Args:
            torque: on the platform, shape (3,) [N m].
            speeds: of the wheels, shape (wheels,) [rad/s]; None: nobody tells, and there is no
                null motion.

        Returns:
            shape (wheels,) [N m].
        """
        first = scaled_to(self.limit, np.asarray(self._inverse @ torque))
        if speeds is None or self.gain == 0.0:
            return first
        own = self.gain * (self._null @ (self.inertia * speeds - self.bias))
        return with_null_motion(self.limit, first, own)
