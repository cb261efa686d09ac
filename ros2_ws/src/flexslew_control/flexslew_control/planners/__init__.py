"""Which planners there are. A new one is a file with a section and a function, and a line here."""

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np
from pydantic import Field

from flexslew_control.law import PlantDescription
from flexslew_control.plan import Plan
from flexslew_control.planners.feedforward.optimized_feedforward import (
    OptimizedFeedforward,
    plan_optimized_feedforward,
)
from flexslew_control.planners.feedforward.robust_feedforward import (
    RobustFeedforward,
    plan_robust_feedforward,
)
from flexslew_control.planners.held_efforts import exact_on_ticks
from flexslew_control.planners.input_shaping.input_shaping import InputShaping, plan_input_shaping
from flexslew_control.planners.input_shaping.start_coast_stop import (
    StartCoastStop,
    plan_start_coast_stop,
)
from flexslew_control.planners.one_axis import one_axis
from flexslew_control.planners.prediction import predicted
from flexslew_control.planners.progress import Progress, Update
from flexslew_control.planners.reference import (
    NoPlan,
    ReferenceOnly,
    plan_none,
    plan_reference_only,
)
from flexslew_control.planners.retargeting import Retargeting, plan_retargeting
from flexslew_control.planners.slew import (
    Feedback,
    Slew,
    TooMuchTorque,
    slew_of,
    software_versions,
    tick_times,
)
from flexslew_control.planners.time_optimal.time_optimal import TimeOptimal, plan_time_optimal
from flexslew_control.planners.trajectories import rigid_duration, rounded_up
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.settings import plain, validated


class _Planner(NamedTuple):
    settings: type[Any]  # its `plan` section
    plan: Callable[[Any, Slew, Progress], Plan]
    # whether its efforts shall end at rest at the goal when each is held over its tick
    exact: Callable[[Any], bool] = lambda settings: False


PLANNERS: dict[str, _Planner] = {
    "none": _Planner(NoPlan, plan_none),
    "reference_only": _Planner(ReferenceOnly, plan_reference_only),
    "optimized_feedforward": _Planner(
        OptimizedFeedforward, plan_optimized_feedforward, lambda s: s.track == "planned"
    ),
    "robust_feedforward": _Planner(RobustFeedforward, plan_robust_feedforward),
    "input_shaping": _Planner(InputShaping, plan_input_shaping, lambda s: s.shaper != "none"),
    "start_coast_stop": _Planner(
        StartCoastStop, plan_start_coast_stop, lambda s: s.feedforward == "elastic"
    ),
    "time_optimal": _Planner(TimeOptimal, plan_time_optimal, lambda s: True),
}

_EXACT = 1e-5  # residual above which efforts are made exact for their hold [m]
_MOST_FUNCTIONS = 200  # that a section may ask for
_LONGER = 40  # durations tried, each 5 % longer, where a slew needs too much torque

# what sections of several methods share
_MANOEUVRE = ("goal", "start", "model", "initial", "feedback", "reference")

PlanSettings: TypeAlias = Annotated[
    NoPlan
    | ReferenceOnly
    | OptimizedFeedforward
    | RobustFeedforward
    | InputShaping
    | StartCoastStop
    | TimeOptimal
    | Retargeting,
    Field(discriminator="method"),
]


def plan_settings(values: Any, source: str) -> PlanSettings:
    """Return a `plan` section as its method reads it.

    Args:
        values: what the YAML holds.
        source: the file to name in an error.

    Raises:
        BadInput: the first wrong key, with its value and what is allowed.
    """
    settings: PlanSettings = validated(PlanSettings, values, source)
    return settings


def other_method(settings: PlanSettings, method: str, source: str, **more: Any) -> PlanSettings:
    """Return the `plan` section of another method for the same manoeuvre.

    Start, goal, model, feedback and reference are taken over as far as the method has them; the
    rest is its default. time_optimal plans on one mode.

    Args:
        settings: the section that says the manoeuvre.
        method: a key of PLANNERS.
        source: the file to name in an error.
        more: keys of the method's own section.

    Raises:
        BadInput: there is no such method, or it cannot be asked for this manoeuvre.
    """
    if method not in PLANNERS:
        raise BadInput(f"{source}: method: {method} is not allowed: {', '.join(PLANNERS)}")
    asked = plain(settings)
    if method == settings.method:
        return plan_settings({**asked, **more}, source)
    known = {field.name for field in fields(PLANNERS[method].settings)}
    values = {key: asked[key] for key in _MANOEUVRE if key in known and asked.get(key) is not None}
    return plan_settings({**values, **more, "method": method}, source)


def make_plan(
    settings: PlanSettings,
    plant: PlantDescription,
    feedback: Feedback | None = None,
    progress: Progress | None = None,
) -> Plan:
    """Return the plan that a `plan` section asks for.

    Its summary says under `believes` what the planner assumes, unlike the bench, and
    under `predicted_residual_...` what the plan leaves on the model that it believes in.

    Args:
        settings: one of the sections above.
        plant: what stands on the bench; the section may say otherwise.
        feedback: gains of the controller in charge, where it has such gains.
        progress: called with every update of an iteration, if the method has one.

    Raises:
        PlanFailed: no such manoeuvre; the message carries the numbers.
        BadInput: period, limit, start or a joint cannot be used.
    """
    period, limit = plant.period, plant.effort_limit
    if not (np.isfinite(period) and period > 0.0):
        raise BadInput(f"period: {period!r} is not allowed: a positive number of seconds")
    if limit.ndim != 1 or not limit.size or not np.all(limit > 0.0):
        raise BadInput(f"effort_limit: {limit.tolist()} is not allowed: positive, one per actuator")
    tick_times(settings.start, 0.0, period)  # refuses a start between ticks, for every method
    if isinstance(settings, Retargeting):  # no joint goes anywhere, and the efforts are as many
        return replace(plan_retargeting(settings, plant), versions=software_versions())
    reduced = None if isinstance(settings, NoPlan) else one_axis(settings, plant, feedback)
    if reduced is not None:
        own = make_plan(reduced.settings, reduced.plant, reduced.feedback, progress)
        return reduced.embedded(own)
    slew = slew_of(settings, plant, feedback)
    if limit.size != slew.goal.size:
        raise BadInput(
            f"effort_limit: {limit.tolist()} is not allowed: {slew.goal.size} numbers, one for "
            f"each of {', '.join(slew.model.joint_names)}"
        )
    planner = PLANNERS[settings.method]
    try:
        plan = planner.plan(settings, slew, progress or _unheard)
    except TooMuchTorque as error:
        raise PlanFailed(f"{error}; {_enough_time(settings, slew)}") from None
    promised = predicted(plan, slew)
    if planner.exact(settings) and promised.tip_deflection > _EXACT:
        plan = exact_on_ticks(plan, slew)
        promised = predicted(plan, slew)
    promise = {
        "believes": slew.beliefs,
        "predicted_residual_tip_deflection": promised.tip_deflection,
        "predicted_residual_attitude_error": slew.named(promised.attitude_error),
    }
    return replace(
        plan,
        request=_complete(settings, slew),
        summary={**plan.summary, **promise},
        versions=software_versions(),
    )


def _complete(settings: Any, slew: Slew) -> dict[str, Any]:
    """Return the section with everything that it took from the bench written out."""
    asked: dict[str, Any] = plain(settings)
    resolved = {
        "model": plain(slew.testbed),
        "initial": slew.named(slew.start),
        "goal": slew.named(slew.goal),
        "feedback": {"kp": slew.kp.tolist(), "kd": slew.kd.tolist()},
    }
    if asked.get("feedback") is None and isinstance(settings, TimeOptimal):
        del resolved["feedback"]  # where null stands for open loop
    return asked | {key: value for key, value in resolved.items() if key in asked}


def _enough_time(settings: Any, slew: Slew) -> str:
    """Return what would do: more functions, or a longer duration, or that none was found."""
    now = settings.duration
    rigid = rigid_duration(slew.model, slew.start, slew.goal, slew.effort_limit)
    if now >= rigid and (finer := _enough_functions(settings, slew)):
        return finer
    for longer in now * 1.05 ** np.arange(1, _LONGER + 1):
        duration = rounded_up(longer)  # what is said is what was tried
        if duration < rigid:
            continue
        try:
            PLANNERS[settings.method].plan(replace(settings, duration=duration), slew, _unheard)
        except PlanFailed:
            continue
        return (
            f"a duration of {duration:g} s (now {now:g} s) is enough; a rigid body takes "
            f"{rigid:.4g} s"
        )
    return f"no duration up to {duration:g} s (now {now:g} s) is enough; use a higher effort_limit"


def _enough_functions(settings: Any, slew: Slew) -> str:
    """Return how many functions of time would do, where there are any; else an empty text.

    Functions that are long beside the period of a mode hardly move it: the weights that bring it
    to rest grow with the square of their length, and without bound where a function spans whole
    periods.
    """
    if not slew.model.modes:
        return ""
    fewer = getattr(settings, "functions", _MOST_FUNCTIONS)
    lasts = settings.duration / (fewer + 1)
    fastest = 2.0 * np.pi / float(slew.model.linearise(slew.model.rest({})).frequencies[-1])
    if lasts < 0.5 * fastest:
        return ""
    for functions in (fewer * factor for factor in (2, 4, 8) if fewer * factor <= _MOST_FUNCTIONS):
        try:
            PLANNERS[settings.method].plan(replace(settings, functions=functions), slew, _unheard)
        except PlanFailed:
            continue
        return (
            f"functions: {functions} (now {fewer}) is enough: with {fewer}, each lasts "
            f"{lasts:.3g} s and hardly moves the mode whose period is {fastest:.3g} s"
        )
    return ""


def _unheard(update: Update) -> None:
    """Nobody listens."""
