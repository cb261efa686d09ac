"""Why a slew fails, and what would help: each remedy is tried before it is reported."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from flexslew_control.controllers.sampled_loop import LinearPlant, collocated_loop, radius
from flexslew_control.plan import Plan
from flexslew_control.planners.progress import Progress, ignore
from flexslew_control.planners.slew import Slew
from flexslew_control.planners.trajectories import rigid_duration, rounded_up
from flexslew_plant.errors import PlanFailed

PlanFunction: TypeAlias = Callable[[Any, Slew, Progress], Plan]

_MOST_FUNCTIONS = 200  # that a section may ask for
_RADIUS_TOLERANCE = 1e-6  # beyond 1, of the spectral radius of one tick: rounding of a rigid body's
# by how many steps of 5 % a duration is longer that is tried where a slew needs too much torque
_DURATION_STEPS = (1, 2, 4, 8, 16, 32, 40)
_PHASE_ANGLES = (40.0, 20.0, 10.0)  # of a feedback that is tried then, in the slew [rad]


def suggest_duration(plan: PlanFunction, settings: Any, slew: Slew) -> str:
    """Return what would do: more functions, or a longer duration, or that none was found."""
    now = settings.duration
    rigid = rigid_duration(slew.model, slew.start, slew.goal, slew.effort_limit)
    if now >= rigid and (functions_hint := _suggest_functions(plan, settings, slew)):
        return functions_hint

    def duration_after(steps: int) -> float:
        return rounded_up(now * 1.05**steps)  # the reported duration is the one that was tried

    def is_feasible(steps: int) -> bool:
        duration = duration_after(steps)
        return duration >= rigid and _is_feasible(plan, replace(settings, duration=duration), slew)

    needed = next(filter(is_feasible, _DURATION_STEPS), None)
    if needed is None:
        max_duration = duration_after(_DURATION_STEPS[-1])
        gains_hint = _suggest_gains(plan, settings, slew)
        words = gains_hint or "is enough; use a higher effort_limit"
        return f"no duration up to {max_duration:g} s (now {now:g} s) {words}"
    short = max((steps for steps in _DURATION_STEPS if steps < needed), default=0)
    while needed - short > 1:
        middle = (short + needed) // 2
        short, needed = (short, middle) if is_feasible(middle) else (middle, needed)
    return (
        f"a duration of {duration_after(needed):g} s (now {now:g} s) is enough; a rigid body takes "
        f"{rigid:.4g} s"
    )


def _suggest_functions(plan: PlanFunction, settings: Any, slew: Slew) -> str:
    """Return how many functions of time would do, where there are any; else an empty text.

    Functions that are long compared with the period of a mode hardly move it: the weights that
    bring it to rest grow with the square of their length, and without bound where a function
    spans whole periods.
    """
    if not slew.model.modes:
        return ""
    count = getattr(settings, "functions", _MOST_FUNCTIONS)
    length = settings.duration / (count + 1)
    frequencies = slew.model.linearise(slew.model.rest({})).frequencies
    mode_period = 2.0 * np.pi / float(frequencies[-1]) if frequencies.size else np.inf
    if length < 0.5 * mode_period:
        return ""
    for factor in (2, 4, 8):
        functions = count * factor
        if functions > _MOST_FUNCTIONS:
            break
        if _is_feasible(plan, replace(settings, functions=functions), slew):
            return (
                f"functions: {functions} (now {count}) is enough: with {count}, each lasts "
                f"{length:.3g} s and hardly moves the mode whose period is {mode_period:.3g} s"
            )
    return ""


def _suggest_gains(plan: PlanFunction, settings: Any, slew: Slew) -> str:
    """Return which softer feedback would do, where the plan assumes one; else an empty text.

    A feedback that is stiff compared with the modes holds the joints still against them, which
    takes effort however slow the slew. So may the feedback assumed for a law without such gains.
    """
    if not hasattr(settings, "feedback"):
        return ""
    model = slew.model
    rest = model.rest(slew.named(slew.start))
    inertia = model.inertias(np.concatenate((rest, np.zeros(model.coordinates))))
    if not np.isfinite(inertia).all():  # what does not move its joint holds nothing
        return ""
    for phase in _PHASE_ANGLES:
        w = phase / settings.duration
        kp = np.array([rounded_up(one) for one in inertia * w**2])
        kd = np.array([rounded_up(one) for one in 2.0 * inertia * w])
        if (kp < slew.kp).all() and _is_feasible(plan, settings, replace(slew, kp=kp, kd=kd)):
            return (
                f"is enough under the feedback that the plan counts with, kp {slew.kp.tolist()} "
                f"and kd {slew.kd.tolist()}; kp {kp.tolist()} and kd {kd.tolist()} are: give them "
                "to the controller that flies, or as plan.feedback where it has no such gains"
            )
    return ""


def _is_feasible(plan: PlanFunction, settings: Any, slew: Slew) -> bool:
    """Return whether a section leads to a plan."""
    try:
        plan(settings, slew, ignore)
    except PlanFailed:
        return False
    return True


def require_stable_loop(slew: Slew) -> None:
    """Check that the feedback that a plan assumes holds the testbed at the plan's start.

    Raises:
        PlanFailed: if it does not, so that no trajectory under it can be predicted.
    """
    rest = slew.model.rest(slew.named(slew.start))
    loop = collocated_loop(LinearPlant(slew.model, rest), slew.kp, slew.kd, slew.period)
    found = radius(loop)
    if found > 1.0 + _RADIUS_TOLERANCE:
        raise PlanFailed(
            f"the feedback that the plan counts with, kp {slew.kp.tolist()} and kd "
            f"{slew.kd.tolist()}, is not stable on this testbed with a period of "
            f"{slew.period:g} s (spectral radius of one tick {found:.4g}); give plan.feedback the "
            "gains of a controller that flies it"
        )
