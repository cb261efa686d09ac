"""Plans made exact for efforts that are held over every tick.

A planner thinks in continuous time; the drives hold an effort over a tick. The means over the ticks
miss the goal by a little, of second order in the period. The smallest change of the efforts that
brings the planner's model to rest at the goal again is found by Newton's method on
    x_N(u) = x_goal,    du = W G^T (G W G^T)^+ (x_goal - x_N),    G = dx_N/du,
where W weighs the room that each effort has below the limit: an effort at its limit stays there.
"""

from dataclasses import replace

import numpy as np

from flexslew_control.plan import Plan
from flexslew_control.planners.slew import Slew
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds import Model

_ROUNDS = 4
_CLOSE = 1e-11  # of the final state [rad, m and per second]
_SMALL = 0.02  # larger misses are the plan's own [rad, m and per second]


def exact_on_ticks(plan: Plan, slew: Slew) -> Plan:
    """Return the plan with efforts that end at rest at the goal when each is held over its tick.

    Its reference becomes the flight of the planner's model under these efforts. A plan that misses
    by more than the hold explains, or that has no room below the limits, is returned as it is.

    Args:
        plan: whose nominal states end at rest at the goal.
        slew: what was asked for.
    """
    model, m, n = slew.model, slew.model.joints, slew.model.coordinates
    limit = np.minimum(slew.effort_limit, plan.summary.get("amplitude", np.inf))
    goal = np.concatenate((model.rest(slew.named(slew.goal)), np.zeros(n)))
    effort = plan.effort.copy()
    states = _flown(model, plan.state[0], effort, plan.period)
    first = float(np.abs(goal - states[-1]).max())
    if not _CLOSE < first < _SMALL:
        return plan
    for _ in range(_ROUNDS):
        missed = goal - states[-1]
        if not np.isfinite(missed).all():  # a step far beyond what the slopes tell
            return plan
        if np.abs(missed).max() < _CLOSE:
            break
        slopes = _slopes(model, states, effort, plan.period)
        room = (np.maximum(limit - np.abs(effort), 0.0) ** 2).ravel()
        weighed = slopes * room
        change = weighed.T @ np.linalg.lstsq(weighed @ slopes.T, missed, rcond=1e-12)[0]
        effort = effort + change.reshape(effort.shape)
        states = _flown(model, plan.state[0], effort, plan.period)
    left = float(np.abs(goal - states[-1]).max())
    if not left < first or (np.abs(effort) > limit * (1.0 + 1e-12)).any():
        return plan
    position, velocity = states[:, :m].copy(), states[:, n : n + m].copy()
    position[-1], velocity[-1] = slew.goal, 0.0
    summary = {**plan.summary, "peak_effort": np.abs(effort).max(axis=0).tolist()}
    return replace(
        plan, position=position, velocity=velocity, effort=effort, state=states, summary=summary
    )


def _flown(model: Model, start: Vector, effort: Matrix, period: float) -> Matrix:
    """Return the states at the ticks, shape (ticks + 1, 2 n)."""
    states = np.empty((len(effort) + 1, start.size))
    states[0] = start
    for k, held in enumerate(effort):
        states[k + 1] = model.advance(states[k], held, period, t=k * period)
    return states


def _slopes(model: Model, states: Matrix, effort: Matrix, period: float) -> Matrix:
    """Return dx_N/du, shape (2 n, ticks joints), from the Jacobian in the middle of each tick."""
    size = states.shape[1]
    slopes = np.empty((size, *effort.shape))
    later, whole = np.eye(size), np.eye(size)
    for k in range(len(effort) - 1, -1, -1):
        middle = 0.5 * (states[k] + states[k + 1])
        dx, du = model.jacobian(middle, effort[k], (k + 0.5) * period)
        turn = period * dx
        slopes[:, k] = later @ (period * (whole + 0.5 * turn) @ du)
        later = later @ (whole + turn + 0.5 * turn @ turn)
    return slopes.reshape(size, -1)
