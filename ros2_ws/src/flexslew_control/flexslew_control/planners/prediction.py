"""What a plan promises: its flight on the planner's own model, tick by tick as on the bench."""

from typing import NamedTuple

import numpy as np

from flexslew_control.plan import Plan
from flexslew_control.planners.slew import Slew
from flexslew_plant.arrays import Matrix, Vector, compiled
from flexslew_plant.testbeds.dynamics import take_steps
from flexslew_plant.testbeds.kernels import Kernels

WATCHED = 40.0  # after the end of the plan [s]


class Prediction(NamedTuple):
    """The residuals, defined as in metrics.json."""

    tip_deflection: float  # largest |tip deflection| after the plan's end [m]
    attitude_error: Vector  # largest |joint - goal| after the plan's end, (joints,) [rad or m]


def predicted(plan: Plan, slew: Slew) -> Prediction:
    """Return the residuals of a plan that is flown on the model that its planner believes in.

    The feedback is the PD that the planner counts with, about the plan, held over every tick
    together with the feedforward and limited by the drives, as on the bench.

    Args:
        plan: on the ticks of the bench.
        slew: what was asked for.
    """
    model = slew.model
    after = int(np.ceil(WATCHED / plan.period))
    last = int(np.ceil(plan.duration / plan.period - 1e-9))

    def held(rows: Matrix, end: Vector) -> Matrix:
        return np.vstack((rows, np.tile(end, (after, 1))))

    rest = np.zeros(model.joints)
    path = _flown(
        model.kernels,
        model.packed,
        np.concatenate((model.rest(slew.named(slew.start)), np.zeros(model.coordinates))),
        held(plan.position[:-1], plan.position[-1]),
        held(plan.velocity[:-1], rest),
        held(plan.effort, rest),
        slew.kp,
        slew.kd,
        slew.effort_limit,
        plan.period,
        model.coordinates,
    )[last:]
    tips = path[:, model.joints : model.coordinates] @ model.appendages.tip.T
    away = np.abs(path[:, : model.joints] - plan.position[-1])
    return Prediction(float(np.abs(tips).max(initial=0.0)), away.max(axis=0))


@compiled
def _flown(
    kernels: Kernels,
    p: Vector,
    start: Vector,
    position: Matrix,
    velocity: Matrix,
    effort: Matrix,
    kp: Vector,
    kd: Vector,
    limit: Vector,
    period: float,
    n: int,
) -> Matrix:
    """Return the states at the ticks, shape (ticks + 1, 2 n), for a testbed with q' = v."""
    ticks, m = effort.shape
    path, x, u = np.empty((ticks + 1, start.size)), start.copy(), np.empty(m)
    path[0] = x
    for k in range(ticks):
        for j in range(m):
            u[j] = effort[k, j] + kp[j] * (position[k, j] - x[j])
            u[j] += kd[j] * (velocity[k, j] - x[n + j])
            u[j] = min(max(u[j], -limit[j]), limit[j])
        take_steps(kernels, p, k * period, u, period, 1, n, m, x)
        path[k + 1] = x
    return path
