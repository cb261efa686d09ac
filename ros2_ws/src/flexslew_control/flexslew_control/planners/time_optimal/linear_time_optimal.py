"""Time-optimal slews of the linearised model by linear programming: the structure of the arcs.

For a duration T the smallest |u| that meets the end conditions, u constant on each of N intervals,
is a linear programme. The T at which it equals the amplitude is the least one, and the signs of u
tell the switches, to about T/N. With the sensitivity s of a bench under the feedback,
    x' = A x + B u,    s' = (A - B K) s + (dA/dk) x,
the robust slew is that of the state (x, s).
"""

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq, linprog

from flexslew_control.planners.time_optimal.switching import BangBang
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import PlanFailed

_CHANGE = 1e-4  # of the stiffness, for dA/dk
_LONGEST = 12.0  # searched, times the rigid duration and one period


def programmed_durations(slew: BangBang, intervals: int) -> Vector:
    """Return the arcs of the linear slew, good to one interval [s].

    Args:
        slew: its model is linearised at the start.
        intervals: N; arcs shorter than one are not found.

    Raises:
        PlanFailed: it takes too long.
    """
    a, b, conditions = _extended(slew)
    goal = np.zeros(len(conditions))
    goal[0] = abs(slew.distance) / slew.amplitude

    def effort(duration: float) -> Vector:
        return _least_effort(a, b, conditions, goal, duration / intervals, intervals)

    period = 2.0 * np.pi / slew.model.linearise(slew.start[: slew.model.coordinates]).frequencies[0]
    shortest = slew.rigid_duration
    longest = shortest + period
    while np.abs(effort(longest)).max() > 1.0:
        longest *= 1.5
        if longest > _LONGEST * (shortest + period):
            raise PlanFailed(
                f"no slew by {slew.distance:g} within {longest:.4g} s at {slew.amplitude:g} N m "
                "was found; use a larger amplitude or another goal"
            )
    duration = brentq(
        lambda duration: np.abs(effort(duration)).max() - 1.0, shortest, longest, rtol=1e-4
    )
    switched = np.flatnonzero(np.diff(np.sign(effort(duration)))) + 1.0
    edges = np.concatenate(([0.0], switched, [float(intervals)]))
    return np.asarray(np.diff(edges) * (duration / intervals))


def _extended(slew: BangBang) -> tuple[Matrix, Vector, Matrix]:
    """Return A and B of the slew's state and its sensitivity, and the rows that must vanish."""
    n = slew.model.coordinates
    q, gains = slew.start[:n], np.zeros((2, slew.model.joints))
    gains[:, slew.joint] = slew.kp, slew.kd

    def state_matrix(factor: float) -> Matrix:
        return slew.model.with_stiffness(factor).linearise(q).state_matrix

    linear = slew.model.linearise(q)
    a, b = linear.state_matrix, linear.state_input_matrix[:, slew.joint]
    if not slew.robust:
        return a, b, np.eye(2 * n)[slew.rows]
    closed = linear.with_feedback(*gains).state_matrix
    by_stiffness = (state_matrix(1.0 + _CHANGE) - state_matrix(1.0 - _CHANGE)) / (2.0 * _CHANGE)
    whole = np.block([[a, np.zeros_like(a)], [by_stiffness, closed]])
    rows = np.concatenate((slew.rows, 2 * n + slew.insensitive_rows))
    return whole, np.concatenate((b, np.zeros(2 * n))), np.eye(4 * n)[rows]


def _least_effort(
    a: Matrix, b: Vector, conditions: Matrix, goal: Vector, step: float, intervals: int
) -> Vector:
    """Return the efforts of the intervals, shape (N,), whose largest is smallest."""
    size = b.size
    held = np.zeros((size + 1, size + 1))
    held[:size, :size], held[:size, size] = a, b
    held = expm(held * step)
    column, columns = held[:size, size], []
    for _ in range(intervals):
        columns.append(conditions @ column)
        column = held[:size, :size] @ column
    reached = np.array(columns[::-1]).T
    scale = np.abs(reached).max(axis=1, keepdims=True)
    one = np.ones((intervals, 1))
    found = linprog(
        np.append(np.zeros(intervals), 1.0),
        A_ub=np.block([[np.eye(intervals), -one], [-np.eye(intervals), -one]]),
        b_ub=np.zeros(2 * intervals),
        A_eq=np.column_stack((reached / scale, np.zeros(len(goal)))),
        b_eq=goal / scale[:, 0],
        bounds=[(None, None)] * (intervals + 1),
        method="highs",
    )
    if found.x is None:
        raise PlanFailed(f"the linear programme of a slew of {step * intervals:.4g} s failed")
    return np.asarray(found.x[:-1])
