"""Switch time optimisation: first-order gradient method of Liu and Singh 1997, a cross-check.

The unknowns are the switch times and the final time, p = (t_1 .. t_N, t_f). States go forwards,
costates backwards: with lambda_i(t_f) the gradient of end condition r_i and H the input gradient
lambda_i^T df/du, a switch from u_k to u_k+1 at t_k gives
    dr_i/dt_k = H(t_k) (u_k - u_k+1),    dr_i/dt_f = lambda_i^T f(t_f).
One step goes along the gradient of t_f, projected on dr = 0, and one back to r = 0; both are the
shortest ones in the relative changes of the arcs, so that no arc turns negative. The sensitivities
are not those of `switching`.
"""

from typing import NamedTuple

import numpy as np

from flexslew_control.planners.time_optimal.arcs import costate_backwards, final_sensitivity
from flexslew_control.planners.time_optimal.bang_bang import BangBang
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import PlanFailed

_RESIDUAL = 1e-9  # of the end conditions, at which they hold
_SLOPE = 1e-7  # of t_f, at which it counts as smallest [s]
_MAX_REDUCTION = 0.5  # part of an arc that a step may take away


class SwitchTimes(NamedTuple):
    """Where the iteration ended."""

    durations: Vector  # of the arcs, shape (N + 1,) [s]
    iterations: int
    residual: float  # largest |r|
    slope: float  # of t_f by relative changes of the arcs, zero where none is shorter [s]


def switch_time_optimisation(
    slew: BangBang,
    guess: Vector,
    max_iterations: int = 2000,
) -> SwitchTimes:
    """Return the switch times that end the slew soonest among those with as many switches.

    Args:
        slew: what is turned.
        guess: durations of the arcs to start from, shape (N + 1,) [s].
        max_iterations: before it is given up.

    Raises:
        PlanFailed: it does not settle.
    """
    d = _project(slew, guess)
    stride, flat = 0.1, np.inf
    for k in range(max_iterations):
        direction = _gradient_direction(slew, d)
        flat = float(np.linalg.norm(direction))
        if flat <= _SLOPE:
            return SwitchTimes(d, k, float(np.abs(slew.residual(d)).max()), flat)
        try:
            new = _project(slew, _change_durations(d, stride * direction))
        except PlanFailed:
            new = None
        if new is not None and new.sum() < d.sum():
            d, stride = new, 1.5 * stride
        else:
            stride *= 0.4
            if stride * flat < 1e-13:
                break
    raise PlanFailed(
        f"switch time optimisation stopped at t_f = {d.sum():.6f} s with a slope of {flat:.1e}, "
        f"allowed {_SLOPE:.1e}; use another number of switches than {d.size - 1}"
    )


def gradients(slew: BangBang, durations: Vector) -> Matrix:
    """Return dr/dp of the end conditions by switch times and final time, shape (rows, N + 1)."""
    efforts = slew.efforts(durations.size)
    final, slopes = final_sensitivity(slew.ensemble, slew.start, efforts, durations, slew.step)
    ends = np.cumsum(durations)
    effort_steps = -np.diff(efforts[:, slew.joint])
    rows = []
    for condition in slew.conditions:
        times, values = costate_backwards(
            slew.ensemble, final, condition, efforts, durations, slew.step
        )
        at = [int(np.argmin(np.abs(times - switch))) for switch in ends[:-1]]
        rows.append(values[at, slew.joint] * effort_steps)
    # the derivative by the last duration is f at the end
    return np.column_stack((rows, slew.conditions @ slopes[:, -1]))


def _by_relative_change(slew: BangBang, durations: Vector) -> Matrix:
    """Return dr/dy for arcs that become d_i (1 + y_i): an arc moves all switches after it."""
    by_duration = np.cumsum(gradients(slew, durations)[:, ::-1], axis=1)[:, ::-1]
    return np.asarray(by_duration * durations)


def _gradient_direction(slew: BangBang, durations: Vector) -> Vector:
    """Return minus the gradient of t_f on dr = 0 by the relative changes of the arcs [s]."""
    rows = _by_relative_change(slew, durations)
    normal = np.linalg.lstsq(rows.T, durations, rcond=None)[0]
    return np.asarray(rows.T @ normal - durations)


def _project(slew: BangBang, durations: Vector) -> Vector:
    """Return the arcs with r = 0 next to these.

    Raises:
        PlanFailed: there are none near by.
    """
    d = durations
    for _ in range(60):
        r = slew.residual(d)
        if np.abs(r).max() <= _RESIDUAL:
            return d
        change = np.linalg.lstsq(_by_relative_change(slew, d), -r, rcond=None)[0]
        d = _change_durations(d, change.astype(np.float64))
    raise PlanFailed("switch time optimisation found no arcs that end at the goal near its start")


def _change_durations(durations: Vector, change: Vector) -> Vector:
    """Return the arcs after a relative change, which is cut to keep them long."""
    largest = max(float(-change.min()), _MAX_REDUCTION)
    return np.asarray(durations * (1.0 + _MAX_REDUCTION / largest * change))
