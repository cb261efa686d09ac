"""The planner of Liu and Singh 1997: time-optimal and robust time-optimal slews."""

from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import Field

from flexslew_control.plan import Plan
from flexslew_control.planners.attitude.attitude_goal import Goal
from flexslew_control.planners.checks.rest_at_goal import require_rest
from flexslew_control.planners.entry import PlannerEntry, Variant
from flexslew_control.planners.progress import Progress
from flexslew_control.planners.slew import Feedback, Slew, plan_on_ticks, tick_times
from flexslew_control.planners.slewing import SlewPlanner
from flexslew_control.planners.time_optimal.all_drives import AllDrives, time_optimal_slew
from flexslew_control.planners.time_optimal.bang_bang import BangBang, Insensitive
from flexslew_control.planners.time_optimal.optimal_switching import known_optimum
from flexslew_control.planners.time_optimal.optimality import (
    can_reduce_time,
    joint_sensitivity,
    statement,
)
from flexslew_control.planners.time_optimal.pontryagin import switching_function
from flexslew_control.planners.time_optimal.structures import Structure, require_durations
from flexslew_control.planners.time_optimal.three_axes.three_axes import plan_three_axes
from flexslew_control.planners.trajectories import rigid_duration
from flexslew_control.shared_keys import DesignModel, Initial, Start
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.settings import Positive, section
from flexslew_plant.testbeds import Model
from flexslew_plant.testbeds.contract import ThreeAxes

Share: TypeAlias = Annotated[float, Field(ge=0.0, lt=1.0)]
RESERVE = 0.2  # of the limit, left to a feedback [-]


@section
class TimeOptimal:
    """The fastest slew of the design model within the limits of the drives."""

    method: Literal["time_optimal"] = "time_optimal"
    model: DesignModel = None
    initial: Initial = None
    # joint positions at the end, at rest, by name; a joint left out does not move [rad or m]
    goal: Goal
    start: Start = 0.0
    robust: bool = False  # whether the state at the end is insensitive to the stiffness
    # what is insensitive, if robust: modes, or state (the joint as well)
    insensitive: Insensitive = "modes"
    # kp and kd of the PD that will fly the slew, which robust takes into account; null: open loop
    feedback: Feedback | None = None
    # number of switches, of one mode: fewest (3; robust 5; antisymmetric about the middle where the
    # mode is undamped), asymmetric (as few, least duration), optimal (as many as the extremal has)
    structure: Structure = "fewest"
    # drives in use: moving (that of the joint; of a craft that turns in three axes those about the
    # eigenaxis), all (several at once to save time; on `csa` it needs casadi); all where the goal
    # moves several joints of another testbed
    drives: Literal["moving", "all"] = "moving"
    # amplitude of the effort [N m or N]; null: the limit less the reserve
    amplitude: Positive | None = None
    # fraction of the limit left to the feedback [-]; null: 0.2 with feedback, else 0
    reserve: Share | None = None
    # largest body rate of a slew in three axes by all drives, of its length [rad/s]; null: any
    rate_limit: Positive | None = None
    longest: Positive | None = None  # longest duration that is accepted [s]


def plan_time_optimal(settings: TimeOptimal, requested: Slew, progress: Progress) -> Plan:
    """Return the bang-bang slew to the goal; see make_plan.

    The reference is the optimal trajectory itself, so feedback adds nothing nominally.

    Raises:
        BadInput: if the goal names no joint or needs more than bang-bang efforts can do, or the
            testbed does not rest at it without an effort.
        PlanFailed: if there is no such slew, or it takes longer than allowed.
    """
    if requested.model.attitude is not None:
        return _in_three_axes(settings, requested, progress)
    if settings.rate_limit is not None:
        words = "null; slews in three axes with drives: all keep to one"
        raise BadInput(words, "plan", "rate_limit", settings.rate_limit)
    rigid = rigid_duration(requested.model, requested.start, requested.goal, requested.effort_limit)
    require_rest(requested, rigid)
    slew, durations = found_slew(settings, requested, progress)
    duration = float(durations.sum())
    efforts = slew.efforts(durations.size)
    amplitude = np.abs(efforts).max(axis=0)
    if settings.longest is not None and duration > settings.longest:
        needed = float(amplitude.max()) * (duration / settings.longest) ** 2
        raise PlanFailed(
            f"the slew takes {duration:.4f} s with {amplitude.max():g} N m, {settings.longest:g} s "
            f"allowed; rigid bound {slew.rigid_duration:.4f} s; about {needed:.4g} N m are needed"
        )
    check, optimum = switching_function(slew, durations), None
    if isinstance(slew, BangBang) and can_reduce_time(slew, check, settings.structure):
        optimum = known_optimum(slew, duration)
    ticks = tick_times(settings.start, duration, requested.period)
    state, effort = on_ticks(slew, durations, ticks)
    m, n = slew.model.joints, slew.model.coordinates
    switches = np.cumsum(durations)[:-1]
    summary: dict[str, Any] = {
        "duration": duration,
        "switch_times": switches.tolist(),
        "switches": int(switches.size),
        "amplitude": float(amplitude.max()),
        "arc_efforts": efforts.tolist(),
        "peak_effort": np.abs(effort).max(axis=0).tolist(),
        "terminal_error": slew.residual_jacobian(durations)[0].tolist(),
        "rigid_duration": slew.rigid_duration,
        "optimal": check.holds,
        "switching_function_violation": check.violation,
        "optimality": statement(slew, durations, check, settings.structure, optimum),
        "optimal_duration": duration if check.holds else optimum and optimum.duration,
    }
    if isinstance(slew, BangBang):
        summary["joint_sensitivity"] = joint_sensitivity(slew, durations)
    reference = state[:, :m].copy(), state[:, n : n + m].copy()
    return plan_on_ticks(settings, requested, reference, effort, summary, state)


def _in_three_axes(settings: TimeOptimal, requested: Slew, progress: Progress) -> Plan:
    """Return the fastest slew of a craft that turns in three axes.

    Raises:
        BadInput: it is to be robust, or the testbed has no rigid twin.
        PlanFailed: see plan_three_axes.
    """
    if settings.robust:
        raise BadInput("a slew by all drives is not made robust", "plan", "robust", True)
    if not isinstance(requested.testbed, ThreeAxes):
        raise BadInput("this testbed turns about one axis at a time", "plan", "drives", "all")
    amplitude = _amplitude(settings, requested.effort_limit)
    return plan_three_axes(settings, requested, amplitude, requested.testbed.rigid(), progress)


def found_slew(
    settings: TimeOptimal, requested: Slew, progress: Progress
) -> tuple[BangBang | AllDrives, Vector]:
    """Return the slew of a `plan` section, and the durations of its arcs.

    Raises:
        BadInput, PlanFailed: see plan_time_optimal.
    """
    if requested.static:
        raise BadInput("plan: goal: the joints are there already; give another goal")
    model, first, last = requested.model, requested.start, requested.goal
    changed = np.flatnonzero(last != first)
    amplitude = _amplitude(settings, requested.effort_limit)
    rest = np.zeros(model.modes + model.coordinates)
    start = np.concatenate((first, rest))
    if (
        settings.drives == "all"
        or changed.size > 1
        or changed[0] != 0
        or not _is_separable(model, start)
    ):
        if model.joints == 1:
            raise BadInput("there is one; use moving", "plan", "drives", "all")
        if settings.robust:
            needed = (
                "by all drives" if settings.drives == "all" else "that more than one drive makes"
            )
            raise BadInput(
                f"a slew {needed} is not made robust; use robust: false", "plan", "robust", True
            )
        goal = np.concatenate((last, rest))
        return time_optimal_slew(requested.testbed, start, goal, amplitude, progress)
    with_feedback = settings.feedback is not None
    slew = BangBang(
        model,
        0,
        start,
        float(last[0] - first[0]),
        float(amplitude[0]),
        settings.robust,
        float(requested.kp[0]) if with_feedback else 0.0,
        float(requested.kd[0]) if with_feedback else 0.0,
        settings.insensitive,
    )
    return slew, require_durations(slew, settings.structure)


def _is_separable(model: Model, start: Vector) -> bool:
    """Return whether the first drive leaves the other joints at rest under any effort."""
    rng, m, n = np.random.default_rng(1), model.joints, model.coordinates
    effort = np.eye(m)[0]
    for _ in range(3):
        x = start.copy()
        for k in (0, *range(m, n)):
            x[[k, n + k]] += 0.1 * rng.standard_normal(2)
        if np.abs(model.derivative(x, effort)[n + 1 : n + m]).max(initial=0.0) > 1e-12:
            return False
    return True


def _amplitude(settings: TimeOptimal, effort_limit: Vector) -> Vector:
    """Return the effort of every drive, shape (joints,) [N m or N]."""
    if settings.amplitude is None:
        return np.asarray(_effort_share(settings) * effort_limit)
    most = float(_effort_share(settings) * effort_limit.min())
    if settings.amplitude > most:
        less = "" if settings.reserve is None else " less the reserve"
        raise BadInput(
            f"plan: amplitude: {settings.amplitude:g} is above the drive's limit{less}, {most:g}"
        )
    return np.full(effort_limit.size, settings.amplitude)


def _effort_share(settings: TimeOptimal) -> float:
    """Return the share of each drive's limit that a slew may use, 1 - reserve [-]."""
    if settings.reserve is not None:
        return 1.0 - settings.reserve
    of_feedback = settings.feedback is not None and settings.amplitude is None
    return 1.0 - RESERVE if of_feedback else 1.0


def on_ticks(slew: BangBang | AllDrives, durations: Vector, ticks: Vector) -> tuple[Matrix, Matrix]:
    """Return the states at the ticks and the mean effort of every tick.

    Args:
        slew: what is flown.
        durations: of its arcs [s].
        ticks: rising, from 0 to the end or a little later, shape (ticks + 1,) [s].

    Returns:
        states, shape (ticks + 1, 2 n), and efforts, shape (ticks, joints).
    """
    ends = np.cumsum(durations)
    knots = np.concatenate(([0.0], ends))
    efforts = slew.efforts(durations.size)
    impulse = np.vstack((np.zeros(slew.model.joints), np.cumsum(efforts * durations[:, None], 0)))
    integral = np.column_stack([np.interp(ticks, knots, column) for column in impulse.T])
    means = np.diff(integral, axis=0) / np.diff(ticks)[:, None]
    edges = np.union1d(ticks, ends)
    arc = np.searchsorted(ends, 0.5 * (edges[1:] + edges[:-1]))
    zeros, step = np.zeros(slew.model.joints), slew.step
    states = np.empty((edges.size, slew.start.size))
    states[0] = slew.start
    for k, dt in enumerate(np.diff(edges)):
        effort = efforts[arc[k]] if arc[k] < durations.size else zeros
        steps = max(1, int(np.ceil(dt / step)))
        states[k + 1] = slew.model.advance(states[k], effort, float(dt), steps)
    return states[np.searchsorted(edges, ticks)], means


TIME_OPTIMAL = PlannerEntry(
    TimeOptimal,
    SlewPlanner(
        plan_time_optimal,
        exact=lambda s: True,
        open_loop=True,
        whole=lambda s: s.drives == "all",
        effort_share=_effort_share,
    ),
    compared={"reserve": RESERVE},
    variants=(Variant("robust", {"robust": True}),),
)
