"""The fastest reorientation in three axes, by all drives at once: faster than the eigenaxis.

About the eigenaxis only the drives that push along it work, and those across it hold. Where all
push at their limits, a sphere that turns by 180 deg takes 3.2431 instead of 3.5449 (Bilimoria and
Wie 1993), see fastest_turns. Where that slew turns a boresight into a cone of `keep_out` or is
faster than the rate limit, the programs go round it, see round_cones.
"""

from functools import partial
from typing import Any

import numpy as np

from flexslew_control.plan import Plan
from flexslew_control.planners.held_efforts import least_change
from flexslew_control.planners.progress import Progress
from flexslew_control.planners.slew import Slew, plan_on_ticks, tick_times
from flexslew_control.planners.time_optimal.three_axes.fastest_turns import (
    MinimumTimeSlew,
    means,
    minimum_time_rigid,
    minimum_time_with_modes,
    rigid_near,
)
from flexslew_control.planners.time_optimal.three_axes.path_limits import PathLimits
from flexslew_control.planners.time_optimal.three_axes.reorientation import Reorientation
from flexslew_control.planners.time_optimal.three_axes.round_cones import (
    minimum_time_limited,
    require_free_ends,
)
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.counted import count_text
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.testbeds.contract import HasSky

_ALLOWED = 1e-4  # wrong-signed part of a switching function
_ITERATIONS = 6  # of the efforts on ticks
_CLOSE = 1e-10  # of the end conditions
_EXTRA_TICKS = (0, 1, 2, 5)  # ticks after the end that may be needed to come to rest on ticks


def plan_three_axes(
    settings: Any, requested: Slew, amplitude: Vector, rigid: Any, progress: Progress
) -> Plan:
    """Return the fastest slew from one attitude to another.

    Args:
        settings: the `plan` section.
        requested: the slew of a model with joints that read an attitude.
        amplitude: largest efforts, shape (joints,) [N m].
        rigid: the testbed without modes.
        progress: called after every start, with the least duration so far for its objective.

    Raises:
        BadInput: if nothing turns, or a joint does not turn the craft.
        PlanFailed: if no start leads to a slew, it takes longer than allowed, or none keeps out of
            the cones.
    """
    slew = Reorientation(requested.model, requested.start, requested.goal, amplitude)
    for name, axis in zip(requested.model.joint_names, slew.attitude.axes, strict=True):
        if not axis.any():
            words = f"{name} does not turn the platform; take moving, about the eigenaxis"
            raise BadInput(words, "plan", "drives", "all")
    if not np.linalg.norm(slew.turn) > 0.0:
        raise BadInput("plan: goal: the craft is there already; give another goal")
    sky = rigid.sky() if isinstance(rigid, HasSky) else None
    limits = PathLimits(() if sky is None else sky.cones, settings.rate_limit)
    if limits.names:
        require_free_ends(limits, slew)
    rigid_slew = slew if not requested.model.modes else Reorientation(rigid.model(), *_ends(slew))
    best = free = minimum_time_rigid(rigid_slew, progress)
    rigid_duration = float(best.durations.sum())
    if requested.model.modes:
        best = minimum_time_with_modes(slew, best)
        rigid_duration = min(rigid_duration, rigid_near(rigid_slew, best))
    states, effort = _on_ticks(slew, best, settings.start, requested.period)
    limited = limits.names and (limits.excess(slew.model, states) > 0.0).any()
    if limited:
        on_ticks = partial(_on_ticks, slew, start=settings.start, period=requested.period)
        best, states, effort = minimum_time_limited(
            limits, slew, rigid_slew, free, on_ticks, progress
        )
    duration = float(best.durations.sum())
    if settings.longest is not None and duration > settings.longest:
        raise PlanFailed(
            f"the slew takes {duration:.4f} s, {settings.longest:g} s allowed; a rigid craft takes "
            f"{rigid_duration:.4f} s; use a higher effort_limit"
        )
    position, velocity = slew.joints(states)
    velocity[-1] = 0.0
    summary: dict[str, Any] = {
        "duration": duration,
        "switch_times": np.cumsum(best.durations)[:-1].tolist() if best.exact else [],
        "switches": best.durations.size - 1 if best.exact else None,
        "amplitude": amplitude.tolist(),
        "peak_effort": abs(effort).max(axis=0).tolist(),
        "terminal_error": slew.rest_error(states[-1:])[0].tolist(),
        "rigid_duration": rigid_duration,
        "later_than_rigid": duration - rigid_duration,
        "path_limits": [*limits.names] if limited else [],
        "eigenaxis_duration": rigid_slew.duration,
        "optimal": bool(best.violation <= _ALLOWED),
        "switching_function_violation": best.violation,
        "optimality": _statement(best),
        "predicted_residual_tip_deflection": _tip_amplitude(slew, states[-1]),
    }
    return plan_on_ticks(settings, requested, (position, velocity), effort, summary)


def _ends(slew: Reorientation) -> tuple[Vector, Vector, Vector]:
    return slew.first, slew.last, slew.amplitude


def _on_ticks(
    slew: Reorientation, best: MinimumTimeSlew, start: float, period: float
) -> tuple[Matrix, Matrix]:
    """Return states at the ticks and efforts held over them that end at rest at the goal.

    The means over the ticks miss it by a little, of second order in the period. The smallest change
    that ends there is weighed by the room below the amplitude, see held_efforts.
    """
    knots = np.concatenate(([0.0], np.cumsum(best.durations)))
    ticks = tick_times(start, float(knots[-1]), period)
    mean = means(best.efforts, knots, ticks)
    least, selected = np.inf, (np.zeros((0, 0)), mean)
    for extra in _EXTRA_TICKS:
        effort = np.vstack((mean, np.zeros((extra, mean.shape[1]))))
        durations = np.full(len(effort), period)
        for _ in range(_ITERATIONS):
            end = slew.ended(effort, durations)
            error = float(abs(end.missed / slew.scale).max())
            if error < least:
                least, selected = error, (end.states, effort)
            if error < _CLOSE:
                return selected
            slopes = (end.by_effort / slew.scale[:, None, None]).reshape(len(end.missed), -1)
            room = (slew.amplitude - abs(effort)).ravel()
            change = least_change(slopes, room, -end.missed / slew.scale)
            effort = np.clip(effort + change.reshape(effort.shape), -slew.amplitude, slew.amplitude)
    return selected


def _tip_amplitude(slew: Reorientation, x: Vector) -> float:
    """Return the amplitude of the tips in a state, the platform held [m]."""
    model = slew.model
    if not model.modes:
        return 0.0
    linear = model.linearise(x[: model.positions])
    n = model.before_modes
    modes, rates = model.modal_state(x)
    slow = np.sqrt(np.diag(linear.mass)[n:] / np.diag(linear.stiffness)[n:])
    amplitude = np.hypot(modes, slow * rates)
    return float((abs(model.appendages.tip) @ amplitude).max(initial=0.0))


def _statement(best: MinimumTimeSlew) -> str:
    """Return in one sentence what is known of the slew's optimality."""
    of = f"the best of {best.found} starts"
    if not best.exact:
        return f"{of} on {best.durations.size} pieces, a local optimum"
    edges = count_text(best.durations.size - 1, "switch", "switches")
    if best.violation <= _ALLOWED:
        return f"{of}, extremal with {edges}: Pontryagin's condition holds; a local optimum"
    return (
        f"{of}, a local optimum with {edges}; a switching function has the wrong sign by "
        f"{100.0 * best.violation:.2g} % of its largest value"
    )
