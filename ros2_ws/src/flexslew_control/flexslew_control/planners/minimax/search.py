"""The search of a local optimum of a plant that is not linear: starts, members and ticks.

It is sought on the outermost members, with those that turn out worse added, and on coarse ticks
first.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexslew_control.planners.held_efforts import least_change
from flexslew_control.planners.minimax.between_ticks import passed
from flexslew_control.planners.minimax.members import Member
from flexslew_control.planners.minimax.question import Question
from flexslew_control.planners.minimax.response import Grid
from flexslew_control.planners.minimax.successive import (
    FIRST_RADIUS,
    EnsembleProblem,
    Local,
    Merit,
    ensemble_problem,
    improved,
)
from flexslew_control.planners.progress import Progress, Update
from flexslew_control.planners.residual.whole_bench import TIP_FLOOR
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import PlanFailed

_A_PIECE = 5  # coarse ticks, at least
_ANGLE = 0.4  # of the fastest pole in a coarse tick [rad]
FEASIBLE = 5e-4  # share of the end and the limits at which no member joins
_MAX_VIOLATION = 2e-3  # share of the end and the limits that may be missed
_ADD_MARGIN = 0.02  # than the members that were counted with, for another one to join them [-]
_A_START = 5  # steps, after which a start that is behind the best plan is given up
_COST_RATIO = 1.3  # times its cost
_RADIUS_RATIO = 4.0  # than the region of the last step is that of the first with more members [-]
_MIN_RADIUS = 0.02  # of the limits, the smallest first region with more members [-]
_MORE = 6  # rounds in which members join, or an unsettled search goes on
_NEWTON_STEPS, _CLOSE = 5, 1e-9  # of Newton's method, and share of the end that is missed then [-]
_AT_ONCE = 6  # members that join in a round
# share of the limits of a turn's path that is kept free, four times what is missed
PATH_MARGIN = 2e-3
_MARGIN_RATIO, _MAX_MARGIN_STEPS = 1.5, 4  # times what was passed between the ticks, and how often


@dataclass
class Report:
    """Calls a listener with every program that is solved."""

    progress: Progress
    count: int = 0

    def __call__(self, weights: Vector, residual: float, bound: float) -> None:
        """Report one more program, its worst residual and the bound [m]."""
        self.count += 1
        gap = (residual - bound) / max(residual, 1e-300)
        size = float(np.linalg.norm(weights))
        self.progress(Update(self.count, residual, residual, size, gap, True))


def local_optimum(
    question: Question, members: tuple[Member, ...], report: Report
) -> tuple[Grid, Vector, Merit]:
    """Return pieces, their weights and what they come to: the best local optimum of two starts.

    Raises:
        PlanFailed: none was found that leads to the goal.
    """
    stride, used = _stride(question), _extreme_members(members)
    grid = question.grid(stride)
    coarse = ensemble_problem(question, members, grid)
    first, *others = _starts(coarse)
    best, used = _extended(coarse, first, used, report)
    done = best.merit.residuals.max() <= TIP_FLOOR
    done |= question.feasible and best.merit.max_violation <= FEASIBLE
    for start in () if done else others:
        local = improved(coarse.of(_extreme_members(members)), start, _A_START, listener=report)
        if local.merit.cost < _COST_RATIO * best.merit.cost:
            other, more = _extended(coarse, local.weights, used, report)
            if other.merit.cost < best.merit.cost:
                best, used = other, more
    fine = grid._replace(
        edges=tuple(stride * edge for edge in grid.edges),
        period=question.slew.period,
        monitored=stride * grid.monitored,
    ).extend_until(question.ticks)
    problem = ensemble_problem(question, members, fine)
    weights, merit = best.weights, problem.merit(best.weights)
    most = np.inf if question.feasible else (1.0 + _ADD_MARGIN) * best.merit.residuals.max()
    if merit.residuals.max() > max(most, TIP_FLOOR) or merit.max_violation > FEASIBLE:
        weights = _extended(problem, weights, used, report)[0].weights
    weights, merit = _closed(problem, weights)
    past = passed(problem, weights) if question.turn is not None else 0.0
    for _ in range(_MAX_MARGIN_STEPS):
        if past <= 0.0 or merit.max_violation > _MAX_VIOLATION:
            break
        problem = _with_margin(problem, past)
        weights, merit = _closed(problem, _extended(problem, weights, used, report)[0].weights)
        past = passed(problem, weights)
    _require_limits(question, merit, past)
    return fine, weights, merit


def _require_limits(question: Question, merit: Merit, past: float) -> None:
    """Check that efforts keep to the limits, between the ticks too.

    Raises:
        PlanFailed: they do not.
    """
    if merit.max_violation > _MAX_VIOLATION:
        raise PlanFailed(
            f"no efforts were found that lead to the goal in {question.duration:g} s within the "
            f"limits: the best ones miss by {100.0 * merit.max_violation:.3g} % of them"
        )
    if past > 0.0:
        raise PlanFailed(
            f"no efforts were found that keep out of the cones of keep_out and below rate_limit in "
            f"{question.duration:g} s: the best ones pass a limit by {100.0 * past:.3g} % of it"
        )


def _extended(
    ensemble: EnsembleProblem, start: Vector, used: list[int], report: Report
) -> tuple[Local, list[int]]:
    """Return the optimum for all members near some weights, and those that decide it.

    It is sought on some members; the worst of the others join them until none is worse and the
    search has settled: one that ends early may leave more than that of a shorter slew.
    """
    radius, question = FIRST_RADIUS, ensemble.question
    for _ in range(_MORE):
        local = improved(ensemble.of(used), start, question.steps, radius, report)
        start = local.weights
        radius = float(np.clip(_RADIUS_RATIO * local.radius, _MIN_RADIUS, FIRST_RADIUS))
        merit = ensemble.merit(start)
        selected = merit.residuals > (1.0 + _ADD_MARGIN) * local.merit.residuals.max()
        selected &= (merit.residuals > TIP_FLOOR) & (not question.feasible)
        selected |= merit.violations > FEASIBLE
        new = [int(i) for i in np.flatnonzero(selected) if i not in used]
        if not new and local.settled:
            break
        price = merit.residuals + ensemble.price * merit.violations
        used = [*used, *sorted(new, key=lambda i: -float(price[i]))[:_AT_ONCE]]
    return local, used


def _ended(ensemble: EnsembleProblem, weights: Vector) -> Vector:
    """Return the weights with which the nominal member's end is met, by Newton's method.

    The smallest change is weighed by the room below the limits.
    """
    nominal = ensemble.of([0])
    limit = np.tile(ensemble.question.limits.demand, ensemble.grid.pieces)
    for _ in range(_NEWTON_STEPS):
        response = nominal.responses(weights, nominal.simulate(weights))
        program, (slope, offset) = nominal.program(response), response[0].path.end
        error = program.end_error(slope @ weights + offset)
        if np.abs(error).max(initial=0.0) < _CLOSE:
            break
        change = least_change(program.end_error(slope), limit - abs(weights), error)
        weights = np.clip(weights - change, -limit, limit)
    return weights


def _closed(ensemble: EnsembleProblem, weights: Vector) -> tuple[Vector, Merit]:
    """Return weights and what they come to; of a turn those with which its end is met."""
    merit = ensemble.merit(weights)
    if ensemble.question.turn is not None and not ensemble.question.feasible:
        exact_weights = _ended(ensemble, weights)
        exact = ensemble.merit(exact_weights)
        if exact.max_violation <= max(merit.max_violation, FEASIBLE):
            return exact_weights, exact
    return weights, merit


def _with_margin(ensemble: EnsembleProblem, past: float) -> EnsembleProblem:
    """Return the problem with more to spare, after so large a share was passed."""
    question, limits = ensemble.question, ensemble.question.limits
    limits = replace(limits, margin=limits.margin + _MARGIN_RATIO * past)
    return replace(ensemble, question=replace(question, limits=limits))


def _extreme_members(members: Sequence[Member]) -> list[int]:
    """Return the indices of the nominal member and of those with all errors at their ends."""
    errors = np.array([list(member.errors.values()) for member in members])
    if not errors.size:
        return [0]
    ends = (errors == errors.min(axis=0)) | (errors == errors.max(axis=0))
    return [0, *(int(i) for i in np.flatnonzero(ends.all(axis=1)) if i)]


def _stride(question: Question) -> int:
    """Return how many ticks make a coarse one."""
    slew = question.slew
    rest = slew.model.rest(slew.named(slew.goal))
    poles = slew.model.linearise(rest).with_feedback(slew.kp, slew.kd).eigenvalues
    most = _ANGLE / float(np.abs(poles).max()) / slew.period
    grid = question.grid()
    most = max(int(min(most, grid.ticks / grid.pieces / _A_PIECE)), 1)
    return min(range(most, most // 2, -1), key=lambda stride: grid.ticks % stride)


def _starts(ensemble: EnsembleProblem) -> list[Vector]:
    """Return efforts to start from: those of a smooth rigid turn, and none.

    In three axes the fastest ones of a rigid craft, slowed down, come instead of none. Where the
    path has limits, the start that misses least comes first.
    """
    question, grid = ensemble.question, ensemble.grid
    limit = np.tile(question.limits.demand, grid.pieces)
    other = np.zeros(grid.size) if question.turn is None else question.turn.scaled_weights(grid)
    starts = [np.clip(start, -limit, limit) for start in (smooth(question, grid), other)]
    if not question.limits.along.size:
        return starts
    return sorted(starts, key=lambda weights: ensemble.merit(weights).max_violation)


def smooth(question: Question, grid: Grid) -> Vector:
    """Return the efforts of a rigid turn with linearly falling acceleration, as 3 s^2 - 2 s^3."""
    slew = question.slew
    edges = grid.period * np.array(grid.edges)
    long, left = np.diff(edges), edges[-1] - 0.5 * (edges[1:] + edges[:-1])
    shape = np.vstack((left - 0.5 * edges[-1], np.ones_like(left)))
    ends = np.vstack((long, long * left))  # rate and position at the end
    acceleration = np.linalg.solve(ends @ shape.T, [0.0, 1.0]) @ shape
    if question.turn is not None:
        rate = np.cumsum(acceleration * long) - 0.5 * acceleration * long
        return question.turn.eigenaxis_efforts(acceleration, rate).ravel()
    rest = slew.model.rest(slew.named(0.5 * (slew.start + slew.goal)))
    m = slew.goal.size
    inertia = slew.model.mass_matrix(rest)[:m, :m]
    return np.outer(acceleration, inertia @ (slew.goal - slew.start)).ravel()
