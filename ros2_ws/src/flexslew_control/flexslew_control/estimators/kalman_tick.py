"""The tick of a Kalman filter for other machine code, which keeps its state."""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple, TypeAlias, cast

import numpy as np

from flexslew_control.estimators.kalman import measurement_update, predicted_covariance
from flexslew_plant.arrays import Matrix, Vector, inline
from flexslew_plant.testbeds.compiled.bound import bound
from flexslew_plant.testbeds.kernels import Kernels

# (belief, t, dt, effort, y, x, P, e, S): replaces state, covariance, innovation and its variances
# of t [s] by those dt later, when y is measured; effort was held in between
Tick: TypeAlias = Callable[..., None]


class FilterConstants(NamedTuple):
    """The constants of a filter: the model's numbers, then kalman.FilterMatrices."""

    packed: Vector
    f: Matrix
    g: Matrix
    q: Matrix
    c: Matrix
    r: Vector
    origin: Vector
    first: Matrix


@inline
def write_variance(covariance: Matrix, c: Matrix, r: Vector, out: Vector) -> None:
    """Write kalman.innovation_variance."""
    for i in range(out.size):
        out[i] = r[i]
        for a in range(c.shape[1]):
            for b in range(c.shape[1]):
                out[i] += c[i, a] * covariance[a, b] * c[i, b]


@lru_cache
def kalman_tick(kernels: Kernels, n: int, m: int, linear: bool) -> Tick:
    """Return what KalmanFilter.update does to [q, v, d], as machine code.

    Args:
        kernels: the equations of the model that it believes in.
        n: its coordinates.
        m: those before its modes.
        linear: whether it predicts by F and G instead of the equations.
    """
    model = bound(kernels, n, m)
    advance, jacobian, k = model.advance, model.jacobian, 2 * n

    @inline
    def predicted_by_matrices(
        constants: FilterConstants, t: float, dt: float, effort: Vector, x: Vector, p: Matrix
    ) -> Matrix:
        after = constants.origin + constants.f @ (x - constants.origin) + constants.g @ effort
        for i in range(x.size):
            x[i] = after[i]
        return constants.f @ p @ constants.f.T + constants.q

    @inline
    def predicted_by_equations(
        constants: FilterConstants, t: float, dt: float, effort: Vector, x: Vector, p: Matrix
    ) -> Matrix:
        total, d = effort.copy(), x.size - k
        for i in range(d):
            total[i] += x[k + i]
        state = x[:k].copy()
        dx, du = np.empty((k, k)), np.empty((k, effort.size))
        jacobian(constants.packed, t, state, total, dx, du)
        advance(constants.packed, t, total, dt, 1, m, state)
        for i in range(k):
            x[i] = state[i]
        return predicted_covariance(dx, du[:, :d].copy(), p, constants.q, dt)

    predicted = predicted_by_matrices if linear else predicted_by_equations

    @inline
    def tick(
        constants: FilterConstants,
        t: float,
        dt: float,
        effort: Vector,
        y: Vector,
        x: Vector,
        p: Matrix,
        e: Vector,
        variance: Vector,
    ) -> None:
        prior = predicted(constants, t, dt, effort, x, p)
        write_variance(prior, constants.c, constants.r, variance)
        state, covariance, innovation, _ = measurement_update(x, prior, y, constants.c, constants.r)
        for i in range(x.size):
            x[i] = state[i]
            for j in range(x.size):
                p[i, j] = covariance[i, j]
        for i in range(e.size):
            e[i] = innovation[i]

    return cast(Tick, tick)
