"""Which planners there are. A new one is a file with a section and a function, and a line here."""

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias

import numpy as np
from pydantic import Field

from flexslew_control.plan import Plan
from flexslew_control.planners.feedforward.basis import Basis
from flexslew_control.planners.feedforward.gauss_newton import Progress, Update
from flexslew_control.planners.feedforward.optimized_feedforward import (
    OptimizedFeedforward,
    on_ticks,
    plan_optimized_feedforward,
)
from flexslew_control.planners.feedforward.robust_feedforward import (
    RobustFeedforward,
    plan_robust_feedforward,
)
from flexslew_control.planners.input_shaping.input_shaping import InputShaping, plan_input_shaping
from flexslew_control.planners.input_shaping.start_coast_stop import (
    StartCoastStop,
    start_coast_stop,
)
from flexslew_control.planners.slew import (
    CsaGoal,
    CsaModel,
    Feedback,
    TooMuchTorque,
    csa_manoeuvre,
    software_versions,
    tick_times,
)
from flexslew_control.planners.time_optimal.time_optimal import TimeOptimal, plan_time_optimal
from flexslew_control.planners.trajectories import Profile, rigid_duration
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.settings import NonNegative, Positive, plain, section, validated
from flexslew_plant.testbeds.csa import JOINTS, CsaInitial


@section
class NoPlan:
    """The `plan` section for method none: a step of the reference to the goal (Figure 5)."""

    method: Literal["none"] = "none"
    goal: CsaGoal = CsaGoal()
    start: NonNegative = 0.0  # [s]
    duration: NonNegative = 0.0  # after which the manoeuvre counts as over [s]


@section
class ReferenceOnly:
    """The `plan` section for method reference_only: the reference without any feedforward."""

    method: Literal["reference_only"] = "reference_only"
    model: CsaModel = CsaModel()
    initial: CsaInitial = CsaInitial()
    goal: CsaGoal = CsaGoal()
    start: NonNegative = 0.0  # [s]
    duration: Positive = 25.0  # [s]
    reference: Profile = "cubic"
    feedback: Feedback = Feedback()


def plan_none(settings: NoPlan, period: float, effort_limit: Vector, progress: Progress) -> Plan:
    """Return the plan whose reference is the goal from its first tick on."""
    ticks = tick_times(settings.start, settings.duration, period)
    goal = np.array([settings.goal.base_yaw, settings.goal.hub_pitch])
    return Plan(
        method=settings.method,
        joint_names=JOINTS,
        start=settings.start,
        period=period,
        position=np.tile(goal, (len(ticks), 1)),
        velocity=np.zeros((len(ticks), len(goal))),
        effort=np.zeros((len(ticks) - 1, len(goal))),
        state=np.zeros((len(ticks), 0)),
        duration=settings.duration,
        request=plain(settings),
        summary={"duration": settings.duration},
        versions=software_versions(),
    )


def plan_reference_only(
    settings: ReferenceOnly, period: float, effort_limit: Vector, progress: Progress
) -> Plan:
    """Return the plan with the reference and zero feedforward, to compare with."""
    manoeuvre = csa_manoeuvre(settings)
    nothing = Basis("constant", 1, settings.duration)
    weights = np.zeros((1, manoeuvre.model.joints))
    return on_ticks(settings, manoeuvre, nothing, weights, period, effort_limit)


class _Planner(NamedTuple):
    settings: type[Any]  # its `plan` section
    plan: Callable[[Any, float, Vector, Progress], Plan]


PLANNERS: dict[str, _Planner] = {
    "none": _Planner(NoPlan, plan_none),
    "reference_only": _Planner(ReferenceOnly, plan_reference_only),
    "optimized_feedforward": _Planner(OptimizedFeedforward, plan_optimized_feedforward),
    "robust_feedforward": _Planner(RobustFeedforward, plan_robust_feedforward),
    "input_shaping": _Planner(InputShaping, plan_input_shaping),
    "start_coast_stop": _Planner(StartCoastStop, start_coast_stop),
    "time_optimal": _Planner(TimeOptimal, plan_time_optimal),
}

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
    | TimeOptimal,
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
    model = asked.get("model") or {}
    if model.get("kind", "csa") == "csa":
        initial = asked.get("initial") or model.get("initial") or {}
        asked["initial"] = dict.fromkeys(JOINTS, 0.0) | initial
        asked["goal"] = asked["initial"] | asked["goal"]
        model = {field.name: model[field.name] for field in fields(CsaModel) if field.name in model}
        if method == "time_optimal":
            model |= {"modes": 1, "initial": asked["initial"]}
        asked["model"] = model
    known = {field.name for field in fields(PLANNERS[method].settings)}
    values = {key: asked[key] for key in _MANOEUVRE if key in known and asked.get(key) is not None}
    return plan_settings({**values, **more, "method": method}, source)


def make_plan(
    settings: PlanSettings,
    period: float,
    effort_limit: Sequence[float] | Vector,
    progress: Progress | None = None,
) -> Plan:
    """Return the plan that a `plan` section asks for.

    Args:
        settings: one of the sections above.
        period: one tick of the bench [s].
        effort_limit: of the drives, shape (joints,) [N m].
        progress: called with every update of an iteration, if the method has one.

    Raises:
        PlanFailed: no such manoeuvre; the message carries the numbers.
        BadInput: period, limit or start cannot be used.
    """
    limit = np.asarray(effort_limit, dtype=np.float64)
    if not (np.isfinite(period) and period > 0.0):
        raise BadInput(f"period: {period!r} is not allowed: a positive number of seconds")
    if limit.ndim != 1 or not np.all(limit > 0.0):
        raise BadInput(f"effort_limit: {limit.tolist()} is not allowed: positive, one a joint")
    tick_times(settings.start, 0.0, period)  # refuses a start between ticks, for every method
    try:
        return PLANNERS[settings.method].plan(settings, period, limit, progress or _unheard)
    except TooMuchTorque as error:
        raise PlanFailed(f"{error}; {_enough_time(settings, period, limit)}") from None


def _enough_time(settings: Any, period: float, limit: Vector) -> str:
    """Return what duration would do for a section that has one, or that none was found."""
    now = settings.duration
    slew = csa_manoeuvre(settings)
    rigid = rigid_duration(slew.model, slew.start, slew.goal, limit)
    for longer in now * 1.05 ** np.arange(1, _LONGER + 1):
        if longer < rigid:
            continue
        try:
            PLANNERS[settings.method].plan(
                replace(settings, duration=float(longer)), period, limit, _unheard
            )
        except PlanFailed:
            continue
        return (
            f"a duration of about {longer:.3g} s (now {now:g} s) is enough; a rigid body takes "
            f"{rigid:.4g} s"
        )
    return f"no duration up to {longer:.3g} s (now {now:g} s) is enough; use a higher effort_limit"


def _unheard(update: Update) -> None:
    """Nobody listens."""
