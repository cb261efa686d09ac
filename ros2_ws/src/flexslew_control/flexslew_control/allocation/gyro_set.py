"""Control moment gyros with one gimbal: a torque by gimbal rates, past their singularities."""

from dataclasses import dataclass

import numpy as np

from flexslew_control.allocation.room import scaled_to, with_null_motion
from flexslew_plant.arrays import Matrix, Tensor, Vector
from flexslew_plant.errors import BadInput

_NEAR = 10.0  # how fast the regularisation fades with det(A A^T), away from singularities [-]
_PHASES = np.array([0.0, 0.5 * np.pi, np.pi])  # of the dither about x, y, z


@dataclass(frozen=True)
class GyroSet:
    """u = H A^T (A A^T + l E)^-1 T + H k (1 - A^+ A) (p - d), the generalised robust inverse.

    A (d) has what a unit rate of each gimbal gives at its angle, in units of the mean momentum;
    H are the momenta in those units, p the angles that null motion prefers. With E = 1 the inverse
    fails where the torque that is asked for is along the singular direction: no rate answers it,
    and the gimbals lock. So E has dithered entries off its diagonal (Wie, Bailey and Heiberg 2001):
    E_ij = e sin(w t + phase), l = l_0 exp(-10 det A A^T).

    Args:
        gimbals: axes g and rotors s at angle zero, in body axes, shape (gyros, 2, 3).
        limit: largest efforts, shape (gyros,) [N m].
        momentum: of the rotors, shape (gyros,) [N m s].
        robustness: l_0 [-].
        dither: e [-].
        frequency: w [rad/s].
        gain: k [1/s].
        preferred: p, shape (gyros,) [rad].
    """

    gimbals: Tensor
    limit: Vector
    momentum: Vector
    robustness: float
    dither: float
    frequency: float
    gain: float
    preferred: Vector

    def __post_init__(self) -> None:
        """Check that they turn a craft about every axis.

        Raises:
            BadInput: with gimbals at zero they do not.
        """
        if np.linalg.matrix_rank(self.levers(np.zeros(self.limit.size)), tol=1e-6) < 3:
            words = "with gimbals at zero their torques lie in a plane; turn a rotor"
            raise BadInput(words, key="allocation.drives")

    def levers(self, angles: Vector) -> Matrix:
        """Return A at these angles of the gimbals, shape (3, gyros) [-]."""
        axes, rotors = self.gimbals[:, 0], self.gimbals[:, 1]
        across = np.cos(angles)[:, None] * np.cross(axes, rotors) - np.sin(angles)[:, None] * rotors
        return np.asarray((across * (self.momentum / self.momentum.mean())[:, None]).T)

    def efforts(self, torque: Vector, angles: Vector, time: float) -> Vector:
        """Return the efforts that give a torque, scaled where one is beyond its limit.

        Args:
            torque: on the platform, in body axes, shape (3,) [N m].
            angles: of the gimbals, shape (gyros,) [rad].
            time: of the dither [s].

        Returns:
            shape (gyros,) [N m].
        """
        levers, sizes = self.levers(angles), self.momentum / self.momentum.mean()
        square = levers @ levers.T
        near = self.robustness * np.exp(-_NEAR * np.linalg.det(square))
        x, y, z = self.dither * np.sin(self.frequency * time + _PHASES)
        blend = near * np.array([[1.0, z, y], [z, 1.0, x], [y, x, 1.0]])
        first = sizes * (levers.T @ np.linalg.pinv(square + blend) @ torque)
        first = scaled_to(self.limit, np.asarray(first))
        if self.gain == 0.0:
            return first
        away = self.gain * (self.preferred - angles)
        # a positive effort turns its gimbal back
        own = -self.momentum * (away - np.linalg.pinv(levers) @ (levers @ away))
        return with_null_motion(self.limit, first, own)
