"""Time-optimal slews of the linearised model by duality: the least duration and its switches.

With the time tau before the end and c(tau) = C e^(A tau) B, an effort u ends at C x = goal where
    integral of c(tau) u(tau) = goal,
and the largest |u| that is needed in a duration T is, at the least,
    max over mu of (mu . goal) / F(mu),    F = integral of |mu . c|.
F is convex. A linear program over efforts that are constant on cells of time comes near to its
minimum on mu . goal = 1, and Newton's method goes on from there. T is least where that minimum
equals 1/amplitude; the effort then is the sign of mu . c, and no slew of the linear model is
faster. With the sensitivity s of a bench under the feedback,
    x' = A x + B u,    s' = (A - B K) s + (dA/dk) x,
the robust slew is that of the state (x, s).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import linprog

from flexslew_control.planners.time_optimal.bang_bang import BangBang
from flexslew_control.planners.time_optimal.linear.impulse_responses import (
    ImpulseResponses,
    sampled,
)
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import PlanFailed

_CHANGE = 1e-4  # of the stiffness, for dA/dk
_MAX_DURATION = 12.0  # searched, times the rigid duration and one period
_STEP = 0.0125  # of the grid, as an angle of the fastest mode [rad]
_CELL = 0.1  # of the linear program, as _STEP
_CELLS = 300, 3000  # of them, at least and at most
_RANK_TOLERANCE = 1e-12  # of the conditions' largest singular value
_WIDTHS = 0.01, 3e-3, 1e-3, 3e-4, 1e-4  # of the smoothing, relative to the mean of |mu . c|
_ITERATIONS, _DURATIONS = 10, 20
_CONDITION_RANGE = 1e3, 1e11  # condition of c, from which to which its rows are combined


class Structure(NamedTuple):
    """The arcs of the fastest slew of the linear model."""

    durations: Vector  # the first one with a positive effort [s]
    curvature: Matrix  # of multipliers^T r by the durations, where dr/dd^T multipliers = 1 [1/s]


class LinearOptimum(NamedTuple):
    """What is known of the fastest slew of the linear model."""

    duration: float  # no slew of the linear model is shorter [s]
    structure: Structure | None  # None: an arc of no length


def linear_optimum(slew: BangBang) -> LinearOptimum:
    """Return the time-optimal slew of the model linearised at the start.

    Raises:
        PlanFailed: it takes too long, or starts away from the goal.
    """
    a, b, conditions = extended(slew)
    goal = abs(slew.distance) / slew.amplitude
    linear = slew.model.linearise(slew.start[: slew.model.coordinates])
    rigid = slew.rigid_duration
    period = 2.0 * np.pi / float(linear.frequencies[0])
    step, max_duration = _STEP / float(linear.frequencies[-1]), rigid + 2.0 * period
    grid = sampled(a, b, conditions, step, max_duration)
    combined = _separate_rows(conditions, grid)
    if combined is not conditions:
        conditions, grid = combined, sampled(a, b, combined, step, max_duration)
    max_frequency = float(linear.frequencies[-1])
    while _linear_solution(grid, max_duration, max_frequency, goal)[0] < 1.0:
        max_duration *= 1.5
        if max_duration > _MAX_DURATION * (rigid + period):
            raise PlanFailed(
                f"no slew by {slew.distance:g} at {slew.amplitude:g} takes under "
                f"{max_duration:.4g} s"
            )
        grid = sampled(a, b, conditions, step, max_duration)
    duration, mu = _least_duration(
        grid,
        lambda duration, _: _linear_solution(grid, duration, max_frequency, goal),
        (rigid, min(max_duration, rigid + 0.5 * period), max_duration),
        np.zeros(len(conditions)),
        1e-3,
    )
    scale = np.abs(grid.values[:, 0]).max(axis=0)
    duration, mu = _least_duration(
        grid,
        lambda duration, mu: _least(grid, mu, duration, scale),
        (rigid, duration, max_duration),
        mu,
        1e-9,
    )
    if grid.at(np.array([duration]))[0] @ mu < 0.0:
        raise PlanFailed("the fastest slew of the linear model starts backwards")
    return LinearOptimum(duration, _structure(grid, mu, duration))


def _least_duration(
    grid: ImpulseResponses,
    least_at: Callable[[float, Vector], tuple[float, Vector]],
    bracket: tuple[float, float, float],
    mu: Vector,
    tolerance: float,
) -> tuple[float, Vector]:
    """Return the T at which the least F is 1, and its mu."""
    low, duration, high = bracket
    for _ in range(_DURATIONS):
        least, mu = least_at(duration, mu)
        low, high = (duration, high) if least < 1.0 else (low, duration)
        step = (1.0 - least) / abs(float(grid.at(np.array([duration]))[0] @ mu))
        if abs(step) < tolerance * duration:
            return duration + step, mu
        duration = duration + step if low < duration + step < high else 0.5 * (low + high)
    return duration, mu


def _linear_solution(
    grid: ImpulseResponses, duration: float, max_frequency: float, goal: float
) -> tuple[float, Vector]:
    """Return the least F and its mu where efforts change at the ends of cells of time alone.

    The linear program is max over |u| <= 1 of the first row of sum c u, the others held at zero.
    """
    cells = int(np.clip(duration * max_frequency / _CELL, *_CELLS))
    reached = np.diff(grid.integral_at(np.linspace(0.0, duration, cells + 1)), axis=0)
    scale = np.abs(reached).max(axis=0)
    first, others = (reached / scale)[:, 0], (reached / scale)[:, 1:]
    # conditions that are nearly alike, made unlike; dependent ones are left out
    left, size, right = np.linalg.svd(others, full_matrices=False)
    new = size > _RANK_TOLERANCE * size[0]
    rows = np.sqrt(cells) * left[:, new].T
    found = linprog(-first, A_eq=rows, b_eq=np.zeros(len(rows)), bounds=(-1.0, 1.0))
    if found.x is None:
        raise PlanFailed(f"the linear program of a slew in {duration:.4g} s: {found.message}")
    y = right[new].T @ (np.sqrt(cells) * found.eqlin.marginals / size[new]) / scale[1:]
    return float(first @ found.x * scale[0] / goal), np.append(1.0, scale[0] * y) / goal


def _structure(grid: ImpulseResponses, mu: Vector, duration: float) -> Structure | None:
    """Return the arcs of the effort sign(mu . c); None if one has no length."""
    zeros = grid.zeros(mu, duration)
    edges = np.concatenate(([0.0], zeros, [duration]))[::-1]
    first = float(grid.at(edges[:1])[0] @ mu)
    # a duration moves every edge before its end; by the edges the second derivatives are diagonal
    weights = np.append(1.0, 2.0 * (-1.0) ** np.arange(1, edges.size - 1))
    by_edge = weights * (grid.at(edges[:-1], 1) @ mu) / first
    cumulative = np.triu(np.ones((by_edge.size, by_edge.size)))
    durations = -np.diff(edges)
    if durations.min() <= 0.0:
        return None
    return Structure(durations, cumulative.T @ (by_edge[:, None] * cumulative))


def extended(slew: BangBang) -> tuple[Matrix, Vector, Matrix]:
    """Return A and B of the slew's state and its sensitivity, and the rows that must vanish."""
    n = slew.model.coordinates
    q, gains = slew.start[:n], np.zeros((2, slew.model.joints))
    gains[:, slew.joint] = slew.kp, slew.kd

    def state_matrix(factor: float) -> Matrix:
        return slew.model.with_stiffness(factor).linearise(q).state_matrix

    linear = slew.model.linearise(q)
    a, b = linear.state_matrix, linear.state_input_matrix[:, slew.joint]
    if not slew.robust:
        return a, b, slew.rest_rows
    closed = linear.with_feedback(*gains).state_matrix
    by_stiffness = (state_matrix(1.0 + _CHANGE) - state_matrix(1.0 - _CHANGE)) / (2.0 * _CHANGE)
    whole = np.block([[a, np.zeros_like(a)], [by_stiffness, closed]])
    rows = block_diag(slew.rest_rows, slew.sensitivity_rows)
    return whole, np.concatenate((b, np.zeros(2 * n))), rows


def _separate_rows(conditions: Matrix, grid: ImpulseResponses) -> Matrix:
    """Return the rows, all but the first combined where c is nearly the same for some of them.

    Two close modes and their sensitivities answer nearly alike. What has to vanish may be combined;
    the combinations answer at right angles.
    """
    samples = grid.values[:, 0, 1:]
    scale = np.abs(samples).max(axis=0)
    if not scale.all():
        return conditions
    triangle = np.linalg.qr(samples / scale)[1]
    if not _CONDITION_RANGE[0] < np.linalg.cond(triangle) < _CONDITION_RANGE[1]:
        return conditions
    combined = np.linalg.solve(triangle.T, conditions[1:] / scale[:, None])
    return np.vstack((conditions[:1], combined))


def _least(
    grid: ImpulseResponses, mu: Vector, duration: float, scale: Vector
) -> tuple[float, Vector]:
    """Return the least F and its mu, the first entry held, by Newton's method."""
    mu = _smoothed(grid, mu, duration, scale)
    value, slope, curvature = _integral(grid, mu, duration, scale)
    for _ in range(_ITERATIONS):
        ridge = 1e-13 * np.trace(curvature) + 1e-300
        step = -np.linalg.lstsq(curvature + ridge * np.eye(slope.size), slope, rcond=None)[0]
        expected = float(-slope @ step)
        if expected < 1e-15 * value:
            break
        share = 1.0
        while share > 1e-3:
            new = mu + np.append(0.0, share * step / scale[1:])
            at = _integral(grid, new, duration, scale)
            if at[0] <= value - 1e-4 * share * expected:
                break
            share *= 0.5
        else:
            break
        mu, (value, slope, curvature) = new, at
    return value, mu


@np.errstate(over="raise", invalid="raise")  # for a way of zero: the planner reports it
def _smoothed(grid: ImpulseResponses, mu: Vector, duration: float, scale: Vector) -> Vector:
    """Return mu at the least integral of sqrt((mu . c)^2 + e^2) for an e that falls to little.

    F itself has a curvature at zeros of mu . c alone, too few of them far from its minimum.
    """
    samples = grid.values[: int(duration / grid.step) + 1, 0]
    fixed, rest = mu[0] * samples[:, 0], samples[:, 1:] / scale[1:]
    y = mu[1:] * scale[1:]
    for width in _WIDTHS:
        e = width * float(np.abs(fixed + rest @ y).mean())
        f = fixed + rest @ y
        value = float(np.sqrt(f**2 + e**2).sum())
        for _ in range(_ITERATIONS):
            root = np.sqrt(f**2 + e**2)
            slope = rest.T @ (f / root)
            curvature = (rest.T * (e**2 / root**3)) @ rest
            step = -np.linalg.lstsq(curvature, slope, rcond=1e-15)[0]
            expected, share = float(-slope @ step), 1.0
            if expected < 1e-9 * value:
                break
            while share > 1e-3:
                new = fixed + rest @ (y + share * step)
                least = float(np.sqrt(new**2 + e**2).sum())
                if least <= value - 1e-4 * share * expected:
                    break
                share *= 0.5
            else:  # a step that makes things worse leads away for good
                break
            y, f, value = y + share * step, new, least
    return np.append(mu[0], y / scale[1:])


def _integral(
    grid: ImpulseResponses, mu: Vector, duration: float, scale: Vector
) -> tuple[float, Vector, Matrix]:
    """Return F and its derivatives by all entries of mu but the first, times their scales."""
    zeros = grid.zeros(mu, duration)
    edges = np.concatenate(([0.0], zeros, [duration]))
    middle = grid.at(0.5 * (edges[1:] + edges[:-1])) @ mu
    pieces = np.sign(middle) @ np.diff(grid.integral_at(edges), axis=0)
    values = grid.at(zeros)[:, 1:] / scale[1:]
    slopes = np.abs(grid.at(zeros, 1) @ mu)
    curvature = (2.0 / np.maximum(slopes, 1e-300) * values.T) @ values
    return float(pieces @ mu), pieces[1:] / scale[1:], curvature
