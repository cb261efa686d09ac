"""A flight together with its exact derivatives: by numbers of the equations, state and effort.

The variational equations of M(q, t) a + h(q, v, t) = B u, x = [q, v], with s = dx/d theta (Hairer,
Norsett and Wanner 1993, I.14):

    M da = -(dr/dq s_q + dr/dv s_v + dr/dp dp/d theta) + B du/d theta at fixed a,
    r = M a + h - B u,

take the same steps as the flight, so that s is the derivative of what the integrator computes.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple, cast

import numpy as np
from numba import types

from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector, called, compiled, put
from flexslew_plant.machine_code.read_only import read_only
from flexslew_plant.testbeds.compiled import mass
from flexslew_plant.testbeds.compiled.bound import Bound
from flexslew_plant.testbeds.compiled.dynamics import (
    STAGE_TIMES,
    STAGES,
    complete_step,
    stage_state,
)

_CHANGE = 2.0**-10  # differences of M, h and B by p, of B and N by q: exact where quadratic
_SIGNS: Vector = np.array([1.0, -1.0])  # signs of a change
_factor = called(mass.factor.py_func)  # type: ignore[attr-defined]
_solve = called(mass.solve.py_func)  # type: ignore[attr-defined]
_solve_rows = called(mass.solve_rows.py_func)  # type: ignore[attr-defined]


class BlockSizes(NamedTuple):
    """The sizes of a testbed's equations that a state does not show."""

    square: int  # of the joint block of M
    extra: int  # how many entries q has more than v


class Directions(NamedTuple):
    """The parameters by which derivatives are taken: row k is how the numbers change with theta_k.

    No rows of `along` where no packed parameter changes.
    """

    p: Vector  # packed parameters of the equations
    along: Matrix  # dp/d theta, shape (parameters or 0, p.size)
    effort_slopes: Matrix  # du/d theta, shape (parameters, actuators)


class HeldPieces(NamedTuple):
    """Pieces of a flight with the effort held, each from its begin to its end.

    Begins and ends are a state, then its derivatives; those of one entry of the state by all
    parameters are next to each other. A begin is read when its piece is integrated: it may be the
    end before it.
    """

    effort: Matrix  # shape (pieces, actuators) [N m or N]
    starts: Vector  # times of the begins, shape (pieces,) [s]
    durations: Vector  # shape (pieces,) [s]
    steps: Indices  # equal ones of order 8, shape (pieces,)
    begins: Matrix
    ends: Matrix  # out


def flight_with_slopes(
    equations: Bound,
    directions: Directions,
    start: Vector,
    start_slopes: Matrix,
    effort: Matrix,
    period: float,
    sizes: BlockSizes,
) -> tuple[Matrix, Matrix]:
    """Return the states at the ticks and their derivatives by parameters.

    Args:
        equations: of the testbed.
        directions: the parameters.
        start: state [q, v].
        start_slopes: its derivatives, shape (parameters, size of a state).
        effort: held over every tick, shape (ticks, actuators) [N m or N].
        period: one tick [s], one step of order 8.
        sizes: of the equations.

    Returns:
        shapes (ticks + 1, size of a state) and (ticks + 1, parameters, size of a state).
    """
    ticks, count = len(effort), len(start_slopes)
    path = np.empty((ticks + 1, start.size * (1 + count)))
    path[0] = np.concatenate((start, start_slopes.T.ravel()))
    starts, durations = period * np.arange(ticks, dtype=np.float64), np.full(ticks, period)
    one = np.ones(ticks, dtype=np.int64)
    pieces = HeldPieces(effort, starts, durations, one, path[:-1], path[1:])
    _simulate(equations, directions, pieces, sizes)
    slopes = path[:, start.size :].reshape(ticks + 1, start.size, count)
    return path[:, : start.size], slopes.swapaxes(1, 2)


def slopes_of_pieces(
    equations: Bound,
    p: Vector,
    states: Matrix,
    effort: Matrix,
    durations: Vector,
    steps: Indices,
    columns: Indices,
    sizes: BlockSizes,
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
        sizes: of the equations.

    Returns:
        shapes (k, size, size), zero but in these columns, and (k, size, actuators).
    """
    (k, size), m, c = states.shape, effort.shape[1], columns.size
    first = np.zeros((size, c + m))
    first[columns, np.arange(c)] = 1.0
    begins = np.hstack((states, np.tile(first.ravel(), (k, 1))))
    ends, starts = np.empty_like(begins), np.cumsum(durations) - durations
    directions = Directions(p, np.zeros((0, p.size)), np.vstack((np.zeros((c, m)), np.eye(m))))
    pieces = HeldPieces(effort, starts, durations, steps, begins, ends)
    _simulate(equations, directions, pieces, sizes)
    slopes = ends[:, size:].reshape(k, size, c + m)
    by_state = np.zeros((k, size, size))
    by_state[:, :, columns] = slopes[:, :, :c]
    return by_state, np.ascontiguousarray(slopes[:, :, c:])


def _simulate(
    equations: Bound, directions: Directions, pieces: HeldPieces, sizes: BlockSizes
) -> None:
    """Write the ends of pieces."""
    first = equations.terms, equations.residual_jacobian
    functions = *first, equations.actuation, equations.position_rates
    _kernel()(*functions, directions, pieces, sizes)


@lru_cache
def _kernel() -> Callable[..., None]:
    """Return _simulate_pieces as machine code, the same for all testbeds."""
    vector, matrix = types.Array(types.float64, 1, "C"), types.Array(types.float64, 2, "C")
    read, t = read_only(vector), types.float64
    steps = types.Array(types.int64, 1, "C")
    kernel: Any = compiled(_simulate_pieces)
    kernel.compile(
        types.void(
            types.FunctionType(types.void(read, t, read, matrix, matrix, vector, vector)),
            types.FunctionType(types.void(read, t, read, read, matrix, matrix)),
            types.FunctionType(types.void(read, t, read, read, vector)),
            types.FunctionType(types.void(read, t, read, vector)),
            types.NamedTuple((vector, matrix, matrix), Directions),
            types.NamedTuple((matrix, vector, vector, steps, matrix, matrix), HeldPieces),
            types.NamedUniTuple(types.int64, 2, BlockSizes),
        )
    )
    kernel.disable_compile()  # never for the type of one testbed's function
    return cast(Callable[..., None], kernel)


@called
def _add_inertia(
    joints: Matrix, coupling: Matrix, modal: Vector, a: Vector, residual: Vector
) -> None:
    """Add M a, M given by its blocks."""
    square = len(joints)
    for j in range(square):
        for c in range(square):
            residual[j] += joints[j, c] * a[c]
        for c in range(len(modal)):
            residual[j] += coupling[j, c] * a[square + c]
            residual[square + c] += coupling[j, c] * a[j]
    for c in range(len(modal)):
        residual[square + c] += modal[c] * a[square + c]


@called
def _add_actuation_slope(
    actuation: Callable[..., None],
    p: Vector,
    t: float,
    x: Vector,
    u: Vector,
    work: tuple[Vector, Vector, Vector],
    dq: Matrix,
) -> None:
    """Subtract d(B u)/dq from dq.

    Most actuators push alike wherever the craft is: where all of q moves at once, each entry by its
    own length, and B u stays the same to the last bit, there is nothing to subtract.
    """
    shifted, push, same = work
    (n, q), state_dependent = dq.shape, False
    put(x, shifted)
    push[:] = 0.0
    same[:] = 0.0
    for c in range(q):
        shifted[c] += _CHANGE * (1.0 + np.sqrt(2.0 + c))
    actuation(p, t, x, u, push)
    actuation(p, t, shifted, u, same)
    for j in range(n):
        state_dependent |= push[j] != same[j]
    put(x, shifted)
    for c in range(q * int(state_dependent)):
        for sign in _SIGNS:
            shifted[c] = x[c] + sign * _CHANGE
            push[:] = 0.0
            actuation(p, t, shifted, u, push)
            for j in range(n):
                dq[j, c] -= sign / (2.0 * _CHANGE) * push[j]
        shifted[c] = x[c]


@called
def _write_kinematics(
    position_rates: Callable[..., None],
    p: Vector,
    t: float,
    x: Vector,
    work: tuple[Vector, Vector],
    kinematics: Matrix,
) -> None:
    """Write the derivatives of q' = N(q) v by q and v, shape (positions, size of a state)."""
    shifted, rates = work
    q, size = kinematics.shape
    put(x, shifted)
    kinematics[:] = 0.0
    for c in range(q):
        for sign in _SIGNS:
            shifted[c] = x[c] + sign * _CHANGE
            position_rates(p, t, shifted, rates)
            for j in range(q):
                kinematics[j, c] += sign / (2.0 * _CHANGE) * rates[j]
        shifted[c] = x[c]
    shifted[q:] = 0.0
    for c in range(q, size):
        shifted[c] = 1.0
        position_rates(p, t, shifted, rates)
        shifted[c] = 0.0
        for j in range(q):
            kinematics[j, c] = rates[j]


@called
def _add_product(factors: Matrix, slopes: Matrix, sign: float, out: Matrix) -> None:
    """Add a matrix times slopes, all of one row of them at a time, but for what is zero."""
    for j in range(factors.shape[0]):
        for c in range(factors.shape[1]):
            factor = sign * factors[j, c]
            if factor != 0.0:
                for k in range(slopes.shape[1]):
                    out[j, k] += factor * slopes[c, k]


@called
def _add_effort_slopes(
    actuation: Callable[..., None],
    p: Vector,
    t: float,
    x: Vector,
    u: Vector,
    effort_slopes: Matrix,
    force: Matrix,
) -> None:
    """Add B du/d theta to the forces of every parameter, a column each."""
    shifted_effort, push = np.empty(u.size), np.empty(force.shape[0])
    for k in range(len(effort_slopes)):
        for sign in _SIGNS[: 2 * int(effort_slopes[k].any())]:
            for i in range(u.size):
                shifted_effort[i] = u[i] + sign * _CHANGE * effort_slopes[k, i]
            push[:] = 0.0
            actuation(p, t, x, shifted_effort, push)
            for j in range(push.size):
                force[j, k] += sign / (2.0 * _CHANGE) * push[j]


def _simulate_pieces(
    terms: Callable[..., None],
    residual_jacobian: Callable[..., None],
    actuation: Callable[..., None],
    position_rates: Callable[..., None],
    directions: Directions,
    pieces: HeldPieces,
    sizes: BlockSizes,
) -> None:
    """Write the ends of pieces."""
    p, along, effort_slopes = directions
    effort, starts, durations, steps, begins, ends = pieces
    square, extra = sizes
    count, width = effort_slopes.shape[0], begins.shape[1]
    size = width // (1 + count)
    n = (size - extra) // 2
    q = size - n  # entries of q
    joints, coupling = np.empty((square, square)), np.empty((square, n - square))
    modal, a, rates = np.empty(n - square), np.empty(n), np.empty(size)
    factors, scale = np.empty_like(joints), np.empty_like(modal)
    other = np.empty_like(joints), np.empty_like(coupling), np.empty_like(modal)
    residual, forces = np.empty(n), np.empty(n * count)
    force = forces.reshape((n, count))
    dq, dv, kinematics = np.empty((n, q)), np.empty((n, n)), np.empty((q, size))
    shifted, push = np.empty(size), np.empty(n)
    now, at, slopes = np.empty(width), np.empty(width), np.empty((STAGES, width))
    x, state_slopes = at[:size], at[size:].reshape((size, count))
    for piece in range(effort.shape[0]):
        u, h = effort[piece], durations[piece] / steps[piece]
        put(begins[piece], now)
        for step in range(steps[piece]):
            for i in range(STAGES):
                stage_state(now, slopes, i, h, at)
                t = starts[piece] + (step + STAGE_TIMES[i]) * h
                terms(p, t, x, joints, coupling, modal, residual)
                a[:] = 0.0
                actuation(p, t, x, u, a)
                a -= residual
                for j in range(square):
                    put(joints[j], factors[j])
                _factor(factors, coupling, modal)
                _solve(factors, coupling, modal, a)
                position_rates(p, t, x, rates)
                put(rates[:q], slopes[i, :q])
                put(a, slopes[i, q:size])
                residual_jacobian(p, t, x, a, dq, dv)
                rate = slopes[i, size:].reshape((size, count))
                if extra == 0:
                    for j in range(n):
                        put(state_slopes[q + j], rate[j])
                else:  # q' = N(q) v, and B may turn with q
                    _add_actuation_slope(actuation, p, t, x, u, (shifted, residual, push), dq)
                    _write_kinematics(position_rates, p, t, x, (shifted, rates), kinematics)
                    rate[:q] = 0.0
                    _add_product(kinematics, state_slopes, 1.0, rate)
                forces[:] = 0.0
                _add_product(dq, state_slopes, -1.0, force)
                _add_product(dv, state_slopes[q:], -1.0, force)
                _add_effort_slopes(actuation, p, t, x, u, effort_slopes, force)
                for k in range(len(along)):  # dr/dp along the parameter
                    for sign in _SIGNS:
                        shifted_p = p + sign * _CHANGE * along[k]
                        terms(shifted_p, t, x, *other, residual)
                        push[:] = 0.0
                        actuation(shifted_p, t, x, u, push)
                        residual -= push
                        _add_inertia(*other, a, residual)
                        for j in range(n):
                            force[j, k] -= sign / (2.0 * _CHANGE) * residual[j]
                _solve_rows(joints, coupling, modal, scale, forces, count)
                put(forces, slopes[i, size + q * count :])
            complete_step(now, slopes, h)
        put(now, ends[piece])
