"""Feedforward (18) that brings the terminal error to zero.

Gorinevsky and Vukovich 1998, section 3.
"""

from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from flexslew_control.plan import Plan
from flexslew_control.planners.attitude.attitude_goal import GoalKey
from flexslew_control.planners.entry import PlannerEntry
from flexslew_control.planners.feedforward.basis import Basis, BasisName
from flexslew_control.planners.feedforward.gauss_newton import (
    FeedforwardOptimum,
    Options,
    Reading,
    Sensitivities,
    optimize,
)
from flexslew_control.planners.feedforward.manoeuvre import (
    Manoeuvre,
    TerminalMap,
    manoeuvre_of,
    stage_times,
    substeps_for,
)
from flexslew_control.planners.progress import Progress
from flexslew_control.planners.slew import (
    FeedbackKey,
    Slew,
    plan_on_ticks,
    require_effort,
    tick_times,
)
from flexslew_control.planners.slewing import SlewPlanner
from flexslew_control.planners.trajectories import Profile, rest_to_rest
from flexslew_control.shared_keys import DesignModel, Initial, Start
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import PlanFailed
from flexslew_plant.settings import Positive, section
from flexslew_plant.testbeds.model import Model


@section
class OptimizedFeedforward:
    """Feedforward of basis functions that brings the terminal error to zero."""

    method: Literal["optimized_feedforward"] = "optimized_feedforward"
    model: DesignModel = None
    initial: Initial = None
    goal: GoalKey = None
    start: Start = 0.0
    duration: Positive = 25.0  # duration of the manoeuvre, T_c [s]
    reference: Profile = "cubic"  # profile of the reference
    feedback: FeedbackKey = None
    basis: BasisName = "hat"  # basis functions of the feedforward
    functions: Annotated[int, Field(ge=1, le=200)] = 9  # number of basis functions per joint, n_u
    reading: Reading = "levenberg"  # interpretation of the update law
    rho: Positive = 4.0e-8  # weight of the torque [1/(N m)^2]
    # when to stop: converge, or paper (two evaluations of G, three updates each)
    iterations: Literal["converge", "paper"] = "converge"
    sensitivities: Sensitivities = "exact"  # how derivatives are computed
    max_iterations: Annotated[int, Field(ge=1)] = 100  # largest number of updates
    tolerance: Positive = 1e-6  # relative change of the weights at which to stop [-]
    # what the feedback follows: planned (the planned trajectory, so that the run matches the plan
    # at any period) or reference (as in the paper)
    track: Literal["planned", "reference"] = "planned"


def find_feedforward(
    settings: OptimizedFeedforward, manoeuvre: Manoeuvre, progress: Progress
) -> tuple[Basis, FeedforwardOptimum]:
    """Return the basis and its optimal weights for the manoeuvre.

    Raises:
        PlanFailed: the iteration diverges or does not settle.
    """
    basis = Basis(settings.basis, settings.functions, manoeuvre.duration)
    substeps = substeps_for(manoeuvre, basis)
    maps = tuple(TerminalMap(manoeuvre, basis, n) for n in ((substeps + 2) // 3, substeps))
    options = Options(
        reading=settings.reading,
        rho=settings.rho,
        paper=settings.iterations == "paper",
        sensitivities=settings.sensitivities,
        max_iterations=settings.max_iterations,
        tolerance=settings.tolerance,
    )
    return basis, optimize((maps[0], maps[1]), options, progress)


def plan_optimized_feedforward(
    settings: OptimizedFeedforward, slew: Slew, progress: Progress
) -> Plan:
    """Return the plan with the optimal feedforward; see make_plan."""
    manoeuvre = manoeuvre_of(slew, settings.duration, settings.reference)
    basis, optimum = find_feedforward(settings, manoeuvre, progress)
    weights = optimum.weights.reshape(manoeuvre.model.joints, -1).T
    plan = on_ticks(settings, slew, manoeuvre, basis, weights)
    if settings.track == "planned":
        plan = with_nominal_reference(plan, slew, manoeuvre, basis, weights)
    last = optimum.history[-1]
    found: dict[str, Any] = {
        "objective": last.objective,
        "norm_input": last.norm_input,
        "norm_terminal_error": last.norm_terminal_error,
        "terminal_error": optimum.terminal_error.tolist(),
        "iterations": len(optimum.history),
        "converged": optimum.converged,
        "weights": weights.T.tolist(),
        "history": [update._asdict() for update in optimum.history],
    }
    return replace(plan, summary=found | plan.summary)


def on_ticks(
    settings: Any,
    slew: Slew,
    manoeuvre: Manoeuvre,
    basis: Basis,
    weights: Matrix,
) -> Plan:
    """Return the slew with the feedforward basis @ weights as a Plan on the ticks.

    The nominal states are those of the planner's model under the continuous feedforward; the
    effort of a tick is its mean over the tick.

    Args:
        settings: the `plan` section; its method and start are read.
        slew: the requested slew.
        manoeuvre: the slew under its feedback.
        basis: functions of the feedforward.
        weights: shape (n_u, joints) [N m].

    Raises:
        ExcessTorque: feedforward and feedback together need more than the limit.
    """
    ticks = tick_times(settings.start, manoeuvre.duration, slew.period)
    edges = np.union1d(ticks, basis.nodes)
    kept = np.append(True, np.diff(edges) > 1e-9 * manoeuvre.duration)
    edges = edges[kept]  # a node off a tick by rounding is the tick
    path = manoeuvre.fly(edges, basis.values(stage_times(edges)) @ weights)
    reference = rest_to_rest(
        manoeuvre.reference, manoeuvre.start, manoeuvre.goal, manoeuvre.duration, ticks
    )
    effort = manoeuvre.efforts(edges, basis.values(edges) @ weights, path)
    peak = np.abs(effort).max(axis=0)
    _check_saturation(manoeuvre.model, peak, slew.effort_limit)
    at = np.searchsorted(edges, ticks - 1e-9 * manoeuvre.duration)
    summary = {"duration": manoeuvre.duration, "peak_effort": peak.tolist()}
    ends = reference.position, reference.velocity
    means = basis.means(ticks) @ weights
    return plan_on_ticks(settings, slew, ends, means, summary, path[at])


def with_nominal_reference(
    plan: Plan, slew: Slew, manoeuvre: Manoeuvre, basis: Basis, weights: Matrix
) -> Plan:
    """Return the plan with the planned trajectory as its reference and the same total efforts.

    The mean of the nominal feedback over a tick is added to the effort of the tick, and the nominal
    states are those of the model under the efforts held over each tick. So the feedback is zero
    nominally at every tick for every period, and any law can follow the plan.

    Args:
        plan: from on_ticks.
        slew, manoeuvre, basis, weights: as in on_ticks.
    """
    m, n = slew.model.joints, slew.model.coordinates
    ticks = slew.period * np.arange(plan.ticks + 1, dtype=np.float64)
    middle_times = 0.5 * (ticks[1:] + ticks[:-1])
    edges = np.union1d(np.union1d(ticks, middle_times), basis.nodes)
    kept = np.append(True, np.diff(edges) > 1e-9 * manoeuvre.duration)
    edges = edges[kept]
    path = manoeuvre.fly(edges, basis.values(stage_times(edges)) @ weights)
    feedback = manoeuvre.efforts(edges, np.zeros((edges.size, m)), path)
    slack = 1e-9 * manoeuvre.duration
    at, middle = np.searchsorted(edges, ticks - slack), np.searchsorted(edges, middle_times - slack)
    mean = (feedback[at[:-1]] + 4.0 * feedback[middle] + feedback[at[1:]]) / 6.0  # Simpson
    effort = plan.effort + mean
    state = np.vstack((path[0], slew.model.path(path[0], effort, slew.period, slew.steps)))
    position, velocity = state[:, :m].copy(), state[:, n : n + m].copy()
    position[-1], velocity[-1] = slew.goal, 0.0
    return replace(plan, position=position, velocity=velocity, effort=effort, state=state)


def _check_saturation(model: Model, peak: Vector, limit: Vector) -> None:
    if not np.isfinite(peak).all():
        raise PlanFailed("modes are too fast for a tick; plan with a `model` of fewer modes")
    words = "the manoeuvre needs {:.4g} N m on {}, the limit is {:g} N m"
    require_effort(peak, limit, model.joint_names, words)


OPTIMIZED = PlannerEntry(
    OptimizedFeedforward,
    SlewPlanner(plan_optimized_feedforward, exact=lambda s: s.track == "planned"),
    takes_duration=True,
)
