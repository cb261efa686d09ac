"""A flight together with its exact derivatives: by numbers of the equations, state and effort.

The variational equations of M(q, t) a + h(q, v, t) = B u, x = [q, v], with s = dx/d theta (Hairer,
Norsett and Wanner 1993, I.14):

    M da = -(dr/dq s_q + dr/dv s_v + dr/dp dp/d theta) + B du/d theta at fixed a,
    r = M a + h - B u,

take the same steps as the flight, so that s is the derivative of what the integrator computes.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, cast

import numpy as np
from numba import types

from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector, called, compiled, put
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
_BOTH: Vector = np.array([1.0, -1.0])  # signs of a change
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
    ticks, count = len(effort), len(along)
    path = np.empty((ticks + 1, start.size * (1 + count)))
    path[0] = np.concatenate((start, start_slopes.ravel()))
    pieces = period * np.arange(ticks), np.full(ticks, period), np.ones(ticks, dtype=np.int64)
    none = np.zeros((count, effort.shape[1]))
    _kernel()(*_own(equations), p, along, none, effort, *pieces, square, extra, path[:-1], path[1:])
    both = path.reshape(ticks + 1, 1 + count, start.size)
    return both[:, 0], both[:, 1:]


def slopes_of_pieces(
    equations: Bound,
    p: Vector,
    states: Matrix,
    effort: Matrix,
    durations: Vector,
    steps: Indices,
    columns: Indices,
    square: int,
    extra: int,
) -> tuple[Tensor, Tensor]:
    """Return the derivatives of the ends of pieces by their begins and by the efforts held.

    Args:
        equations: of the testbed.
        p: its packed parameters.
        states: at the begins, shape (k, size of a state).
        effort: held over every piece, shape (k, actuators) [N m or N].
        durations: of the pieces, from time zero on, shape (k,) [s].
        steps: equal ones of order 8, of every piece, shape (k,).
        columns: entries of a state by which derivatives are taken.
        square: size of the joint block of M.
        extra: how many entries q has more than v.

    Returns:
        shapes (k, size, size), zero but in these columns, and (k, size, actuators).
    """
    (k, size), m, c = states.shape, effort.shape[1], columns.size
    begins = np.zeros((k, 1 + c + m, size))
    begins[:, 0] = states
    begins[:, 1 + np.arange(c), columns] = 1.0
    pushes = np.zeros((c + m, m))
    pushes[c:] = np.eye(m)
    pieces = np.cumsum(durations) - durations, durations, steps
    begins, ends, none = begins.reshape(k, -1), np.empty((k, begins[0].size)), np.zeros((0, p.size))
    _kernel()(*_own(equations), p, none, pushes, effort, *pieces, square, extra, begins, ends)
    found = ends.reshape(k, 1 + c + m, size).swapaxes(1, 2)
    by_state = np.zeros((k, size, size))
    by_state[:, :, columns] = found[:, :, 1 : 1 + c]
    return by_state, np.ascontiguousarray(found[:, :, 1 + c :])


def _own(equations: Bound) -> tuple[Callable[..., None], ...]:
    """Return what the kernel calls of a testbed's equations."""
    first = equations.terms, equations.residual_jacobian
    return (*first, equations.actuation, equations.position_rates)


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
            *(vector, matrix, matrix, matrix, vector, vector, types.Array(types.int64, 1, "C")),
            *(types.int64, types.int64, matrix, matrix),
        )
    )
    kernel.disable_compile()  # never for the type of one testbed's function
    return cast(Callable[..., None], kernel)


@called
def _write_residual(
    terms: Callable[..., None],
    actuation: Callable[..., None],
    p: Vector,
    t: float,
    x: Vector,
    u: Vector,
    a: Vector,
    work: tuple[Matrix, Matrix, Vector, Vector],
    residual: Vector,
) -> None:
    """Write M a + h - B u."""
    joints, coupling, modal, push = work
    square = len(joints)
    terms(p, t, x, joints, coupling, modal, residual)
    push[:] = 0.0
    actuation(p, t, x, u, push)
    residual -= push
    for j in range(square):
        for c in range(square):
            residual[j] += joints[j, c] * a[c]
        for c in range(len(modal)):
            residual[j] += coupling[j, c] * a[square + c]
            residual[square + c] += coupling[j, c] * a[j]
    for c in range(len(modal)):
        residual[square + c] += modal[c] * a[square + c]


def _flown(
    terms: Callable[..., None],
    residual_jacobian: Callable[..., None],
    actuation: Callable[..., None],
    position_rates: Callable[..., None],
    p: Vector,
    along: Matrix,
    pushes: Matrix,
    effort: Matrix,
    starts: Vector,
    durations: Vector,
    steps: Indices,
    square: int,
    extra: int,
    begins: Matrix,
    ends: Matrix,
) -> None:
    """Write the ends of pieces: each a state and then its derivatives, as its begin.

    Row k of `along` and of `pushes` is how p and the effort change with parameter k; `along` has
    no rows where p does not. A begin is read when its piece is flown: it may be the end before it.
    """
    count, width = pushes.shape[0], begins.shape[1]
    size = width // (1 + count)
    n = (size - extra) // 2
    q = size - n  # entries of q
    joints, coupling = np.empty((square, square)), np.empty((square, n - square))
    modal, a, push, rates = np.empty(n - square), np.empty(n), np.empty(n), np.empty(size)
    other = np.empty_like(joints), np.empty_like(coupling), np.empty_like(modal), np.empty(n)
    residual, force = np.empty(n), np.empty(n)
    dq, dv, moved = np.empty((n, q)), np.empty((n, n)), np.empty(size)
    now, at, slopes = np.empty(width), np.empty(width), np.empty((STAGES, width))
    for piece in range(effort.shape[0]):
        u, h = effort[piece], durations[piece] / steps[piece]
        put(begins[piece], now)
        for step in range(steps[piece]):
            for i in range(STAGES):
                stage_state(now, slopes, i, h, at)
                t, x = starts[piece] + (step + STAGE_TIMES[i]) * h, at[:size]
                terms(p, t, x, joints, coupling, modal, residual)
                a[:] = 0.0
                actuation(p, t, x, u, a)
                a -= residual
                _factor(joints, coupling, modal)
                _solve(joints, coupling, modal, a)
                position_rates(p, t, x, rates)
                put(rates[:q], slopes[i, :q])
                put(a, slopes[i, q:size])
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
                    for sign in _BOTH[: 2 * int(k < len(along))]:  # dr/dp along the parameter
                        there = p + sign * _CHANGE * along[k]
                        _write_residual(terms, actuation, there, t, x, u, a, other, residual)
                        force -= sign / (2.0 * _CHANGE) * residual
                    for sign in _BOTH[: 2 * int(pushes[k].any())]:
                        push[:] = 0.0
                        actuation(p, t, x, u + sign * _CHANGE * pushes[k], push)
                        force += sign / (2.0 * _CHANGE) * push
                    if extra == 0:
                        put(slope[q:], rate[:q])
                    else:  # q' = N(q) v, and B may turn with q
                        put(x[:q], moved[:q])
                        put(slope[q:], moved[q:])
                        position_rates(p, t, moved, rates)
                        put(rates[:q], rate[:q])
                        put(x[q:], moved[q:])
                        change = _CHANGE / (1.0 + np.abs(slope[:q]).max())
                        for sign in _BOTH:
                            put(x[:q] + sign * change * slope[:q], moved[:q])
                            push[:] = 0.0
                            actuation(p, t, moved, u, push)
                            force += sign / (2.0 * change) * push
                            position_rates(p, t, moved, rates)
                            put(rate[:q] + sign / (2.0 * change) * rates[:q], rate[:q])
                    _solve(joints, coupling, modal, force)
                    put(force, rate[q:])
            complete_step(now, slopes, h)
        put(now, ends[piece])
