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
from typing import Any, NamedTuple, cast

import numpy as np
from numba import types

from flexslew_plant.arrays import Matrix, Tensor, Vector, compiled
from flexslew_plant.testbeds.compiled import dynamics
from flexslew_plant.testbeds.compiled.bound import JACOBIAN, RATES, Rates
from flexslew_plant.testbeds.compiled.dynamics import STAGE_WEIGHTS, STAGES, STEP_WEIGHTS

_VECTOR = types.Array(types.float64, 1, "C")
_MATRIX = types.Array(types.float64, 2, "C")
_RateOf = Callable[[Vector, float, Vector, Vector, Vector], None]
_JacobianOf = Callable[[Vector, float, Vector, Vector, Matrix, Matrix], None]


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
    found: Matrix = _run(_final_states, _MATRIX, models, start, efforts, durations, step)
    return found


def final_sensitivity(
    models: ModelEnsemble, start: Vector, efforts: Matrix, durations: Vector, step: float
) -> tuple[Vector, Matrix]:
    """Return the states after all arcs, flat, and their derivatives by the durations.

    With z' = f(z, u_i) on arc i: dz/dd_i = f at the end of the arc, then S' = (df/dz) S.

    Args:
        copies, start, efforts, durations, step: as in final_states.

    Returns:
        the states, shape (copies 2 n,), and dz_f/dd, shape (copies 2 n, arcs).
    """
    pair = types.Tuple((_VECTOR, _MATRIX))
    found: tuple[Vector, Matrix] = _run(
        _final_sensitivity, pair, models, start, efforts, durations, step
    )
    return found


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
        copies, efforts, durations, step: as in final_states.
        final: states at the end, flat, shape (copies 2 n,).
        costate: lambda at the end, same shape.

    Returns:
        falling times, shape (samples,) [s]; lambda^T df/du, shape (samples, joints).
    """
    pair = types.Tuple((_VECTOR, _MATRIX))
    found: tuple[Vector, Matrix] = _run(
        _costate_backwards, pair, models, final, costate, efforts, durations, step
    )
    return found


def rates(models: ModelEnsemble, z: Vector, effort: Vector) -> Vector:
    """Return dz/dt of all copies, shape of z.

    Args:
        models: of the model.
        z: their states, flat, shape (copies 2 n,).
        effort: of the arc, shape (joints,) [N m or N].
    """
    out = np.empty(z.size)
    _run(_rates, types.void, models, z, effort, out)
    return out


def _run(function: Callable[..., Any], result: Any, models: ModelEnsemble, *given: Any) -> Any:
    """Return what a loop over these copies finds, for arrays of any access and layout."""
    kinds = tuple(
        types.float64 if np.ndim(one) == 0 else (_VECTOR, _MATRIX)[one.ndim - 1] for one in given
    )
    # copied where they are not of the one kind that the loop is compiled for
    arrays = [
        one if np.ndim(one) == 0 else np.require(one, np.float64, ["C", "W"])
        for one in (*models[1:], *given)
    ]
    return _kernel(function, result, kinds)(*models.equations, *arrays)


@cache
def _kernel(
    function: Callable[..., Any], result: Any, kinds: tuple[Any, ...]
) -> Callable[..., Any]:
    """Return a loop as machine code, the same for all testbeds."""
    kernel: Any = compiled(function)
    kernel.compile(result(RATES, JACOBIAN, _MATRIX, _VECTOR, _VECTOR, *kinds))
    kernel.disable_compile()  # never for the type of one testbed's function
    return cast(Callable[..., Any], kernel)


def _rates(
    rate_of: _RateOf,
    jacobian_of: _JacobianOf,
    packed: Matrix,
    kp: Vector,
    kd: Vector,
    z: Vector,
    effort: Vector,
    out: Vector,
) -> None:
    _all_rates(rate_of, packed, kp, kd, z, effort, out)


@compiled
def _all_rates(
    rate_of: _RateOf, packed: Matrix, kp: Vector, kd: Vector, z: Vector, effort: Vector, out: Vector
) -> None:
    """Write dz/dt of all copies; see rates."""
    models, m = packed.shape[0], effort.size
    rows = z.size // models
    n, applied = rows // 2, np.empty(m)
    for c in range(models):
        x = z[c * rows : (c + 1) * rows]
        for j in range(m):
            applied[j] = effort[j] + kp[j] * (z[j] - x[j]) + kd[j] * (z[n + j] - x[n + j])
        rate_of(packed[c], 0.0, x, applied, out[c * rows : (c + 1) * rows])


@compiled
def _jacobians(
    jacobian_of: _JacobianOf,
    packed: Matrix,
    kp: Vector,
    kd: Vector,
    z: Vector,
    effort: Vector,
    dx: Tensor,
    du: Tensor,
) -> None:
    """Write df/dx, shape (copies, 2 n, 2 n), and df/du, shape (copies, 2 n, joints), of all."""
    models, m = packed.shape[0], effort.size
    rows = z.size // models
    n, applied = rows // 2, np.empty(m)
    for c in range(models):
        x = z[c * rows : (c + 1) * rows]
        for j in range(m):
            applied[j] = effort[j] + kp[j] * (z[j] - x[j]) + kd[j] * (z[n + j] - x[n + j])
        jacobian_of(packed[c], 0.0, x, applied, dx[c], du[c])


@compiled
def _tangent(
    dx: Tensor, du: Tensor, kp: Vector, kd: Vector, s: Matrix, columns: int, out: Matrix
) -> None:
    """Write (df/dz) s of rates, for the first columns of s alone."""
    models, rows, m = du.shape
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
    dx: Tensor, du: Tensor, kp: Vector, kd: Vector, costate: Vector, out: Vector, by_effort: Vector
) -> None:
    """Write (df/dz)^T lambda of rates and, summed over the copies, (df/du)^T lambda."""
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


@compiled
def _repeat_state(start: Vector, models: int) -> Vector:
    """Return the states of all copies at the start, flat."""
    z = np.empty(models * start.size)
    for c in range(models):
        for k in range(start.size):
            z[c * start.size + k] = start[k]
    return z


def _final_states(
    rate_of: _RateOf,
    jacobian_of: _JacobianOf,
    packed: Matrix,
    kp: Vector,
    kd: Vector,
    start: Vector,
    efforts: Matrix,
    durations: Vector,
    step: float,
) -> Matrix:
    """See final_states."""
    models, rows = packed.shape[0], start.size
    z = _repeat_state(start, models)
    slopes, at = np.empty((STAGES, z.size)), np.empty(z.size)
    for arc in range(durations.size):
        steps = max(1, int(np.ceil(abs(durations[arc]) / step)))
        h = durations[arc] / steps
        for _ in range(steps):
            for stage in range(STAGES):
                dynamics.stage_state(z, slopes, stage, h, at)
                _all_rates(rate_of, packed, kp, kd, at, efforts[arc], slopes[stage])
            dynamics.complete_step(z, slopes, h)
    return z.reshape((models, rows))


def _final_sensitivity(
    rate_of: _RateOf,
    jacobian_of: _JacobianOf,
    packed: Matrix,
    kp: Vector,
    kd: Vector,
    start: Vector,
    efforts: Matrix,
    durations: Vector,
    step: float,
) -> tuple[Vector, Matrix]:
    """See final_sensitivity."""
    arcs = durations.size
    z = _repeat_state(start, packed.shape[0])
    models, rows = packed.shape[0], start.size
    dx, du = np.empty((models, rows, rows)), np.empty((models, rows, efforts.shape[1]))
    slopes, at = np.empty((STAGES, z.size)), np.empty(z.size)
    s, s_at = np.zeros((z.size, arcs)), np.zeros((z.size, arcs))
    s_slopes = np.zeros((STAGES, z.size, arcs))
    for arc in range(arcs):
        steps = max(1, int(np.ceil(abs(durations[arc]) / step)))
        h = durations[arc] / steps
        for _ in range(steps):
            for stage in range(STAGES):
                dynamics.stage_state(z, slopes, stage, h, at)
                _all_rates(rate_of, packed, kp, kd, at, efforts[arc], slopes[stage])
                if arc == 0:
                    continue
                _jacobians(jacobian_of, packed, kp, kd, at, efforts[arc], dx, du)
                for i in range(z.size):
                    for k in range(arc):
                        s_at[i, k] = s[i, k]
                    for j in range(stage):
                        weight = h * STAGE_WEIGHTS[stage, j]
                        if weight != 0.0:
                            for k in range(arc):
                                s_at[i, k] += weight * s_slopes[j, i, k]
                _tangent(dx, du, kp, kd, s_at, arc, s_slopes[stage])
            dynamics.complete_step(z, slopes, h)
            for j in range(STAGES):
                weight = h * STEP_WEIGHTS[j]
                if weight != 0.0:
                    for i in range(z.size):
                        for k in range(arc):
                            s[i, k] += weight * s_slopes[j, i, k]
        _all_rates(rate_of, packed, kp, kd, z, efforts[arc], at)
        for i in range(z.size):
            s[i, arc] = at[i]
    return z, s


def _costate_backwards(
    rate_of: _RateOf,
    jacobian_of: _JacobianOf,
    packed: Matrix,
    kp: Vector,
    kd: Vector,
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
    models = packed.shape[0]
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
                _all_rates(rate_of, packed, kp, kd, at[:rows], efforts[arc], slopes[stage, :rows])
                _jacobians(jacobian_of, packed, kp, kd, at[:rows], efforts[arc], dx, du)
                _cotangent(dx, du, kp, kd, at[rows:], slopes[stage, rows:], product)
                slopes[stage, rows:] *= -1.0
                if stage == 0:
                    times[row] = t
                    for j in range(m):
                        values[row, j] = product[j]
            dynamics.complete_step(y, slopes, h)
            row += 1
            t += h
    _jacobians(jacobian_of, packed, kp, kd, y[:rows], efforts[0], dx, du)
    _cotangent(dx, du, kp, kd, y[rows:], at[rows:], product)
    times[row] = t
    for j in range(m):
        values[row, j] = product[j]
    return times, values
