"""The optimum of one slew: which program a plant leads to, and what its solution is worth.

Of linear plants more time is never worse: the efforts of a shorter slew, held at the goal until the
end of a longer one, leave it no more. So where a longer slew gains nothing for certain, a shorter
one is held.
"""

from dataclasses import replace
from typing import NamedTuple

from flexslew_control.planners.minimax.linear_path import is_linear
from flexslew_control.planners.minimax.members import Member, intermediate_members, members_of
from flexslew_control.planners.minimax.program import Optimum
from flexslew_control.planners.minimax.question import Question, convex_program
from flexslew_control.planners.minimax.response import Grid
from flexslew_control.planners.minimax.rounds import RESIDUAL_FLOOR, Goal, solved
from flexslew_control.planners.minimax.search import FEASIBLE, Report, local_optimum, smooth
from flexslew_control.planners.minimax.successive import ensemble_problem
from flexslew_control.planners.progress import Progress
from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import PlanFailed

_RESIDUAL_FLOOR = 1e-9  # of the way, a residual that no bench measures [m/rad]
_SMALLEST = 1e-9  # the same of any way [m]
_BOUND_RATIO = 1.01  # times the lower bound, up to which an optimum is one for certain
_REFINE_STEPS = 2  # in which members join
_PARTS = 4  # into which the members between them cut the way from one level to the next
_MORE = 0.03  # than the worst member, at which those between the members join them [-]
_SAME = 0.999  # of a duration, from which on a shorter one is no other
_DURATION_RATIO = 2.0  # from one of the durations that are held to the next [-]


class Found(NamedTuple):
    """An optimum."""

    duration: float  # [s]
    grid: Grid  # of its efforts
    members: tuple[Member, ...]
    optimum: Optimum
    convex: bool  # whether its bound is one for all efforts on these pieces
    steps: int
    words: str  # what it is worth

    @property
    def efforts(self) -> Matrix:
        """Of every tick with efforts, shape (ticks, joints) [N m or N]."""
        return self.grid.tick_efforts(self.optimum.weights)


def found_optimum(question: Question, progress: Progress, target: float | None = None) -> Found:
    """Return the efforts with the least worst residual in a given time.

    Args:
        question: what is sought.
        progress: called with every program that is solved.
        target: a residual that is good enough; an optimum above it need not be exact [m].

    Raises:
        PlanFailed: no efforts within the limits lead to the goal, or the search does not settle.
        BadInput: the ensemble cannot be made.
    """
    members = members_of(question.ensemble, question.slew)
    report = Report(progress)
    if (direct := _smooth_optimum(question, members)) is not None:
        return direct
    if all(is_linear(member.model) for member in members):
        return _convex(question, members, report, target)
    return _local(question, members, report)


def _smooth_optimum(question: Question, members: tuple[Member, ...]) -> Found | None:
    """Return a smooth rigid turn; None: it misses the limits, or leaves what can be seen."""
    grid = question.grid()
    if question.rho or grid.pieces < 2:
        return None
    weights = smooth(question, grid)
    merit = ensemble_problem(question, members, grid).merit(weights)
    threshold = max(_RESIDUAL_FLOOR * question.span, _SMALLEST)
    if merit.residuals.max() > threshold or merit.max_violation > FEASIBLE:
        return None
    words = "a smooth turn, which leaves nothing that can be seen; nothing better was sought"
    optimum = merit.as_optimum(weights)
    return Found(question.duration, grid, members, optimum, False, 0, words)


def _convex(
    question: Question, members: tuple[Member, ...], report: Report, target: float | None
) -> Found:
    """Return the optimum of linear members; where it is not one for certain, the better of two.

    The other one is that of a shorter slew, held at the goal. The durations of those are the same
    for all slews.
    """
    direct = _direct(question, members, report, target)
    best, floor = direct.optimum, RESIDUAL_FLOOR * question.span
    # which of two residuals of rounding is the smaller one is chance
    is_optimal = best.worst <= floor or (best.worst <= _BOUND_RATIO * best.bound and question.fine)
    duration = question.rigid
    while _DURATION_RATIO * duration < question.duration:
        duration *= _DURATION_RATIO
    if is_optimal or target is not None or duration > _SAME * question.duration:
        return direct
    try:
        other = _convex(replace(question, duration=duration), members, report, None)
    except PlanFailed:
        return direct
    other = _extend_optimum(question, other, report)
    return direct if direct.optimum.worst <= other.optimum.worst else other


def _direct(
    question: Question, members: tuple[Member, ...], report: Report, target: float | None
) -> Found:
    """Return the optimum of linear members with efforts until the end.

    Members between the others join them where they are left with more.
    """
    program = convex_program(question, members)
    best = solved(program, report, Goal(target=target))
    for _ in range(_REFINE_STEPS if target is None or best.worst <= target else 0):
        if not (more := _additional_members(question, program.grid, best)):
            break
        members = (*members, *more)
        program = convex_program(question, members)
        best = solved(program, report, Goal(target=target), best.rows)
    words = (
        f"no efforts on {program.grid.pieces} pieces leave less than {best.bound:.4g} m on the "
        f"worst of {len(members)} members"
    )
    return Found(question.duration, program.grid, members, best, True, report.count, words)


def _additional_members(question: Question, grid: Grid, best: Optimum) -> tuple[Member, ...]:
    """Return the members between the others that are left with more; none: it is not much more."""
    intermediate = intermediate_members(question.ensemble, question.slew, _PARTS)
    if not intermediate:
        return ()
    nominal = members_of(replace(question.ensemble, vary={}), question.slew)
    problem = ensemble_problem(question, (*nominal, *intermediate), grid)
    residuals = problem.merit(best.weights).residuals
    most = best.worst + RESIDUAL_FLOOR * question.span
    if residuals.max() <= (1.0 + _MORE) * most:
        return ()
    return tuple(m for m, left in zip(intermediate, residuals[1:], strict=True) if left > most)


def _local(question: Question, members: tuple[Member, ...], report: Report) -> Found:
    """Return the best local optimum that was found, with efforts as long as they are of use."""
    members = (*members, *intermediate_members(question.ensemble, question.slew, 2))
    problem = replace(question, duration=question.actuation)
    grid, weights, merit = local_optimum(problem, members, report)
    words = "the best local optimum from 2 starts, not a bound: the plant is not linear"
    optimum = merit.as_optimum(weights)
    found = Found(problem.duration, grid, members, optimum, False, report.count, words)
    return _extend_optimum(question, found, report)


def _extend_optimum(question: Question, found: Found, report: Report) -> Found:
    """Return the optimum of a shorter slew, held at the goal until the end of a longer one."""
    grid = found.grid.extend_until(question.ticks)
    if grid == found.grid:
        return found
    weights = found.optimum.weights
    optimum = ensemble_problem(question, found.members, grid).merit(weights).as_optimum(weights)
    words = f"{found.words}; its efforts end after {found.duration:g} s, then it rests at the goal"
    return Found(question.duration, grid, found.members, optimum, False, report.count, words)
