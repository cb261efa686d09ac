"""The planner with the least worst vibration that bounded drives can leave over an ensemble.

Efforts held over pieces of whole ticks minimise the largest tip deflection that any member of the
ensemble keeps after the end, while every member keeps to the limits at every tick under the
feedback that flies it (Singh 2002; Liu and Wie 1992 for the problem; Boyd and Vandenberghe,
chapter 4 for the cones). For a linear plant this is one convex program, with a lower bound that no
other efforts on these pieces can pass below; for any other plant a sequence of them finds a local
optimum. Floating oscillator, stiffness within 20 %, 10 s: 1.2e-4 m without feedback.
"""

from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from flexslew_control.plan import Plan
from flexslew_control.planners.attitude.attitude_goal import GoalKey
from flexslew_control.planners.checks.rest_at_goal import require_rest
from flexslew_control.planners.entry import PlannerEntry
from flexslew_control.planners.minimax.members import Ensemble
from flexslew_control.planners.minimax.optimum import Found, found_optimum
from flexslew_control.planners.minimax.program import Limits
from flexslew_control.planners.minimax.question import Question
from flexslew_control.planners.minimax.search import PATH_MARGIN
from flexslew_control.planners.minimax.shortest import minimum_time, suggest_duration
from flexslew_control.planners.minimax.turn import three_axis_slew
from flexslew_control.planners.minimax.turning_motion import RotationMotion
from flexslew_control.planners.progress import Progress
from flexslew_control.planners.residual.motors import matrices, motor_step
from flexslew_control.planners.slew import (
    FeedbackKey,
    Slew,
    joint_ranges,
    plan_on_ticks,
    tick_times,
)
from flexslew_control.planners.slewing import SlewPlanner
from flexslew_control.shared_keys import DesignModel, Initial, Start
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.known_joints import ByJoint
from flexslew_plant.settings import NonNegative, Positive, section

_MARGIN_SHARE = 0.5  # share of what start and goal have to the edge of a cone that may be spared


@section
class MinimaxFeedforward:
    """Bounded efforts with the least vibration of the worst member of an ensemble."""

    method: Literal["minimax_feedforward"] = "minimax_feedforward"
    model: DesignModel = None
    initial: Initial = None
    goal: GoalKey = None
    start: Start = 0.0
    # duration of the manoeuvre; with `residual_bound` the longest that is allowed [s]
    duration: Positive = 25.0
    # the shortest slew that leaves no more than this on any member is sought [m]; null: the
    # duration is given
    residual_bound: Positive | None = None
    feedback: FeedbackKey = None
    # drives in use of a craft that turns in three axes: moving (those about the eigenaxis), all
    # (several at once, about any axis); other testbeds use all
    drives: Literal["moving", "all"] = "moving"
    ensemble: Ensemble = Ensemble()  # members that the slew must suit
    # over which each effort is held, at most; null: 60, for a plant that is not linear 40
    pieces: Annotated[int, Field(ge=2, le=400)] | None = None
    exact_nominal: bool = False  # whether the planner's own model ends at rest, modes included
    # lowest and highest position that a joint may have on any member, by name [rad or m]; null:
    # free; none of a turn by all drives
    joint_range: ByJoint[tuple[float, float]] | None = None
    # largest rate of a joint on any member, by name [rad/s or m/s]; one number: of the length of
    # the body rate of a turn by all drives [rad/s]; null: free
    rate_limit: Positive | ByJoint[Positive] | None = None
    # largest tip deflection of any member, during the slew and after [m]; null: free
    tip_limit: Positive | None = None
    # weight of the effort, worst residual + rho times the sum of its squares [m/(N m)^2 or m/N^2]
    rho: NonNegative = 0.0
    # fraction of the effort limit kept free [-]
    reserve: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    # of the search on a plant that is not linear, at most
    max_steps: Annotated[int, Field(ge=1)] = 12


def plan_minimax_feedforward(settings: MinimaxFeedforward, slew: Slew, progress: Progress) -> Plan:
    """Return the plan with the least worst residual; see make_plan.

    Raises:
        PlanFailed: the limits let no efforts lead to the goal in this time, or the bound cannot
            be met; the message names a duration that is enough. Or a member diverges under the
            feedback.
        BadInput: a key of the ensemble, a range or a limit cannot be used.
    """
    question = question_of(settings, slew)
    with np.errstate(over="ignore", invalid="ignore"):  # of a loop that is not stable
        found = _optimum_of(settings, question, progress)
        plan = _plan(settings, question, found)
    lost = [
        member.errors
        for member, left in zip(found.members, found.optimum.residuals.tolist(), strict=True)
        if not np.isfinite(left)
    ]
    if lost and np.isfinite(plan.state).all():
        raise PlanFailed(
            f"under the feedback that the plan counts with, kp {slew.kp.tolist()} and kd "
            f"{slew.kd.tolist()}, member {lost[0]} of the ensemble diverges; give plan.feedback "
            "the gains of a controller that holds it"
        )
    return plan


def _optimum_of(settings: MinimaxFeedforward, question: Question, progress: Progress) -> Found:
    """Return the optimum of the duration, or the shortest one that leaves no more than a bound."""
    if settings.residual_bound is not None:
        return minimum_time(question, settings.residual_bound, progress)
    try:
        return found_optimum(question, progress)
    except PlanFailed as refused:
        raise PlanFailed(f"{refused}; {suggest_duration(question)}") from None


def question_of(settings: MinimaxFeedforward, slew: Slew) -> Question:
    """Return the problem of a section.

    Raises:
        BadInput: if a range does not contain start and goal; if the
            testbed does not rest at the goal without an effort; if the craft is there already; or
            if a drive does not turn it.
        PlanFailed: if a boresight is inside a cone of `keep_out` at the start or the goal.
    """
    require_rest(slew, settings.duration)
    names, demand = slew.model.joint_names, (1.0 - settings.reserve) * slew.effort_limit
    rates = settings.rate_limit if isinstance(settings.rate_limit, dict) else {}
    length = None if isinstance(settings.rate_limit, dict) else settings.rate_limit
    turn = three_axis_slew(slew, demand, length)
    if turn is None and length is not None:
        words = "null, or rates by joint; turns in three axes with drives: all keep to one number"
        raise BadInput(words, "plan", "rate_limit", length)
    if turn is not None and settings.joint_range is not None:
        words = "null; a turn by all drives has no range, take moving for one about an axis"
        raise BadInput(words, "plan", "joint_range", settings.joint_range)
    joint = joint_ranges(settings.joint_range or {}, slew)
    rate = np.array([rates.get(name, np.inf) for name in names])
    tip = np.inf if settings.tip_limit is None else settings.tip_limit
    limits = Limits(demand, joint, rate, tip)
    if turn is not None:
        limits = replace(limits, along=turn.motion.limits.bounds)
        limits = replace(
            limits,
            margin=min(PATH_MARGIN, _MARGIN_SHARE * turn.cone_margin) if limits.of_path else 0.0,
        )
    return Question(
        slew,
        settings.ensemble,
        settings.duration,
        settings.pieces,
        limits,
        settings.exact_nominal,
        settings.rho,
        settings.max_steps,
        turn=turn,
    )


def _plan(settings: MinimaxFeedforward, question: Question, found: Found) -> Plan:
    """Return efforts and the nominal member's path under them as a Plan on the ticks."""
    slew = question.slew
    ticks = tick_times(settings.start, found.duration, slew.period)
    efforts, optimum = found.efforts, found.optimum
    rest = np.zeros((ticks.size - 1 - found.grid.ticks, slew.goal.size))
    if question.turn is None:
        position, velocity, state = _by_joint(slew, found, ticks)
    else:
        position, velocity, state = _three_axis_motion(slew, question.turn.motion, found, len(rest))
    summary: dict[str, Any] = {
        "duration": found.duration,
        "peak_effort": np.abs(efforts).max(axis=0).tolist(),
        "worst_residual": optimum.worst,
        "lower_bound": optimum.bound if found.convex else None,
        "optimality": found.words,
        "iterations": found.steps,
        "members": [
            {"errors": member.errors, "residual": residual}
            for member, residual in zip(found.members, optimum.residuals.tolist(), strict=True)
        ],
        "predicted_residual_tip_deflection": float(optimum.residuals[0]),
    }
    effort = np.vstack((efforts, rest))
    return plan_on_ticks(settings, slew, (position, velocity), effort, summary, state)


def _by_joint(slew: Slew, found: Found, ticks: Vector) -> tuple[Matrix, Matrix, Matrix]:
    """Return positions, rates and states at the ticks of the nominal member."""
    m, n, effort_ticks = slew.model.joints, slew.model.coordinates, found.grid.ticks
    state = np.empty((ticks.size, 2 * n))
    state[0] = 0.0
    state[0, :m] = slew.start
    motors = matrices(slew.motors(slew.period))
    late = np.zeros(len(motors[0]))
    for k, effort in enumerate(found.efforts):
        motor_step(motors, late, effort)
        state[k + 1] = slew.model.advance(state[k], effort, slew.period, t=float(ticks[k]))
    state[effort_ticks + 1 :] = np.concatenate((slew.goal, np.zeros(2 * n - m)))
    position, velocity = state[:, :m].copy(), state[:, n : n + m].copy()
    position[effort_ticks:], velocity[effort_ticks:] = slew.goal, 0.0
    return position, velocity, state


def _three_axis_motion(
    slew: Slew, motion: RotationMotion, found: Found, rest: int
) -> tuple[Matrix, Matrix, Matrix]:
    """Return the same of a craft that turns in three axes, which rests for some ticks; no states.

    What laws take for a state is that of joints, see free_platform.nominal.
    """
    none = np.zeros((slew.goal.size, 2 * slew.goal.size))
    motors, turn = slew.motors(slew.period), motion.nominal
    states = motion.flight(slew.model, found.efforts, none, None, motors).states
    position, velocity = turn.joints(np.vstack((states[:-1], np.tile(turn.rest, (rest + 1, 1)))))
    return position, velocity, np.zeros((len(position), 0))


MINIMAX = PlannerEntry(
    MinimaxFeedforward,
    SlewPlanner(
        plan_minimax_feedforward,
        whole=lambda s: s.drives == "all",
        late_motors=True,
        with_feedback=True,
        effort_share=lambda s: 1.0 - s.reserve,
    ),
    takes_duration=True,
    compared={"pieces": 30, "ensemble": {"count": 5}},
    example={"pieces": 12, "ensemble": {"draw": "corners"}, "max_steps": 8},
)
