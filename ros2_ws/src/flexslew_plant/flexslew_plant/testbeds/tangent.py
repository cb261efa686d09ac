"""The Jacobian of a model with q' other than v: by small motions along v, in the tangent space."""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from flexslew_plant.arrays import Matrix, Vector

_CHANGE = 2.0**-10  # of a motion along v, for derivatives of N and B


class Equations(Protocol):
    """What of a model the tangent needs; see model.Model."""

    @property
    def coordinates(self) -> int:
        """N."""

    @property
    def positions(self) -> int:
        """How many entries q has."""

    @property
    def efforts(self) -> int:
        """How many actuators."""

    def derivative(self, x: Vector, effort: Vector, t: float = 0.0) -> Vector:
        """Return the state derivative."""

    def position_rates(self, q: Vector, t: float = 0.0) -> Matrix:
        """Return N of q' = N(q) v."""

    def mass_matrix(self, q: Vector, t: float = 0.0) -> Matrix:
        """Return M."""

    @property
    def gimbals(self) -> tuple[int, ...]:
        """Which entries of v are angles on which B depends."""

    def input_matrix(self, q: Vector, t: float = 0.0, v: Vector | None = None) -> Matrix:
        """Return B."""

    def residual_slopes(
        self, x: Vector, acceleration: Vector, t: float = 0.0
    ) -> tuple[Matrix, Matrix]:
        """Return the derivatives of M a + h by q and v."""


def tangent_jacobian(
    model: Equations, x: Vector, effort: Vector, t: float
) -> tuple[Matrix, Matrix]:
    """Return df/dx, shape (2 n, 2 n), and df/du, shape (2 n, actuators), of motions e along v.

    With q' = N v and dq = N e:  N e' = d(N v)/dq N e - d(N e)/dq N v + N dv. The derivatives of N
    and of B u are differences, which are exact where these are quadratic in q, and of gimbals to
    1e-6 of the effort.
    """
    n, q, v = model.coordinates, x[: model.positions], x[model.positions :]
    rates = model.position_rates(q, t)
    inverse = np.linalg.pinv(rates)
    position_slope, effort_slope = np.empty((n, n)), np.empty((n, n))
    for k, along in enumerate(rates.T):
        rate_slope = _slope(lambda at: model.position_rates(at, t), q, along) @ v
        frame_slope = _slope(lambda at: model.position_rates(at, t), q, rates @ v)[:, k]
        position_slope[:, k] = inverse @ (rate_slope - frame_slope)
        effort_slope[:, k] = _slope(lambda at: model.input_matrix(at, t, v), q, along) @ effort
    gimbal_slope = np.zeros((n, n))
    for k in model.gimbals:
        one = np.eye(n)[k]
        gimbal_slope[:, k] = _slope(lambda at: model.input_matrix(q, t, at), v, one) @ effort
    a = model.derivative(x, effort, t)[model.positions :]
    dq, dv = model.residual_slopes(x, a, t)
    right = np.hstack((effort_slope - dq @ rates, gimbal_slope - dv, model.input_matrix(q, t, v)))
    below = np.linalg.solve(model.mass_matrix(q, t), right)
    dx = np.block([[position_slope, np.eye(n)], [below[:, : 2 * n]]])
    return dx, np.vstack((np.zeros((n, model.efforts)), below[:, 2 * n :]))


def _slope(what: Callable[[Vector], Matrix], q: Vector, along: Vector) -> Matrix:
    """Return the derivative of what(q) along a direction, by a central difference."""
    forward, backward = what(q + _CHANGE * along), what(q - _CHANGE * along)
    return np.asarray((forward - backward) / (2.0 * _CHANGE))
