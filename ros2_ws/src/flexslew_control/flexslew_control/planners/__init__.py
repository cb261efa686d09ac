"""Which planners there are. A new one is a file that ends in its entry, and a line here.

One of your own needs no line: `method: my_shaper.py:Shaper`, or an entry point of the group
flexslew.planners. It is a section with `method`, `start` and `plan`, see UserPlanner.

Offers: attitude.one_axis, checks.first_point, excitation.excitation, feedforward.basis,
feedforward.gauss_newton, feedforward.manoeuvre, feedforward.optimized_feedforward,
feedforward.shooting, input_shaping.section, input_shaping.start_coast_stop, law_gains,
minimax.limit_curve, progress, reference, residual.from_motion, slew, time_optimal.arcs,
time_optimal.bang_bang, time_optimal.optimal_switching, time_optimal.pontryagin,
time_optimal.structures, time_optimal.switching, time_optimal.time_optimal, trajectories,
trajectory_file.
"""

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Annotated, Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from pydantic import Discriminator, PlainValidator, Tag, ValidationInfo

from flexslew_control.law import ActiveLaw, PlantDescription
from flexslew_control.plan import Plan
from flexslew_control.planners.attitude.attitude_goal import AttitudeGoal, joint_goal
from flexslew_control.planners.attitude.keep_out import require_clear
from flexslew_control.planners.attitude.one_axis import split_modes
from flexslew_control.planners.checks.first_point import with_jump
from flexslew_control.planners.checks.one_way import require_one_way
from flexslew_control.planners.entry import PlannerEntry as PlannerEntry
from flexslew_control.planners.entry import PlanSection as PlanSection
from flexslew_control.planners.entry import PlanTask as PlanTask
from flexslew_control.planners.entry import Variant as Variant
from flexslew_control.planners.progress import Progress, ignore
from flexslew_control.planners.slew import Feedback, Slew, software_versions, tick_times
from flexslew_control.planners.slewing import SlewPlanner
from flexslew_plant.entries import table, union
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.known_joints import require_joints_of
from flexslew_plant.own_code import NO_CODE, Trust, find_class
from flexslew_plant.own_code import PLANNERS as GROUP
from flexslew_plant.settings import plain, validated
from flexslew_plant.testbeds import consistent_positions, design_testbed, initial_positions
from flexslew_plant.yaml_data import require_short, yaml_text

# isort: split
# the planners, a line each
from flexslew_control.planners.attitude.attitude_profile import PROFILE as PROFILE
from flexslew_control.planners.excitation.excitation import EXCITATION as EXCITATION
from flexslew_control.planners.feedforward.optimized_feedforward import OPTIMIZED as OPTIMIZED
from flexslew_control.planners.feedforward.robust_feedforward import ROBUST as ROBUST
from flexslew_control.planners.input_shaping.input_shaping import SHAPING as SHAPING
from flexslew_control.planners.input_shaping.start_coast_stop import (
    START_COAST_STOP as START_COAST_STOP,
)
from flexslew_control.planners.joint_trajectory import TRAJECTORY as TRAJECTORY
from flexslew_control.planners.minimax.minimax_feedforward import MINIMAX as MINIMAX
from flexslew_control.planners.reference import NONE as NONE
from flexslew_control.planners.reference import REFERENCE as REFERENCE
from flexslew_control.planners.retargeting import RETARGETING as RETARGETING
from flexslew_control.planners.time_optimal.time_optimal import TIME_OPTIMAL as TIME_OPTIMAL

PLANNERS: dict[str, PlannerEntry] = table(globals(), PlannerEntry)

# what sections of several methods share
_MANOEUVRE = ("goal", "start", "model", "initial", "feedback", "reference", "drives")


@runtime_checkable
class UserPlanner(Protocol):
    """A section of the user's own."""

    def plan(self, slew: Slew, progress: Progress) -> Plan:
        """Return the plan of a slew.

        Raises:
            PlanFailed: no such slew.
        """


def _method(values: Any) -> str | None:
    """Return the tag of a `plan` section; None: it names no method."""
    key = "method"
    given = values.get(key) if isinstance(values, dict) else getattr(values, key, None)
    if given is None:
        return None
    return given if isinstance(given, str) and given in PLANNERS else "own"


def _user_section(values: Any, info: ValidationInfo) -> Any:
    """Return a section of the user's own class."""
    if not isinstance(values, dict):
        return values
    name, trust = str(values["method"]), info.context or NO_CODE
    try:
        found = find_class(name, GROUP, "planner", "method", tuple(PLANNERS), trust)
        if not issubclass(found, UserPlanner):
            raise BadInput(f"method: {name} has no plan(slew, progress)")
        return validated(found, values, name, trust)
    except BadInput as error:
        raise ValueError(str(error)) from error  # `validated` restores an Untrusted


if TYPE_CHECKING:
    PlanSettings: TypeAlias = PlanSection
else:
    # a `plan` section of any method; `method` selects the class
    PlanSettings = Annotated[
        union(
            [
                *(Annotated[p.settings, Tag(name)] for name, p in PLANNERS.items()),
                Annotated[Any, PlainValidator(_user_section), Tag("own")],
            ]
        ),
        Discriminator(
            _method,
            custom_error_type="no_method",
            custom_error_message="the key method is missing",
        ),
    ]


def plan_settings(values: Any, source: str, trust: Trust = NO_CODE) -> PlanSettings:
    """Return a `plan` section as its method reads it.

    Args:
        values: what the YAML holds.
        source: the file to name in an error.
        trust: which methods of the user's own may be loaded.

    Raises:
        BadInput: the first wrong key, with its value and what is allowed.
    """
    settings: PlanSettings = validated(PlanSettings, values, source, trust)
    _require_near(settings, source)
    return settings


def with_plan_files(settings: Any, source: str, trust: Trust) -> Any:
    """Return a section with what its files hold in place of their names.

    Args:
        settings: of any method, or none.
        source: the file to name in an error.
        trust: whether files may be read.

    Raises:
        Untrusted: if a log names a file.
        BadInput: a file cannot be read, or does not hold what is needed.
    """
    entry = PLANNERS.get(getattr(settings, "method", None) or "")
    return settings if entry is None else entry.with_files(settings, f"{source}: plan", trust)


def require_section(settings: PlanSettings, plant: PlantDescription, source: str) -> None:
    """Check what of a section needs no planning: the names of joints, and the model.

    Args:
        settings: of a method that is built in.
        plant: what stands on the bench.
        source: the file to name in an error.

    Raises:
        BadInput: a name is not one of a joint, or the model has a wrong key or value.
    """
    require_joints_of(settings, plant.joint_names, "plan", source)
    model, place = getattr(settings, "model", None), f"{source}: plan: model"
    if model and is_single_axis(settings, plant):
        _, model = split_modes(model, place)
    if model:
        design_testbed(plant.testbed, model, place, plant.trust)


_MOST_TICKS = 10_000_000  # of a manoeuvre
_MAX_GOAL = 1e3  # a goal; beyond it only the numbers of planners are tested [rad or m]


def _require_near(settings: PlanSettings, source: str) -> None:
    goal = getattr(settings, "goal", None)
    for name, value in goal.items() if isinstance(goal, dict) else ():
        if isinstance(value, float) and not abs(value) <= _MAX_GOAL:
            words = f"at most {_MAX_GOAL:g} rad or m"
            raise BadInput(words, source, key=f"goal.{name}", value=value)


def _by_joint(settings: PlanSettings, plant: PlantDescription) -> PlanSettings:
    """Return the section with its goal by joint and with the joints that follow from others."""
    require_joints_of(settings, plant.joint_names, "plan")
    given: Any = settings
    goal, initial = (getattr(given, key, None) for key in ("goal", "initial"))
    if isinstance(goal, AttitudeGoal):
        requested: PlanSettings = replace(given, goal=joint_goal(goal, plant, initial))
        return requested
    model, first = plant.testbed.model(), initial_positions(plant.testbed)
    for key, named in (("initial", initial), ("goal", goal)):
        if isinstance(named, dict):
            positions = consistent_positions(model, first | named, named, f"plan.{key}", first)
            if positions != first | named:
                given = replace(given, **{key: positions})
            first = positions
    return given  # type: ignore[no-any-return]


def planner_of(settings: PlanSettings) -> PlannerEntry:
    """Return the planner of a section; one of the user's own plans slews."""
    user_entry = PlannerEntry(
        type(settings), SlewPlanner(lambda s, slew, progress: s.plan(slew, progress))
    )
    entry = PLANNERS.get(settings.method, user_entry)
    return entry.instead(settings) or entry


def is_single_axis(settings: PlanSettings, plant: PlantDescription) -> bool:
    """Return whether a section is planned about one axis; see SlewPlanner.is_single_axis."""
    make = planner_of(settings).make
    return isinstance(make, SlewPlanner) and make.is_single_axis(settings, plant)


def takes_gains_in_charge(settings: PlanSettings) -> bool:
    """Return whether a section without `feedback` uses the gains of the active controller."""
    make = planner_of(settings).make
    open_loop = isinstance(make, SlewPlanner) and make.open_loop
    return hasattr(settings, "feedback") and not open_loop


def other_method(settings: PlanSettings, method: str, source: str, **more: Any) -> PlanSettings:
    """Return the `plan` section of another method for the same manoeuvre.

    Start, goal, model, feedback and reference are taken over as far as the method has these keys,
    and the duration if it is that of the slew for both; the other keys have their defaults.

    Args:
        settings: the section that defines the manoeuvre.
        method: a key of PLANNERS.
        source: the file to name in an error.
        more: keys of the method's own section.

    Raises:
        BadInput: if there is no such method, or it cannot plan this manoeuvre.
    """
    requested = plain(settings)
    if method == settings.method:
        loaded = Trust(frozenset({method}))  # before
        return plan_settings({**requested, **more}, source, loaded)
    if method not in PLANNERS:
        raise BadInput(", ".join(PLANNERS), source, "method", method)
    planner, given = PLANNERS[method], planner_of(settings)
    if planner.slews != given.slews:
        raise BadInput(f"it does not plan what {settings.method} does", source, "method", method)
    known = {field.name for field in fields(planner.settings)}
    both = ("duration",) if planner.takes_duration and given.takes_duration else ()
    values = {
        key: requested[key]
        for key in (*_MANOEUVRE, *both)
        if key in known and requested.get(key) is not None
    }
    return plan_settings({**values, **more, "method": method}, source)


def make_plan(
    settings: PlanSettings,
    plant: PlantDescription,
    feedback: Feedback | None = None,
    progress: Progress | None = None,
    law: ActiveLaw | None = None,
    predict: bool = True,
) -> Plan:
    """Return the plan of a `plan` section.

    The summary of a slew has under `believes` the planner's assumptions that differ from the bench,
    and under `predicted_residual_...` the residual under the active law: on the whole bench for a
    spacecraft, on the planner's model for other testbeds. Where the law is not known, joint
    feedback with the gains that the planner assumes flies the plan.

    Args:
        settings: one of the sections above.
        plant: the bench; the section may override its model.
        feedback: gains of the active controller, where it has such gains.
        progress: called with every update of an iteration, if the method has one.
        law: law of the active controller; None: a PD with its gains, or not known.
        predict: whether the plan is flown once more for the residual under the law, which may take
            longer than planning; the summary lacks it otherwise.

    Raises:
        PlanFailed: if there is no such manoeuvre, its numbers overflow, or a boresight enters a
            cone of `keep_out`; the message carries the numbers.
        BadInput: if period, limit, start or a joint cannot be used, or the section is longer than a
            log can hold.
    """
    period, limit = plant.period, plant.effort_limit
    if not (np.isfinite(period) and period > 0.0):
        raise BadInput("a positive number of seconds", key="period", value=period)
    if limit.ndim != 1 or not limit.size or not np.all(limit > 0.0):
        raise BadInput("positive, one per actuator", key="effort_limit", value=limit.tolist())
    _require_near(settings, "")
    tick_times(settings.start, 0.0, period)  # refuses a start between ticks, for every method
    duration = getattr(settings, "duration", None)
    if isinstance(duration, float) and duration / period > _MOST_TICKS:
        raise BadInput(
            f"more than {_MOST_TICKS:,} ticks of {period:g} s", "plan", "duration", duration
        )
    settings = _by_joint(settings, plant)
    entry = planner_of(settings)
    if entry.feedforward and not plant.testbed.model().has_efforts_in_joints:
        words = "computes efforts in the joints, and here they act elsewhere, too; take reference"
        raise PlanFailed(f"{settings.method}: {words}")
    make = entry.make
    if isinstance(make, SlewPlanner):
        make = replace(make, has_prediction=predict)
    try:
        plan = make(PlanTask(settings, plant, feedback, progress or ignore, law))
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        words = f"{settings.method}: its numbers are out of range ({error}); take another goal"
        raise PlanFailed(words) from error
    except MemoryError as error:  # gains so high that the slew takes millions of steps
        words = (
            f"{settings.method}: out of memory ({error}); take lower gains or a shorter duration"
        )
        raise PlanFailed(words) from error
    if not all(np.isfinite(part).all() for part in (plan.position, plan.velocity, plan.effort)):
        raise PlanFailed(
            f"{settings.method}: the flight that was planned is not finite: modes are too fast for "
            f"a period of {period:g} s; use a shorter one, or fewer modes"
        )
    require_clear(plan, plant.testbed)
    require_one_way(plan, plant)
    require_short(yaml_text(plan.request), "plan")
    started = with_jump(plan, plant, getattr(settings, "initial", None) or {})
    return replace(started, versions=software_versions())
