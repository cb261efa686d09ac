"""Plans made exact for efforts that are held over every tick.

Planners compute efforts in continuous time; the drives hold an effort over a tick. The means over
the ticks miss the goal by a little, of second order in the period. The smallest change of the
efforts that brings the planner's model to rest at the goal again follows by Newton's method on
    x_N(u) = x_goal,    du = W G^T (G W G^T)^+ (x_goal - x_N),    G = dx_N/du,
where W weighs the room that each effort has below the limit: an effort at its limit stays there.
A plan with nominal states that miss the goal, as those of a robust shaper do, keeps its efforts:
without its residual at the nominal frequency it would be another shaper. All bounds are relative to
the way to the goal, so that plans of linear plants scale with it.
"""

from dataclasses import replace

import numpy as np

from flexslew_control.plan import Plan
from flexslew_control.planners.slew import Slew
from flexslew_plant.arrays import Indices, Matrix, Vector
from flexslew_plant.testbeds import Model

_ITERATIONS = 4
# of the way to the goal, for rates per second
_CLOSE = 1e-11  # of the final state [-]
_SMALL = 0.02  # larger misses are the plan's own [-]
_COMPUTED = 1e-4  # smaller ones of nominal states are errors of their computation [-]
_GAP = 2e-4  # that efforts close without a change of what is left [-]


def exact_on_ticks(plan: Plan, slew: Slew, limit: Vector) -> Plan:
    """Return the plan with efforts that end at rest at the goal when each is held over its tick.

    Its reference becomes the flight of the planner's model under these efforts. A plan is returned
    as it is if it misses by more than the hold explains, if its nominal states miss the goal by
    more than the hold changes them, or if it has no room below the limits.

    Args:
        plan: a plan with nominal states that end at rest at the goal.
        slew: the requested slew.
        limit: largest efforts, shape (joints,) [N m or N].
    """
    limit = np.minimum(limit, plan.summary.get("amplitude", np.inf))
    found = _correct_efforts(plan, slew, limit) or plan
    if found is plan:
        return plan
    summary = {**plan.summary, "peak_effort": np.abs(found.effort).max(axis=0).tolist()}
    return replace(found, summary=summary)


def joints_at_rest(plan: Plan, slew: Slew, limit: Vector) -> Plan:
    """Return the plan with a reference that ends at rest at the goal, modes as they are.

    The optimum of an ensemble leaves the nominal joints off the goal, but a reference has to end
    where it is held afterwards. A small change of the efforts closes a small gap under any law. A
    larger gap belongs to the optimum of the loop, and the total efforts then stay as they are:
    with s = t / T at the ticks, the reference is bent from r to r + d,
        d = e (3 s^2 - 2 s^3) + w T (s^3 - s^2),
    where e and w are the errors of position and rate at the end, and the feedforward gives
    -Kp d - Kd d' in addition.

    Args:
        plan: a plan with the flight of its nominal states as reference.
        slew: the requested slew, with the feedback that the plan assumes.
        limit: largest efforts that close a small gap, shape (joints,) [N m or N].
    """
    if end_error(plan, slew) <= _GAP * slew.way:
        found = _correct_efforts(plan, slew, limit, only_joints=True)
        if found is not None:
            return found
    m, n = slew.model.joints, slew.model.coordinates
    short, rate = slew.goal - plan.state[-1, :m], -plan.state[-1, n : n + m]
    end, s = plan.ticks * plan.period, np.linspace(0.0, 1.0, plan.ticks + 1)[:, None]
    state, correction = plan.state.copy(), np.empty((2, plan.ticks + 1, m))
    correction[0] = short * (s * s * (3.0 - 2.0 * s)) + rate * end * (s * s * (s - 1.0))
    correction[1] = short / end * (6.0 * s * (1.0 - s)) + rate * (s * (3.0 * s - 2.0))
    state[:, :m] += correction[0]
    state[:, n : n + m] += correction[1]
    state[-1, :m], state[-1, n : n + m] = slew.goal, 0.0
    return replace(
        plan,
        position=state[:, :m].copy(),
        velocity=state[:, n : n + m].copy(),
        effort=plan.effort - slew.kp * correction[0, :-1] - slew.kd * correction[1, :-1],
        state=state,
    )


def end_error(plan: Plan, slew: Slew) -> float:
    """Return the most that nominal joints lack of rest at the goal [rad or m, and per second]."""
    goal, rows = _target(slew, only_joints=True)
    return float(np.abs(goal - plan.state[-1])[rows].max())


def _target(slew: Slew, only_joints: bool) -> tuple[Vector, Indices]:
    """Return the final state, (2 n,), and the indices of its entries that are required."""
    m, n = slew.model.joints, slew.model.coordinates
    goal = np.concatenate((slew.model.rest(slew.named(slew.goal)), np.zeros(n)))
    rows = [*range(m), *range(n, n + m)] if only_joints else range(2 * n)
    return goal, np.array(rows)


def _correct_efforts(
    plan: Plan, slew: Slew, limit: Vector, only_joints: bool = False
) -> Plan | None:
    """Return the plan with efforts that end at rest at the goal; None: there are none.

    A plan that is there already, or too far away for the hold, is returned as it is.
    """
    model, m, n = slew.model, slew.model.joints, slew.model.coordinates
    goal, rows = _target(slew, only_joints)
    most = np.inf if only_joints else _SMALL * slew.way
    effort = plan.effort.copy()
    states = _simulate(slew, plan.state[0], effort)
    first = float(np.abs((goal - states[-1])[rows]).max())
    if not _CLOSE * slew.way < first < most:
        return plan
    if not only_joints and _has_nominal_error(plan, goal, states[-1], _COMPUTED * slew.way):
        return plan
    for _ in range(_ITERATIONS):
        error = (goal - states[-1])[rows]
        if not np.isfinite(error).all():  # a step beyond the validity of the slopes
            return None
        if np.abs(error).max() < _CLOSE * slew.way:
            break
        slopes = _slopes(model, states, effort, plan.period)[rows]
        change = least_change(slopes, (limit - np.abs(effort)).ravel(), error)
        effort = effort + change.reshape(effort.shape)
        states = _simulate(slew, plan.state[0], effort)
    left = float(np.abs((goal - states[-1])[rows]).max())
    if not left < first or (np.abs(effort) > limit * (1.0 + 1e-12)).any():
        return None
    position, velocity = states[:, :m].copy(), states[:, n : n + m].copy()
    position[-1], velocity[-1] = slew.goal, 0.0
    return replace(plan, position=position, velocity=velocity, effort=effort, state=states)


def least_change(slopes: Matrix, room: Vector, error: Vector) -> Vector:
    """Return the least change of efforts du with G du = e, weighed by their room below the limits.

    du = W G^T (G W G^T)^+ e, with W = diag(max(room, 0)^2).

    Args:
        slopes: G, of what e counts by the efforts, shape (rows, efforts).
        room: of each effort below its limit, shape (efforts,) [N m or N].
        error: e, shape (rows,).
    """
    weighted = slopes * np.maximum(room, 0.0) ** 2
    change: Vector = weighted.T @ np.linalg.lstsq(weighted @ slopes.T, error, rcond=1e-12)[0]
    return change


def _has_nominal_error(plan: Plan, goal: Vector, end: Vector, computed: float) -> bool:
    """Return whether the nominal states miss the goal by more than the hold changes them.

    Nominal states that are the flight under held efforts do not separate the two.
    """
    nominal_error, change = np.abs(goal - plan.state[-1]).max(), np.abs(end - plan.state[-1]).max()
    return bool(nominal_error > computed and nominal_error > change > 0.0)


def _simulate(slew: Slew, start: Vector, effort: Matrix) -> Matrix:
    """Return the states at the ticks, shape (ticks + 1, 2 n)."""
    return np.vstack((start, slew.model.path(start, effort, slew.period, slew.steps)))


def _slopes(model: Model, states: Matrix, effort: Matrix, period: float) -> Matrix:
    """Return dx_N/du, shape (2 n, ticks joints), from the Jacobian in the middle of each tick."""
    size = states.shape[1]
    slopes = np.empty((size, *effort.shape))
    later, whole = np.eye(size), np.eye(size)
    for k in range(len(effort) - 1, -1, -1):
        middle = 0.5 * (states[k] + states[k + 1])
        dx, du = model.jacobian(middle, effort[k], (k + 0.5) * period)
        delta = period * dx
        slopes[:, k] = later @ (period * (whole + 0.5 * delta) @ du)
        later = later @ (whole + delta + 0.5 * delta @ delta)
    return slopes.reshape(size, -1)
