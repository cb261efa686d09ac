"""A flight together with its exact derivatives by numbers of the equations, as a kernel.

The variational equations of M(q, t) a + h(q, v, t) = B u, x = [q, v], with s = dx/d theta (Hairer,
Norsett and Wanner 1993, I.14):

    M da = -(dr/dq s_q + dr/dv s_v + dr/dp dp/d theta) at fixed a,    r = M a + h - B u,

take the same steps as the flight, so that s is the derivative of what the integrator computes.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, cast

import numpy as np
from numba import types

from flexslew_plant.arrays import Matrix, Vector, called, compiled
from flexslew_plant.read_only import read_only
from flexslew_plant.testbeds.compiled import mass
from flexslew_plant.testbeds.compiled.bound import Bound
from flexslew_plant.testbeds.compiled.dynamics import (
    STAGE_TIMES,
    STAGES,
    complete_step,
    stage_state,
)

_CHANGE = 2.0**-10  # differences of M, h and B by p, of B and N by q: exact where quadratic
_factor = called(mass.factor.py_func)  # type: ignore[attr-defined]
_solve = called(mass.solve.py_func)  # type: ignore[attr-defined]


def flight_with_slopes(
    equations: Bound,
    p: Vector,
    along: Matrix,
    start: Vector,
    start_slopes: Matrix,
    effort: Matrix,
    period: float,
    square: int,
    extra: int,
) -> tuple[Matrix, Matrix]:
    """Return the states at the ticks and their derivatives by parameters.

    Args:
        equations: of the testbed.
        p: its packed parameters.
        along: dp/d theta, shape (parameters, p.size).
        start: state [q, v].
        start_slopes: its derivatives, shape (parameters, size of a state).
        effort: held over every tick, shape (ticks, actuators) [N m or N].
        period: one tick [s], one step of order 8.
        square: size of the joint block of M.
        extra: how many entries q has more than v.

    Returns:
        shapes (ticks + 1, size of a state) and (ticks + 1, parameters, size of a state).
    """
    path = np.empty((len(effort) + 1, start.size * (1 + len(along))))
    path[0] = np.concatenate((start, start_slopes.ravel()))
    own = equations.terms, equations.residual_jacobian, equations.actuation
    _kernel()(*own, equations.position_rates, p, along, effort, period, square, extra, path)
    both = path.reshape(len(path), 1 + len(along), start.size)
    return both[:, 0], both[:, 1:]


@called
def _put(values: Vector, out: Vector) -> None:
    for k in range(out.size):  # a slice that takes an array compiles a message about shapes
        out[k] = values[k]


@lru_cache
def _kernel() -> Callable[..., None]:
    """Return _flown as machine code, the same for all testbeds."""
    vector, matrix = types.Array(types.float64, 1, "C"), types.Array(types.float64, 2, "C")
    read, t = read_only(vector), types.float64
    kernel: Any = compiled(_flown)
    kernel.compile(
        types.void(
            types.FunctionType(types.void(read, t, read, matrix, matrix, vector, vector)),
            types.FunctionType(types.void(read, t, read, read, matrix, matrix)),
            types.FunctionType(types.void(read, t, read, read, vector)),
            types.FunctionType(types.void(read, t, read, vector)),
            *(vector, matrix, matrix, t, types.int64, types.int64, matrix),
        )
    )
    kernel.disable_compile()  # never for the type of one testbed's function
    return cast(Callable[..., None], kernel)


def _flown(
    terms: Callable[..., None],
    residual_jacobian: Callable[..., None],
    actuation: Callable[..., None],
    position_rates: Callable[..., None],
    p: Vector,
    along: Matrix,
    effort: Matrix,
    period: float,
    square: int,
    extra: int,
    path: Matrix,
) -> None:
    """Write the rows of path, a state and then its derivatives, from the first on."""
    count, width = along.shape[0], path.shape[1]
    size = width // (1 + count)
    n = (size - extra) // 2
    q = size - n  # entries of q
    joints, coupling = np.empty((square, square)), np.empty((square, n - square))
    modal, a, push, rates = np.empty(n - square), np.empty(n), np.empty(n), np.empty(size)
    other_joints, other_coupling = np.empty_like(joints), np.empty_like(coupling)
    other_modal, residual, force = np.empty_like(modal), np.empty(n), np.empty(n)
    dq, dv, moved = np.empty((n, q)), np.empty((n, n)), np.empty(size)
    now, at, slopes = path[0].copy(), np.empty(width), np.empty((STAGES, width))
    for tick in range(effort.shape[0]):
        u = effort[tick]
        for i in range(STAGES):
            stage_state(now, slopes, i, period, at)
            t, x = (tick + STAGE_TIMES[i]) * period, at[:size]
            terms(p, t, x, joints, coupling, modal, residual)
            a[:] = 0.0
            actuation(p, t, x, u, a)
            a -= residual
            _factor(joints, coupling, modal)
            _solve(joints, coupling, modal, a)
            position_rates(p, t, x, rates)
            _put(rates[:q], slopes[i, :q])
            _put(a, slopes[i, q:size])
            residual_jacobian(p, t, x, a, dq, dv)
            for k in range(count):
                first = size * (1 + k)
                slope, rate = at[first : first + size], slopes[i, first : first + size]
                for j in range(n):
                    force[j] = 0.0
                    for c in range(q):
                        force[j] -= dq[j, c] * slope[c]
                    for c in range(n):
                        force[j] -= dv[j, c] * slope[q + c]
                for sign in (1.0, -1.0):  # dr/dp along the parameter
                    there = p + sign * _CHANGE * along[k]
                    terms(there, t, x, other_joints, other_coupling, other_modal, residual)
                    push[:] = 0.0
                    actuation(there, t, x, u, push)
                    residual -= push
                    for j in range(square):
                        for c in range(square):
                            residual[j] += other_joints[j, c] * a[c]
                        for c in range(n - square):
                            residual[j] += other_coupling[j, c] * a[square + c]
                            residual[square + c] += other_coupling[j, c] * a[j]
                    for c in range(n - square):
                        residual[square + c] += other_modal[c] * a[square + c]
                    force -= sign / (2.0 * _CHANGE) * residual
                if extra == 0:
                    _put(slope[q:], rate[:q])
                else:  # q' = N(q) v, and B may turn with q
                    _put(x[:q], moved[:q])
                    _put(slope[q:], moved[q:])
                    position_rates(p, t, moved, rates)
                    _put(rates[:q], rate[:q])
                    _put(x[q:], moved[q:])
                    change = _CHANGE / (1.0 + np.abs(slope[:q]).max())
                    for sign in (1.0, -1.0):
                        _put(x[:q] + sign * change * slope[:q], moved[:q])
                        push[:] = 0.0
                        actuation(p, t, moved, u, push)
                        force += sign / (2.0 * change) * push
                        position_rates(p, t, moved, rates)
                        _put(rate[:q] + sign / (2.0 * change) * rates[:q], rate[:q])
                _solve(joints, coupling, modal, force)
                _put(force, rate[q:])
        complete_step(now, slopes, period)
        _put(now, path[tick + 1])
