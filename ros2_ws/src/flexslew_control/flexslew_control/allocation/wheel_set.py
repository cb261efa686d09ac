"""Reaction wheels, any number: a torque by the pseudo-inverse, and null motion on top."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from flexslew_control.allocation.room import add_null_motion, scale_to
from flexslew_plant.arrays import EMPTY, Matrix, Tensor, Vector, compiled_once
from flexslew_plant.errors import BadInput


class WheelNumbers(NamedTuple):
    """Sets of wheels side by side for machine code, a row each; none: no wheels."""

    torque: Tensor  # A, (members, 3, wheels)
    inverse: Tensor  # A^+, (members, wheels, 3)
    null: Tensor  # k P, (members, wheels, wheels) [1/s]
    limit: Matrix  # (members, wheels) [N m]
    inertia: Matrix  # I, (members, wheels) [kg m^2]
    bias: Matrix  # b, (members, wheels) [N m s]


NO_WHEELS = WheelNumbers(
    np.zeros((1, 3, 0)),
    np.zeros((1, 0, 3)),
    np.zeros((1, 0, 0)),
    *(np.zeros((1, 0)) for _ in range(3)),
)


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

    def __post_init__(self) -> None:
        """Check that they turn a craft about every axis.

        Raises:
            BadInput: the axes lie in a plane.
        """
        if np.linalg.matrix_rank(self.torque, tol=1e-6) < 3:
            raise BadInput("the axes of the wheels lie in a plane", key="allocation.drives")

    @cached_property
    def numbers(self) -> WheelNumbers:
        """The set for machine code, in a batch of one."""
        inverse = np.asarray(np.linalg.pinv(self.torque))
        null = self.gain * (np.eye(self.limit.size) - inverse @ self.torque)
        values = self.torque, inverse, null, self.limit, self.inertia, self.bias
        return WheelNumbers(*(np.ascontiguousarray(part)[None] for part in values))

    def stored(self, speeds: Vector) -> Vector:
        """Return the momentum that spins of these speeds [rad/s] store, shape (3,) [N m s]."""
        return np.asarray(self.torque @ (self.inertia * speeds))

    def efforts(self, torque: Vector, speeds: Vector | None) -> Vector:
        """Return the motors' efforts that give a torque, scaled where one is beyond its limit.

        Args:
            torque: torque on the platform, shape (3,) [N m].
            speeds: wheel speeds, shape (wheels,) [rad/s]; None: not measured, and there is no null
                motion.

        Returns:
            shape (wheels,) [N m].
        """
        out = np.empty(self.limit.size)
        wheel_efforts(self.numbers, 0, torque, EMPTY if speeds is None else speeds, out)
        return out


@compiled_once("out")
def wheel_efforts(
    wheels: WheelNumbers, member: int, torque: Vector, speeds: Vector, out: Vector
) -> None:
    """Write the efforts of a set of wheels; see WheelSet.efforts.

    Args:
        wheels: data of some members.
        member: index of the member.
        torque: shape (3,).
        speeds: shape (wheels,); empty: not measured.
        out: shape (wheels,).
    """
    count = out.size
    for i in range(count):
        out[i] = 0.0
        for j in range(3):
            out[i] += wheels.inverse[member, i, j] * torque[j]
    scale_to(wheels.limit, member, out)
    if speeds.size == 0:
        return
    null = np.zeros(count)
    for i in range(count):
        for j in range(count):
            excess = wheels.inertia[member, j] * speeds[j] - wheels.bias[member, j]
            null[i] += wheels.null[member, i, j] * excess
    add_null_motion(wheels.limit, member, out, null)
