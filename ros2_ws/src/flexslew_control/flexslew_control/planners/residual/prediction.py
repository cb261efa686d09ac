"""What a plan promises: its flight on the planner's own model, tick by tick as on the bench."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexslew_control.controllers.by_joint.pd_feedforward import pd_step
from flexslew_control.plan import Plan
from flexslew_control.planners.residual.closed_loop import FeedbackNumbers, closed_loop, feedback
from flexslew_control.planners.slew import Slew
from flexslew_plant.arrays import Indices, Matrix, Vector, called
from flexslew_plant.testbeds import initial_state

MIN_MONITOR_TIME = 40.0  # after the end of the plan, at least [s]
MAX_MONITOR_TICKS = 20_000  # ticks, where they are longer than that
_PERIODS = 1.25  # of the slowest swing, in which softer models show their largest deflection, too
_POLE_SINE = 0.1  # sine of the least angle of a pole from the real axis that swings
_ALLOWED, _TIP_FLOOR = 0.1, 1e-5  # more than from rest, of that [-] and beyond it [m]
_RIGID = 1e-7  # of the fastest pole: slower ones are zero but for rounding
_pd_step = called(pd_step)


class Prediction(NamedTuple):
    """The residuals, defined as in metrics.json."""

    tip_deflection: float  # largest |tip deflection| after the plan's end [m]
    attitude_error: Vector  # largest |joint - goal| after the plan's end, (joints,) [rad or m]
    peak: float  # largest |tip deflection| of the whole flight [m]


def monitor_time(poles: NDArray[np.complex128], period: float) -> float:
    """Return how long after a plan's end what it leaves is looked for [s].

    Args:
        poles: of the continuous motion about the goal, under the feedback [1/s].
        period: one tick [s].
    """
    rate = abs(poles)
    slow = rate[rate > _RIGID * rate.max(initial=0.0)]
    is_periodic = abs(poles.imag[rate > _RIGID * rate.max(initial=0.0)]) > _POLE_SINE * slow
    time_constants = np.where(is_periodic, 2.0 * np.pi * _PERIODS, 1.0) / slow
    return max(
        MIN_MONITOR_TIME, min(float(time_constants.max(initial=0.0)), MAX_MONITOR_TICKS * period)
    )


def predicted(plan: Plan, slew: Slew, in_motion: bool = False) -> Prediction:
    """Return the residuals of a plan that is flown on the planner's model.

    The feedback is the PD that the planner counts with, about the plan, held over every tick
    together with the feedforward and limited by the drives, as on the bench.

    Args:
        plan: on the ticks of the bench.
        slew: that was requested.
        in_motion: whether the flight begins at tick 0 with the motion with which the testbed starts
            and holds the first reference until the plan begins; else at rest with the plan.
    """
    model, before = slew.model, 0
    start = np.concatenate((model.rest(slew.named(slew.start)), np.zeros(model.coordinates)))
    if in_motion:
        model, before = slew.testbed.model(), plan.first_tick
        start = initial_state(slew.testbed)
    at_goal = model.linearise(model.rest(slew.named(slew.goal))).with_feedback(slew.kp, slew.kd)
    after = int(np.ceil(monitor_time(at_goal.eigenvalues, plan.period) / plan.period))
    last = int(np.ceil(plan.duration / plan.period - 1e-9))

    def extend(rows: Matrix, end: Vector, begin: Vector) -> Matrix:
        return np.vstack((np.tile(begin, (before, 1)), rows, np.tile(end, (after, 1))))

    rest, joints = np.zeros(model.joints), np.arange(model.joints)
    position = extend(plan.position[:-1], plan.position[-1], plan.position[0])
    numbers = FeedbackNumbers(
        np.hstack((position, extend(plan.velocity[:-1], rest, rest))),
        np.stack((slew.kp, slew.kd, slew.effort_limit)),
        np.concatenate((joints, model.coordinates + joints)),
    )
    effort, motors = extend(plan.effort, rest, rest), slew.motors(plan.period)
    path = closed_loop(model, start, effort, _limited_feedback, numbers, motors, slew.steps).states
    last += before
    tips = np.abs(path[:, model.joints : model.coordinates] @ model.appendages.tip.T)
    errors = np.abs(path[last:, : model.joints] - plan.position[-1])
    left, peak = (float(part.max(initial=0.0)) for part in (tips[last:], tips))
    return Prediction(left, errors.max(axis=0), peak)


def motion_warning(from_rest: Prediction, in_motion: Prediction) -> str:
    """Return a warning of what the motion before a plan leaves, or "" where that is nothing."""
    left, at_rest = in_motion.tip_deflection, from_rest.tip_deflection
    if left <= (1.0 + _ALLOWED) * at_rest + _TIP_FLOOR:
        return ""
    return (
        f"the bench moves before the plan begins: {left:.3g} m is left at the tips, {at_rest:.3g} "
        "m from rest; damp the swing first, by the law or by a later start"
    )


@feedback
def _limited_feedback(
    x: Vector, reference: Vector, numbers: Matrix, places: Indices, effort: Vector
) -> None:
    """Add the feedback of pd_step joint by joint, and limit the sum.

    Args:
        x: state.
        reference: [r, r'], shape (2 joints,).
        numbers: Kp, Kd and the limits, shape (3, joints).
        places: indices of y and of y' in a state.
        effort: feedforward; the demand on the drives afterwards, shape (joints,) [N m or N].
    """
    m = effort.size
    for j in range(m):
        error, rate_error = reference[j] - x[places[j]], reference[m + j] - x[places[m + j]]
        demand, _, _ = _pd_step(numbers[0, j], numbers[1, j], effort[j], error, rate_error)
        effort[j] = min(max(demand, -numbers[2, j]), numbers[2, j])
