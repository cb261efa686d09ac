"""The gyroscopic torque of a turning craft as efforts of its joints."""

from dataclasses import dataclass

import numpy as np

from flexslew_plant.arrays import Matrix, Tensor, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import Testbed
from flexslew_plant.testbeds.contract import ThreeAxes
from flexslew_plant.testbeds.orientation.attitude import AttitudeJoints


@dataclass(frozen=True)
class Gyroscopic:
    """w x J w of the rigid craft, shared out over its joints.

    With it a PD on the rotation error, with multiples of J as gains, turns a rigid craft about its
    eigenaxis, from any attitude to any other (Wie, Weiss and Arapostathis 1989).

    Args:
        attitude: the joints that measure the rates.
        quadratic: efforts w^T Q_j w, shape (joints, 3, 3) [N m s^2].
    """

    attitude: AttitudeJoints
    quadratic: Tensor

    def efforts(self, rates: Vector) -> Vector:
        """Return the efforts at some rates of the joints, both of shape (joints,)."""
        w = self.attitude.rotation_vector_of(rates)
        return np.asarray(self.quadratic @ w @ w)

    def along(self, rates: Matrix) -> Matrix:
        """Return the efforts at many rates, both of shape (ticks, joints)."""
        w = self.attitude.rotation_vector_of(rates)
        efforts: Matrix = np.einsum("jab,ka,kb->kj", self.quadratic, w, w)
        return efforts

    def of_products(self, joints: int) -> Matrix:
        """Return Q of efforts Q (r x r) at rates r, r x r in rows: (joints, joints^2)."""
        rotation = self.attitude.rotation_vector_of(np.eye(joints))
        found = np.einsum("jab,pa,qb->jpq", self.quadratic, rotation, rotation)
        return np.ascontiguousarray(found.reshape(joints, joints**2))

    def limit_excess(self, rates: Vector, reference: Vector) -> Vector:
        """Return the efforts at some rates beyond those of a reference, which its plan carries."""
        return self.efforts(rates) - self.efforts(reference)


def gyroscopic(testbed: Testbed, key: str) -> Gyroscopic:
    """Return the gyroscopic efforts of a testbed; wheels alone, which leave no momentum, need none.

    Args:
        testbed: testbed on the bench.
        key: key that requires the efforts, for the error.

    Raises:
        BadInput: if its joints do not turn it in three axes.
    """
    attitude = testbed.model().attitude
    if attitude is None or not isinstance(testbed, ThreeAxes):
        raise BadInput("the joints of this testbed do not turn it in three axes", key=key)

    def along(axis: Vector) -> Vector:
        size = np.linalg.norm(axis)
        return np.asarray(size**2 * testbed.rigid_turn_about(axis / size).centrifugal)

    axes = np.eye(3)
    squares = [along(axis) for axis in axes]
    quadratic = np.empty((len(attitude.axes), 3, 3))
    for i in range(3):
        quadratic[:, i, i] = squares[i]
        for k in range(i):
            cross_term = along(axes[i] + axes[k]) - squares[i] - squares[k]
            quadratic[:, i, k] = quadratic[:, k, i] = 0.5 * cross_term
    return Gyroscopic(attitude, quadratic)
