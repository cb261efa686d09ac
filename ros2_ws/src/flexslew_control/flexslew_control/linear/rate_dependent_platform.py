"""The small motions of a craft about a plan that turns it: their matrices depend on its rates.

About rates w of the joints the deviation (e, e') of joints and modes from the plan follows
    (e, e')' = A(w) (e, e') + B (u - u_d), A(w) = A_0 + sum_i w_i A_i + sum_ij w_i w_j A_ij,
with e of the attitude a rotation in body axes, so that e' = v - w x e, and with the gyroscopic and
centrifugal terms of w; both are exact, as the equations of motion are quadratic in the rates. Where
wheels turn the craft they store the momentum that it has, as from rest.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.linalg import block_diag

from flexslew_control.linear.free_platform import (
    JointCoordinates,
    LinearModel,
    joint_coordinates,
    reduced_model,
)
from flexslew_plant.arrays import Matrix, Tensor, Vector
from flexslew_plant.testbeds.model import Model

_STEP = 0.1  # rates at which the terms are taken [rad/s]


@dataclass(frozen=True)
class RateDependentPlatform:
    """The small motions of a free platform about any rates of its joints.

    Args:
        small: about rest, n coordinates.
        linear: A_i, shape (joints, 2 n, 2 n).
        quadratic: A_ij, shape (joints, joints, 2 n, 2 n).
    """

    small: LinearModel
    linear: Tensor
    quadratic: Tensor

    @property
    def input_matrix(self) -> Matrix:
        """B, shape (2 n, joints)."""
        return self.small.linear.state_input_matrix

    def state_matrix(self, rates: Vector) -> Matrix:
        """Return A about these rates of the joints [rad/s or m/s], shape (2 n, 2 n)."""
        if not rates.any():
            return self.small.linear.state_matrix
        by_rate = self.linear + np.tensordot(rates, self.quadratic, axes=1)
        at_rates: Matrix = np.tensordot(rates, by_rate, axes=1)
        return self.small.linear.state_matrix + at_rates


def rate_dependent_platform(model: Model, rest: Vector) -> RateDependentPlatform | None:
    """Return the small motions of a craft about its plans; None: no joints measure its attitude.

    Args:
        model: the design model of a law.
        rest: q at rest, shape (positions,); the attitude does not matter.

    Raises:
        BadInput: if the joints do not move independently of each other.
    """
    if model.attitude is None or model.leading is None:
        return None
    found = joint_coordinates(model, rest)
    m, size = model.joints, 2 * found.basis.shape[1]
    linear, quadratic = np.zeros((m, size, size)), np.zeros((m, m, size, size))
    at_rest, one = _rates_matrix(model, rest, found, np.zeros(m)), _STEP * np.eye(m)
    for i in range(m):
        plus, minus = (_rates_matrix(model, rest, found, s * one[i]) - at_rest for s in (1.0, -1.0))
        linear[i] = (plus - minus) / (2.0 * _STEP)
        quadratic[i, i] = (plus + minus) / (2.0 * _STEP**2)
    for i, j in combinations(range(m), 2):
        cross = _rates_matrix(model, rest, found, one[i] + one[j]) - at_rest
        cross = cross - _STEP * (linear[i] + linear[j])
        cross = cross / _STEP**2 - quadratic[i, i] - quadratic[j, j]
        quadratic[i, j] = quadratic[j, i] = 0.5 * cross
    return RateDependentPlatform(reduced_model(model, found), linear, quadratic)


def free_platform(model: Model, rest: Vector) -> RateDependentPlatform:
    """Return the small motions of any free craft about plans; of one axis they are those of rest.

    Args:
        model: what a law believes.
        rest: q at rest, shape (positions,).

    Raises:
        BadInput: the joints do not move independently of each other.
    """
    at_rates = rate_dependent_platform(model, rest)
    if at_rates is not None:
        return at_rates
    small, m = reduced_model(model, joint_coordinates(model, rest)), model.joints
    size = 2 * small.coordinates
    return RateDependentPlatform(small, np.zeros((m, size, size)), np.zeros((m, m, size, size)))


def _rates_matrix(model: Model, rest: Vector, found: JointCoordinates, rates: Vector) -> Matrix:
    """Return A about these rates of the joints, without deflections."""
    basis, outputs = found.basis, found.outputs
    elastic = np.linalg.pinv(found.elastic(model.modes))
    rigid = np.zeros((len(elastic), model.before_modes))
    left = np.vstack((outputs, np.hstack((rigid, elastic))))  # of z' = L v
    at_rates = np.concatenate((rest, basis[:, : rates.size] @ rates))
    slopes, _ = model.jacobian(at_rates, np.zeros(model.efforts))
    return np.asarray(block_diag(left, left) @ slopes @ block_diag(basis, basis))
