"""Control moment gyros with one gimbal: a torque by gimbal rates, past their singularities."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from flexslew_control.allocation.room import add_null_motion, scale_to
from flexslew_plant.arrays import Matrix, Tensor, Vector, compiled_once
from flexslew_plant.errors import BadInput

_NEAR = 10.0  # how fast the regularisation fades with det(A A^T), away from singularities [-]
_PHASES = np.array([0.0, 0.5 * np.pi, np.pi])  # of the dither about x, y, z


class GyroNumbers(NamedTuple):
    """Sets of gyros side by side for machine code, a row each; none: no gyros."""

    gimbals: Tensor  # (members, gyros, 2, 3)
    limit: Matrix  # (members, gyros) [N m]
    momentum: Matrix  # (members, gyros) [N m s]
    chosen: Matrix  # l_0, e, w [rad/s] and k [1/s], (members, 4)
    preferred: Matrix  # p, (members, gyros) [rad]


NO_GYROS = GyroNumbers(
    np.zeros((1, 0, 2, 3)), np.zeros((1, 0)), np.zeros((1, 0)), np.zeros((1, 4)), np.zeros((1, 0))
)


@dataclass(frozen=True)
class GyroSet:
    """u = H A^T (A A^T + l E)^-1 T + H k (1 - A^+ A) (p - d), the generalised robust inverse.

    A (d) has what a unit rate of each gimbal gives at its angle, in units of the mean momentum;
    H are the momenta in those units, p the angles that null motion prefers. With E = 1 the inverse
    fails where the required torque is along the singular direction: no rate gives it,
    and the gimbals lock. So E has dithered entries off its diagonal (Wie, Bailey and Heiberg 2001):
    E_ij = e sin(w t + phase), l = l_0 exp(-10 det A A^T).

    Args:
        gimbals: axes g and rotors s at angle zero, in body axes, shape (gyros, 2, 3).
        limit: largest efforts, shape (gyros,) [N m].
        momentum: momenta of the rotors, shape (gyros,) [N m s].
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
        if np.linalg.matrix_rank(self.torque_matrix(np.zeros(self.limit.size)), tol=1e-6) < 3:
            words = "with gimbals at zero their torques lie in a plane; turn a rotor"
            raise BadInput(words, key="allocation.drives")

    @cached_property
    def numbers(self) -> GyroNumbers:
        """The set for machine code, in a batch of one."""
        parameters = np.array([self.robustness, self.dither, self.frequency, self.gain])
        values = self.gimbals, self.limit, self.momentum, parameters, self.preferred
        return GyroNumbers(*(np.ascontiguousarray(part)[None] for part in values))

    def torque_matrix(self, angles: Vector) -> Matrix:
        """Return A at these angles of the gimbals, shape (3, gyros) [-]."""
        found = np.empty((3, self.limit.size))
        _write_torque_matrix(self.numbers, 0, angles, found)
        return found

    def efforts(self, torque: Vector, angles: Vector, time: float) -> Vector:
        """Return the efforts that give a torque, scaled where one is beyond its limit.

        Args:
            torque: on the platform, in body axes, shape (3,) [N m].
            angles: of the gimbals, shape (gyros,) [rad].
            time: of the dither [s].

        Returns:
            shape (gyros,) [N m].
        """
        out = np.empty(self.limit.size)
        gyro_efforts(self.numbers, 0, torque, angles, time, out)
        return out


@compiled_once("levers")
def _write_torque_matrix(gyros: GyroNumbers, member: int, angles: Vector, levers: Matrix) -> None:
    mean = gyros.momentum[member].mean()
    for k in range(angles.size):
        size = gyros.momentum[member, k] / mean
        cosine, sine = np.cos(angles[k]), np.sin(angles[k])
        for i in range(3):
            j, n = (i + 1) % 3, (i + 2) % 3
            axis, rotor = gyros.gimbals[member, k, 0], gyros.gimbals[member, k, 1]
            cross = axis[j] * rotor[n] - axis[n] * rotor[j]
            levers[i, k] = size * (cosine * cross - sine * rotor[i])


@compiled_once("out")
def gyro_efforts(
    gyros: GyroNumbers, member: int, torque: Vector, angles: Vector, time: float, out: Vector
) -> None:
    """Write the efforts of a set of gyros; see GyroSet.efforts.

    Args:
        gyros: of some members.
        member: which of them counts.
        torque: shape (3,).
        angles: shape (gyros,).
        time: [s].
        out: shape (gyros,).
    """
    count, momentum = out.size, gyros.momentum[member]
    parameters = gyros.chosen[member]
    robustness, dither, frequency, gain = parameters[0], parameters[1], parameters[2], parameters[3]
    levers = np.empty((3, count))
    _write_torque_matrix(gyros, member, angles, levers)
    square = levers @ levers.T
    near = robustness * np.exp(-_NEAR * np.linalg.det(square))
    x, y, z = dither * np.sin(frequency * time + _PHASES)
    regularization = near * np.array([[1.0, z, y], [z, 1.0, x], [y, x, 1.0]])
    rates = levers.T @ (np.linalg.pinv(square + regularization) @ torque)
    for k in range(count):
        out[k] = momentum[k] / momentum.mean() * rates[k]
    scale_to(gyros.limit, member, out)
    if gain == 0.0:
        return
    null_rates = gain * (gyros.preferred[member] - angles)
    # a positive effort turns its gimbal back
    values = -momentum * (null_rates - np.linalg.pinv(levers) @ (levers @ null_rates))
    add_null_motion(gyros.limit, member, out, values)
