"""The planner of one feedforward for an ensemble of models: little vibration for every error.

One feedforward flies every member of the ensemble, each under its own feedback. Its weights U
minimise
    sum_i Y_i^T W_i Y_i / members + rho |U|^2
with no member's effort beyond the limits, nor a joint beyond its range where one is requested; Y_i
is the terminal error (20) of Gorinevsky and Vukovich 1998 on member i. W_i is the mean over one
more duration of tip^2 + (lever angle errors)^2 that Y_i leads to in the closed loop, linearised at
the goal: an error counts by the vibration that it leaves, not by its unit. The optimum of the
ensemble leaves the nominal joints off the goal, by 4 mrad in M1; the reference ends at the goal
all the same, see held_efforts.joints_at_rest.

Trial m1 in 25 s, largest residual with EI off by up to 20 %: 0.18 m with 143 N m, on one mode and
on three. The plan that is exact for one model leaves 0.64 m with 78 N m. The hub's pitch swings to
1.03 rad on its way to 0.5; kept below 0.8 the residual is 0.22 m, below 0.52 it is 0.28. More
time helps like torque. The other cost is 0.06 m of nominal residual. More functions than the
paper's nine gain little and excite modes that its model lacks.
"""

from dataclasses import replace
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from flexslew_control.plan import Plan
from flexslew_control.planners.attitude.attitude_goal import GoalKey
from flexslew_control.planners.checks.rest_at_goal import require_rest
from flexslew_control.planners.entry import PlannerEntry, Variant
from flexslew_control.planners.feedforward.basis import Basis, BasisName
from flexslew_control.planners.feedforward.ensemble import FeedforwardMember
from flexslew_control.planners.feedforward.limited_gauss_newton import (
    PRICE,
    Problem,
    limited_gauss_newton,
)
from flexslew_control.planners.feedforward.manoeuvre import (
    Manoeuvre,
    TerminalMap,
    manoeuvre_of,
    substeps_for,
)
from flexslew_control.planners.feedforward.optimized_feedforward import (
    on_ticks,
    with_nominal_reference,
)
from flexslew_control.planners.held_efforts import joints_at_rest
from flexslew_control.planners.progress import Progress, Update, ignore
from flexslew_control.planners.slew import ExcessTorque, FeedbackKey, Slew, joint_ranges
from flexslew_control.planners.slewing import RESIDUAL_SHARE, SlewPlanner
from flexslew_control.planners.trajectories import Profile
from flexslew_control.shared_keys import DesignModel, Initial, Start
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import PlanFailed
from flexslew_plant.known_joints import ByJoint
from flexslew_plant.settings import NonNegative, Positive, section

_HIGH_PRICE = 10.0  # of effort beyond its limit by all of it [m]: high against any vibration
_SMALL_EXCESS, _REDUCTION = 0.2, 1.2  # share beyond the bound that is taken off it, and times this
# share of its excess before that a dearer effort has where the bound can be kept
_EXCESS_RATIO = 0.5
_MAX_SEARCH = 4  # searches with a bound reduced by what bending the reference takes
_GOAL_ERROR = 0.02  # of the way: what a dearer effort may leave of it at the end [-]

_Error = Annotated[float, Field(gt=-0.9, le=5.0)]
_Errors = Annotated[tuple[_Error, ...], Field(min_length=1, max_length=25)]


@section
class RobustFeedforward:
    """One feedforward for an ensemble with varied stiffness and payload."""

    method: Literal["robust_feedforward"] = "robust_feedforward"
    model: DesignModel = None
    initial: Initial = None
    goal: GoalKey = None
    start: Start = 0.0
    duration: Positive = 25.0  # duration of the manoeuvre, T_c [s]
    reference: Profile = "cubic"  # profile of the reference
    feedback: FeedbackKey = None
    # relative errors of the stiffness to plan for; one model for each [-]
    stiffness_errors: _Errors = (-0.2, -0.1, 0.0, 0.1, 0.2)
    # relative errors of the payload to plan for; one model for each pair with a stiffness error [-]
    payload_errors: _Errors = (0.0,)
    basis: BasisName = "hat"  # basis functions of the feedforward
    functions: Annotated[int, Field(ge=1, le=200)] = 9  # number of basis functions per joint, n_u
    lever: NonNegative = 5.0  # weight of a joint error against a tip error [m/rad]
    rho: Positive = 1.0e-8  # weight of the torque [1/(N m)^2]
    # lowest and highest position that a joint may have on any model, by name: `{JOINT: [-0.1,
    # 0.6]}` [rad or m]; null: free
    joint_range: ByJoint[tuple[float, float]] | None = None
    # fraction of the effort limit kept free, on every model [-]
    reserve: Annotated[float, Field(ge=0.01, lt=1.0)] = 0.05
    max_iterations: Annotated[int, Field(ge=1)] = 60  # largest number of updates
    tolerance: Positive = 1e-3  # relative improvement of the objective at which to stop [-]


def ensemble(settings: RobustFeedforward, slew: Slew) -> tuple[FeedforwardMember, ...]:
    """Return a member for every pair of a stiffness error and a payload error."""
    members = []
    for payload in settings.payload_errors:
        loaded = replace(slew, testbed=slew.testbed.scaled(payload=1.0 + payload))
        responses = manoeuvre_of(loaded, settings.duration, settings.reference)
        for error in settings.stiffness_errors:
            model = responses.model.with_stiffness(1.0 + error)
            members.append(
                FeedforwardMember(error, payload, replace(responses, model=model), settings.lever)
            )
    return tuple(members)


class _Found(NamedTuple):
    """Weights, and what the members do with them."""

    weights: Matrix  # (n_u, joints) [N m]
    last: Update
    iterations: int
    residuals: list[float]  # [m]
    deflection: float  # largest of any member on its way [m]
    peaks: Matrix  # (members, joints) [N m]
    swing: Matrix  # lowest and highest of all members, (2, joints) [rad or m]


def _best_weights(problem: Problem, settings: RobustFeedforward, progress: Progress) -> _Found:
    """Return the best weights at the problem's price of effort beyond its limit."""
    history = limited_gauss_newton(problem, settings.max_iterations, settings.tolerance, progress)
    joints = problem.members[0].manoeuvre.model.joints
    weights = history[-1][0].reshape(joints, -1).T
    responses = [member.simulate(problem.basis, weights) for member in problem.members]
    ranges = np.array([member.swing for member in responses])
    return _Found(
        weights,
        history[-1][1],
        len(history),
        [member.residual for member in responses],
        max(member.deflection for member in responses),
        np.array([member.peak for member in responses]),
        np.array((ranges[:, 0].min(axis=0), ranges[:, 1].max(axis=0))),
    )


def _check_limits(found: _Found, effort_limit: Vector, requested: Matrix) -> bool:
    """Return whether all members keep to the limits."""
    kept = (found.peaks <= effort_limit).all() and (found.swing[0] >= requested[0]).all()
    return bool(kept and (found.swing[1] <= requested[1]).all())


def _ends_at_goal(nominal: Manoeuvre, basis: Basis, weights: Matrix) -> bool:
    """Return whether the nominal joints end near the goal."""
    at = TerminalMap(nominal, basis, substeps_for(nominal, basis))
    error = at.terminal_error(weights.T.ravel())[: nominal.model.joints]
    way = np.abs(nominal.goal - nominal.start).max()
    return bool(np.abs(error).max() <= _GOAL_ERROR * way)


def _price_steps(allowed: Vector) -> Vector:
    """Return prices of effort beyond its limit, to be tried in turn where it is not kept [m/(N m)].

    PRICE suits drives of some 100 N m; where a limit is small, it is low against the vibration.
    """
    exponent = np.ceil(np.log10(_HIGH_PRICE / (PRICE * allowed.min())))
    return np.asarray(PRICE * 10.0 ** np.arange(1.0, np.clip(exponent, 3.0, 20.0) + 1.0))


def _limited_weights(
    problem: Problem,
    settings: RobustFeedforward,
    nominal: Manoeuvre,
    requested: Matrix,
    progress: Progress,
) -> _Found:
    """Return weights with which all members keep to the limits; the first ones where none do.

    A price buys vibration with a little effort beyond the bound. The bound is reduced by what the
    members exceed it, then the price is raised.
    """
    first = _best_weights(problem, settings, progress)
    allowed = problem.effort_limit
    if _check_limits(first, allowed, requested):
        return first
    before = np.inf
    for price in (problem.price, *_price_steps(allowed)):
        try:
            found = first
            if price != problem.price:
                found = _best_weights(replace(problem, price=price), settings, ignore)
            over = float((found.peaks / allowed).max()) - 1.0
            if 0.0 < over < min(_SMALL_EXCESS, _EXCESS_RATIO * before):
                bound = (1.0 - _REDUCTION * over) * allowed
                reduced = replace(problem, price=price, effort_limit=bound)
                found = _best_weights(reduced, settings, ignore)
            before = over
        except PlanFailed:
            break
        if _check_limits(found, allowed, requested):
            return found if _ends_at_goal(nominal, problem.basis, found.weights) else first
    return first


def _residual_warning(found: _Found, members: tuple[FeedforwardMember, ...]) -> dict[str, str]:
    """Return a warning of a member with tips that vibrate after the end; empty: there is none."""
    k = int(np.argmax(found.residuals))
    left = found.residuals[k]
    if left <= RESIDUAL_SHARE * found.deflection:
        return {}
    off = f"stiffness {100.0 * members[k].stiffness_error:+g} %"
    if members[k].payload_error:
        off += f", payload {100.0 * members[k].payload_error:+g} %"
    return {
        "warning": f"the tip vibrates by {left:.3g} m after the end on one of the models ({off}); "
        "minimax_feedforward gives the least residual for this duration"
    }


def _require_range(requested: Matrix, position_range: Matrix, names: tuple[str, ...]) -> None:
    """Raise PlanFailed where a member swings beyond the range."""
    for j, name in enumerate(names):
        if position_range[0, j] < requested[0, j] or position_range[1, j] > requested[1, j]:
            raise PlanFailed(
                f"{name} swings from {position_range[0, j]:.4g} to {position_range[1, j]:.4g}, "
                f"joint_range allows {requested[0, j]:g} to {requested[1, j]:g}: ask for a longer "
                "duration, a larger rho or a wider range"
            )


def _reference_plan(
    settings: RobustFeedforward, slew: Slew, nominal: Manoeuvre, basis: Basis, found: _Found
) -> Plan:
    """Return the plan with the weights found and a reference that ends at rest at the goal."""
    plan = on_ticks(settings, slew, nominal, basis, found.weights)
    plan = with_nominal_reference(plan, slew, nominal, basis, found.weights)
    return joints_at_rest(plan, slew, (1.0 - settings.reserve) * slew.effort_limit)


def _require_torque(
    settings: RobustFeedforward, slew: Slew, members: tuple[FeedforwardMember, ...], peaks: Matrix
) -> None:
    """Check that no member needs more than the limit less the reserve.

    Raises:
        ExcessTorque: one does.
    """
    allowed = (1.0 - settings.reserve) * slew.effort_limit
    for j, name in enumerate(slew.model.joint_names):
        largest = int(np.argmax(peaks[:, j]))
        if not peaks[largest, j] <= allowed[j]:
            raise ExcessTorque(
                f"the ensemble needs {peaks[largest, j]:.4g} N m on {name} (EI "
                f"{100.0 * members[largest].stiffness_error:+g} %), the limit is "
                f"{slew.effort_limit[j]:g} N m, of which {allowed[j]:.4g} may be used"
            )


def _best_plan(
    settings: RobustFeedforward,
    slew: Slew,
    nominal: Manoeuvre,
    problem: Problem,
    requested: Matrix,
    progress: Progress,
) -> tuple[_Found, Plan]:
    """Return weights and their plan, all efforts within the limits less the reserve.

    To bend the reference to the goal takes an effort, too. The bound is reduced by what this
    exceeds it.

    Raises:
        PlanFailed: the iteration does not settle, or a member leaves its range.
        ExcessTorque: a member or the plan needs more.
    """
    allowed = problem.effort_limit
    members = tuple(problem.members)
    for k in range(_MAX_SEARCH):
        found = _limited_weights(problem, settings, nominal, requested, ignore if k else progress)
        _require_range(requested, found.swing, slew.model.joint_names)
        _require_torque(settings, slew, members, found.peaks)
        plan = _reference_plan(settings, slew, nominal, problem.basis, found)
        peak = abs(plan.effort).max(axis=0)
        over = float((peak / allowed).max()) - 1.0
        if over <= 0.0:
            return found, plan
        if over > _SMALL_EXCESS:
            break
        bound = (1.0 - _REDUCTION * over) * problem.effort_limit
        problem = replace(problem, effort_limit=bound)
    j = int((peak / allowed).argmax())
    raise ExcessTorque(
        f"to end at the goal on the nominal model, too, {slew.model.joint_names[j]} needs "
        f"{peak[j]:.4g} N m, {allowed[j]:.4g} may be used"
    )


def plan_robust_feedforward(settings: RobustFeedforward, slew: Slew, progress: Progress) -> Plan:
    """Return the plan of one feedforward for the whole ensemble; see make_plan.

    Raises:
        PlanFailed: if the iteration does not settle.
        ExcessTorque: if a member needs more than the drives have.
        BadInput: if a range names no joint, start or goal are not inside it, or the testbed does
            not rest at the goal without an effort.
    """
    require_rest(slew, settings.duration)
    members = ensemble(settings, slew)
    nominal = manoeuvre_of(slew, settings.duration, settings.reference)
    basis = Basis(settings.basis, settings.functions, settings.duration)
    free = 1.0 - settings.reserve
    requested, inner = joint_ranges(settings.joint_range or {}, slew, strict=True), None
    if settings.joint_range is not None:
        ends = np.array((np.minimum(slew.start, slew.goal), np.maximum(slew.start, slew.goal)))
        inner = np.where(np.isfinite(requested), ends + free * (requested - ends), requested)
    problem = Problem(members, basis, settings.rho, free * slew.effort_limit, inner)
    found, plan = _best_plan(settings, slew, nominal, problem, requested, progress)
    position_range = found.swing
    summary: dict[str, Any] = {
        "objective": found.last.objective,
        "norm_input": found.last.norm_input,
        "iterations": found.iterations,
        "worst_residual": max(found.residuals),
        "members": [
            {
                "stiffness_error": member.stiffness_error,
                "payload_error": member.payload_error,
                "residual": residual,  # largest tip deflection in 75 s after the end [m]
                "peak_effort": peak.tolist(),
            }
            for member, residual, peak in zip(members, found.residuals, found.peaks, strict=True)
        ],
        "worst_peak_effort": found.peaks.max(axis=0).tolist(),
        "swing": {
            n: position_range[:, j].tolist() for j, n in enumerate(nominal.model.joint_names)
        },
        "weights": found.weights.T.tolist(),
        **_residual_warning(found, members),
    }
    return replace(plan, summary=summary | plan.summary)


ROBUST = PlannerEntry(
    RobustFeedforward,
    SlewPlanner(plan_robust_feedforward, effort_share=lambda s: 1.0 - s.reserve),
    takes_duration=True,
    variants=(
        Variant(
            "payload",
            {"stiffness_errors": (-0.2, 0.0, 0.2), "payload_errors": (-0.2, 0.0, 0.2)},
        ),
        Variant("1.2 x time", {}, duration_factor=1.2),
    ),
)
