"""Arcs of constant effort as kernels: final states, exact sensitivities and the costate.

An ensemble is simulated: a nominal model under the effort of the arcs, and copies with perturbed
parameters under the same effort and a feedback on the nominal joints,
    u_i = u + Kp (q_0 - q_i) + Kd (v_0 - v_i).
Without gains that is open loop.

Every arc is integrated from its beginning to its end by steps of order 8, so no step ever crosses
a switch and the durations may be any real numbers.

The loops are compiled once for all testbeds and receive the equations of each as functions.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np
from numba import types

from flexslew_control.controllers.by_joint.pd_feedforward import pd_step
from flexslew_plant.arrays import Matrix, Tensor, Vector, called, compiled
from flexslew_plant.testbeds.compiled import dynamics
from flexslew_plant.testbeds.compiled.bound import JACOBIAN, RATES, Rates
from flexslew_plant.testbeds.compiled.dynamics import STAGES

_pd_step = called(pd_step)
_VECTOR = types.Array(types.float64, 1, "C")
_MATRIX = types.Array(types.float64, 2, "C")
_COPIES = types.Tuple((_MATRIX, _VECTOR, _VECTOR))
_RateOf: TypeAlias = Callable[[Vector, float, Vector, Vector, Vector], None]
_JacobianOf: TypeAlias = Callable[[Vector, float, Vector, Vector, Matrix, Matrix], None]
_Copies: TypeAlias = tuple[Matrix, Vector, Vector]  # packed, kp and kd of a ModelEnsemble


class ModelEnsemble(NamedTuple):
    """A nominal model and its perturbed copies."""

    equations: Rates  # of all
    packed: Matrix  # their parameters, one row per copy
    kp: Vector  # gains of the perturbed copies, shape (joints,) [N m/rad]
    kd: Vector  # the same [N m s/rad]


def final_states(
    models: ModelEnsemble, start: Vector, efforts: Matrix, durations: Vector, step: float
) -> Matrix:
    """Return the states after all arcs, shape (copies, 2 n), the nominal one's first.

    Args:
        models: of the model.
        start: state of all at the beginning of the first arc, shape (2 n,).
        efforts: one row per arc, shape (arcs, joints) [N m or N].
        durations: shape (arcs,) [s].
        step: longest step of the integration [s].
    """
    none = np.zeros((len(models.packed) * start.size, 0))
    z, _ = _run(_simulate, models, start, efforts, durations, step, none)
    return z.reshape(len(models.packed), -1)


def final_sensitivity(
    models: ModelEnsemble, start: Vector, efforts: Matrix, durations: Vector, step: float
) -> tuple[Vector, Matrix]:
    """Return the states after all arcs, flat, and their derivatives by the durations.

    With z' = f(z, u_i) on arc i: dz/dd_i = f at the end of the arc, then S' = (df/dz) S.

    Args:
        models, start, efforts, durations, step: as in final_states.

    Returns:
        the states, shape (copies 2 n,), and dz_f/dd, shape (copies 2 n, arcs).
    """
    slopes = np.zeros((len(models.packed) * start.size, durations.size))
    return _run(_simulate, models, start, efforts, durations, step, slopes)


def costate_backwards(
    models: ModelEnsemble,
    final: Vector,
    costate: Vector,
    efforts: Matrix,
    durations: Vector,
    step: float,
) -> tuple[Vector, Matrix]:
    """Return the times and lambda^T df/du along the arcs, from the end to the beginning.

    lambda' = -(df/dz)^T lambda is integrated backwards together with the states.

    Args:
        models, efforts, durations, step: as in final_states.
        final: states at the end, flat, shape (copies 2 n,).
        costate: lambda at the end, same shape.

    Returns:
        falling times, shape (samples,) [s]; lambda^T df/du, shape (samples, joints).
    """
    return _run(_costate_backwards, models, final, costate, efforts, durations, step)


def _run(function: Callable[..., Any], models: ModelEnsemble, *given: Any) -> tuple[Vector, Matrix]:
    """Return what a loop over these copies finds, for arrays of any access and layout."""
    kinds = tuple(
        types.float64 if np.ndim(one) == 0 else (_VECTOR, _MATRIX)[one.ndim - 1] for one in given
    )
    # copied where they are not of the one kind that the loop is compiled for
    arrays = [
        one if np.ndim(one) == 0 else np.require(one, np.float64, ["C", "W"])
        for one in (*models[1:], *given)
    ]
    found = _kernel(function, kinds)(*models.equations, tuple(arrays[:3]), *arrays[3:])
    return cast(tuple[Vector, Matrix], found)


@cache
def _kernel(function: Callable[..., Any], kinds: tuple[Any, ...]) -> Callable[..., Any]:
    """Return a loop as machine code, the same for all testbeds."""
    kernel: Any = compiled(function)
    kernel.compile(types.Tuple((_VECTOR, _MATRIX))(RATES, JACOBIAN, _COPIES, *kinds))
    kernel.disable_compile()  # never for the type of one testbed's function
    return cast(Callable[..., Any], kernel)


@compiled
def _applied(copies: _Copies, z: Vector, effort: Vector, copy: int, applied: Vector) -> Vector:
    """Return the state of a copy, after writing its effort under the feedback."""
    packed, kp, kd = copies
    rows = z.size // packed.shape[0]
    n, x = rows // 2, z[copy * rows : (copy + 1) * rows]
    for j in range(effort.size):
        error, rate_error = z[j] - x[j], z[n + j] - x[n + j]
        applied[j], _, _ = _pd_step(kp[j], kd[j], effort[j], error, rate_error)
    return x


@compiled
def _rates(rate_of: _RateOf, copies: _Copies, z: Vector, effort: Vector, out: Vector) -> None:
    """Write dz/dt of all copies, shape of z."""
    packed, applied = copies[0], np.empty(effort.size)
    rows = z.size // packed.shape[0]
    for c in range(packed.shape[0]):
        x = _applied(copies, z, effort, c, applied)
        rate_of(packed[c], 0.0, x, applied, out[c * rows : (c + 1) * rows])


@compiled
def _jacobians(
    jacobian_of: _JacobianOf, copies: _Copies, z: Vector, effort: Vector, dx: Tensor, du: Tensor
) -> None:
    """Write df/dx, shape (copies, 2 n, 2 n), and df/du, shape (copies, 2 n, joints), of all."""
    packed, applied = copies[0], np.empty(effort.size)
    for c in range(packed.shape[0]):
        x = _applied(copies, z, effort, c, applied)
        jacobian_of(packed[c], 0.0, x, applied, dx[c], du[c])


@compiled
def _tangent(dx: Tensor, du: Tensor, copies: _Copies, s: Matrix, out: Matrix) -> None:
    """Write (df/dz) s of _rates."""
    _, kp, kd = copies
    (models, rows, m), columns = du.shape, s.shape[1]
    n = rows // 2
    for c in range(models):
        first = c * rows
        for i in range(rows):
            for k in range(columns):
                out[first + i, k] = 0.0
            for j in range(rows):
                slope = dx[c, i, j]
                if slope != 0.0:
                    for k in range(columns):
                        out[first + i, k] += slope * s[first + j, k]
            for j in range(m):
                by_p, by_d = du[c, i, j] * kp[j], du[c, i, j] * kd[j]
                if c > 0 and (by_p != 0.0 or by_d != 0.0):
                    for k in range(columns):
                        out[first + i, k] += by_p * (s[j, k] - s[first + j, k])
                        out[first + i, k] += by_d * (s[n + j, k] - s[first + n + j, k])


@compiled
def _cotangent(
    dx: Tensor, du: Tensor, copies: _Copies, costate: Vector, out: Vector, by_effort: Vector
) -> None:
    """Write (df/dz)^T lambda of _rates and, summed over the copies, (df/du)^T lambda."""
    _, kp, kd = copies
    models, rows, m = du.shape
    n = rows // 2
    out[:] = 0.0
    by_effort[:] = 0.0
    for c in range(models):
        first = c * rows
        for i in range(rows):
            weight = costate[first + i]
            for j in range(rows):
                out[first + j] += dx[c, i, j] * weight
        for j in range(m):
            product = 0.0
            for i in range(rows):
                product += du[c, i, j] * costate[first + i]
            by_effort[j] += product
            if c > 0:
                out[j] += kp[j] * product
                out[n + j] += kd[j] * product
                out[first + j] -= kp[j] * product
                out[first + n + j] -= kd[j] * product


def _simulate(
    rate_of: _RateOf,
    jacobian_of: _JacobianOf,
    copies: _Copies,
    start: Vector,
    efforts: Matrix,
    durations: Vector,
    step: float,
    s: Matrix,
) -> tuple[Vector, Matrix]:
    """Return the states after all arcs, flat, and s: with columns in it, dz_f/dd."""
    models, rows, size = copies[0].shape[0], start.size, copies[0].shape[0] * start.size
    z = np.empty(size)
    for k in range(size):
        z[k] = start[k % rows]
    dx, du = np.empty((models, rows, rows)), np.empty((models, rows, efforts.shape[1]))
    for arc in range(durations.size):
        before = min(arc, s.shape[1])  # arcs that the state depends on so far
        width = size * (1 + before)
        y, at, slopes = np.empty(width), np.empty(width), np.empty((STAGES, width))
        by_arc, by_arc_at = y[size:].reshape((size, before)), at[size:].reshape((size, before))
        y[:size], by_arc[:] = z, s[:, :before]
        steps = max(1, int(np.ceil(abs(durations[arc]) / step)))
        h = durations[arc] / steps
        for _ in range(steps):
            for stage in range(STAGES):
                dynamics.stage_state(y, slopes, stage, h, at)
                _rates(rate_of, copies, at[:size], efforts[arc], slopes[stage, :size])
                if before:
                    _jacobians(jacobian_of, copies, at[:size], efforts[arc], dx, du)
                    rate = slopes[stage, size:].reshape((size, before))
                    _tangent(dx, du, copies, by_arc_at, rate)
            dynamics.complete_step(y, slopes, h)
        z[:], s[:, :before] = y[:size], by_arc
        if s.shape[1]:
            _rates(rate_of, copies, z, efforts[arc], at[:size])
            s[:, arc] = at[:size]
    return z, s


def _costate_backwards(
    rate_of: _RateOf,
    jacobian_of: _JacobianOf,
    copies: _Copies,
    final: Vector,
    costate: Vector,
    efforts: Matrix,
    durations: Vector,
    step: float,
) -> tuple[Vector, Matrix]:
    """See costate_backwards."""
    rows, m = final.size, efforts.shape[1]
    counts = np.empty(durations.size, dtype=np.int64)
    for i in range(durations.size):
        counts[i] = max(1, int(np.ceil(abs(durations[i]) / step)))
    times, values = np.empty(counts.sum() + 1), np.empty((counts.sum() + 1, m))
    models = copies[0].shape[0]
    each = rows // models
    dx, du = np.empty((models, each, each)), np.empty((models, each, m))
    y, at, product = np.concatenate((final, costate)), np.empty(2 * rows), np.empty(m)
    slopes = np.empty((STAGES, 2 * rows))
    row, t = 0, durations.sum()
    for index in range(durations.size):
        arc = durations.size - 1 - index
        h = -durations[arc] / counts[arc]
        for _ in range(counts[arc]):
            for stage in range(STAGES):
                dynamics.stage_state(y, slopes, stage, h, at)
                _rates(rate_of, copies, at[:rows], efforts[arc], slopes[stage, :rows])
                _jacobians(jacobian_of, copies, at[:rows], efforts[arc], dx, du)
                _cotangent(dx, du, copies, at[rows:], slopes[stage, rows:], product)
                slopes[stage, rows:] *= -1.0
                if stage == 0:
                    times[row] = t
                    for j in range(m):
                        values[row, j] = product[j]
            dynamics.complete_step(y, slopes, h)
            row += 1
            t += h
    _jacobians(jacobian_of, copies, y[:rows], efforts[0], dx, du)
    _cotangent(dx, du, copies, y[rows:], at[rows:], product)
    times[row] = t
    for j in range(m):
        values[row, j] = product[j]
    return times, values
