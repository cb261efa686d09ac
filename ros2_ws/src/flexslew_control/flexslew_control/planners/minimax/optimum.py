"""The optimum of one slew: which program a plant leads to, and what its solution is worth."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from flexslew_control.planners.minimax.linear_path import is_linear, linear_path
from flexslew_control.planners.minimax.members import Ensemble, Member, members_of
from flexslew_control.planners.minimax.program import Limits, Optimum, Program
from flexslew_control.planners.minimax.response import AtRest, Grid, Response, at_rest, grid_of
from flexslew_control.planners.minimax.rounds import Goal, solved
from flexslew_control.planners.minimax.successive import Ensemble as Flown
from flexslew_control.planners.minimax.successive import Local, Merit, improved, merit_of
from flexslew_control.planners.prediction import WATCHED
from flexslew_control.planners.progress import Progress, Update
from flexslew_control.planners.slew import Slew
from flexslew_control.planners.trajectories import rigid_duration
from flexslew_control.planners.whole_bench import NOTHING
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import PlanFailed
from flexslew_plant.testbeds import Model

_PIECES, _FEWER = 60, 40  # of a linear plant, of another one
_PIECE = 0.75  # of the period of the fastest mode, longest of a plant that is not linear [-]
_RIGID = 2.0  # times that a rigid body needs, for which efforts are applied at least
_A_PIECE = 5  # coarse ticks, at least
_ANGLE = 0.4  # of the fastest pole in a coarse tick [rad]
_PRICE = 10.0  # of missing the end or the limits by all of them, beside the way [m/rad or -]
_MET = 5e-4  # share of the end and the limits at which no member joins
_MISSED = 2e-3  # share of the end and the limits that may be missed
_WORSE = 0.02  # than the members that were counted with, for another one to join them [-]
_A_START = 5  # steps, after which a start that is behind the best plan is given up
_BEHIND = 1.3  # times its cost
_MORE = 6  # rounds in which members join
_AT_ONCE = 2  # members that join in a round


@dataclass(frozen=True)
class Question:
    """What is sought.

    Args:
        slew: what the planner is asked for.
        ensemble: what may differ.
        duration: of the slew [s].
        pieces: of each effort, at most; None: as many as suit the plant.
        limits: that every member keeps to.
        exact: whether the nominal member ends at rest, modes included.
        rho: what effort costs [m/N^2 or m/(N m)^2].
        steps: of a plant that is not linear, at most.
    """

    slew: Slew
    ensemble: Ensemble
    duration: float
    pieces: int | None
    limits: Limits
    exact: bool
    rho: float
    steps: int

    @property
    def gains(self) -> Matrix:
        """[Kp Kd], shape (joints, 2 joints)."""
        return np.hstack((np.diag(self.slew.kp), np.diag(self.slew.kd)))

    @cached_property
    def linear(self) -> bool:
        """Whether the model believed in is linear."""
        return is_linear(self.slew.model)

    @cached_property
    def count(self) -> int:
        """How many pieces, at most."""
        return self.pieces or (_PIECES if self.linear else _FEWER)

    @cached_property
    def driven(self) -> float:
        """How long efforts are applied; after it a plant that is not linear only settles [s].

        Pieces that are long beside the period of a mode cannot hold it still.
        """
        model = self.slew.model
        if self.linear or not model.modes:
            return self.duration
        fastest = model.linearise(model.rest(self.slew.named(self.slew.goal))).frequencies[-1]
        slew, drives = self.slew, self.limits.demand
        rigid = rigid_duration(model, slew.start, slew.goal, drives)
        suits = self.count * _PIECE * 2.0 * np.pi / float(fastest)
        return min(self.duration, max(suits, _RIGID * rigid))

    def grid(self, period: float) -> Grid:
        """Return ticks, of a length [s], and pieces."""
        grid = grid_of(self.driven, self.count, self.slew.goal.size, period, WATCHED)
        rest = max(int(np.ceil(self.duration / period - 1e-9)) - grid.ticks, 0)
        return grid._replace(rest=rest, watched=grid.watched + rest)


class Found(NamedTuple):
    """An optimum."""

    duration: float  # [s]
    efforts: Matrix  # of every tick, (ticks, joints) [N m or N]
    members: tuple[Member, ...]
    optimum: Optimum
    convex: bool  # whether its bound is one for all efforts on these pieces
    steps: int
    words: str  # what it is worth


def found_optimum(question: Question, progress: Progress, enough: float | None = None) -> Found:
    """Return the efforts with the least worst residual in a given time.

    Args:
        question: what is sought.
        progress: called with every program that is solved.
        enough: a residual that is good enough; an optimum above it need not be exact [m].

    Raises:
        PlanFailed: no efforts within the limits lead to the goal, or the search does not settle.
        BadInput: the ensemble cannot be made.
    """
    members = members_of(question.ensemble, question.slew)
    if all(is_linear(member.model) for member in members):
        return _convex(question, members, progress, enough)
    return _local(question, members, progress)


def convex_program(question: Question, members: Sequence[Member]) -> Program:
    """Return the program of an ensemble whose members are all linear."""
    slew, grid = question.slew, question.grid(question.slew.period)
    gains, ends = question.gains, (slew.start, slew.goal)
    rests = _rests(question, members, grid)
    paths = (linear_path(m.model, slew.model, ends, gains, grid) for m in members)
    responses = [Response(p, r, grid, slew.goal) for p, r in zip(paths, rests, strict=True)]
    return _program(question, members, grid, responses)


def _convex(
    question: Question, members: tuple[Member, ...], progress: Progress, enough: float | None
) -> Found:
    program = convex_program(question, members)
    report = _Report(progress)
    best = solved(program, report, Goal(enough=enough))
    efforts = program.grid.held(best.weights)
    words = (
        f"no efforts on {program.grid.pieces} pieces leave less than {best.bound:.4g} m on the "
        f"worst of {len(members)} members"
    )
    return Found(question.duration, efforts, members, best, True, report.count, words)


def _rests(question: Question, members: Sequence[Member], grid: Grid) -> list[AtRest]:
    goal, gains = question.slew.goal, question.gains
    return [at_rest(m.model, goal, gains, grid.period, grid.watched) for m in members]


def _program(
    question: Question, members: Sequence[Member], grid: Grid, responses: Sequence[Response]
) -> Program:
    slew = question.slew
    ringing = not question.gains.any() and not any(_damped(m.model, slew) for m in members)
    span = float(np.abs(slew.goal - slew.start).max()) or 1.0
    return Program(responses, grid, question.limits, question.exact, ringing, span, question.rho)


def _damped(model: Model, slew: Slew) -> bool:
    return bool(model.linearise(model.rest(slew.named(slew.goal))).damping.any())


@dataclass
class _Report:
    """Tells a listener of programs as they are solved."""

    progress: Progress
    count: int = 0

    def __call__(self, number: int, weights: Vector, worst: float, bound: float) -> None:
        """Report one more program, its worst residual and the bound [m]."""
        self.count += 1
        gap = (worst - bound) / max(worst, 1e-300)
        size = float(np.linalg.norm(weights))
        self.progress(Update(self.count, worst, worst, size, gap, True))


def _local(question: Question, members: tuple[Member, ...], progress: Progress) -> Found:
    """Return the best of the local optima near several starts.

    It is sought on the outermost members, with those that turn out worse added, and on coarse
    ticks first.
    """
    slew, report = question.slew, _Report(progress)
    stride, used = _stride(question), _outermost(members)
    grid = question.grid(stride * slew.period)
    first, *others = starts(question, grid)
    search = Search(question, members, grid, report)
    best, used = search.joined(first, used)
    for start in others if best.merit.residuals.max() > NOTHING else ():
        local = search.of(used).run(start, _A_START)
        if local.merit.cost < _BEHIND * best.merit.cost:
            other, more = search.joined(local.weights, used)
            if other.merit.cost < best.merit.cost:
                best, used = other, more
    fine = grid._replace(
        edges=tuple(stride * edge for edge in grid.edges),
        period=slew.period,
        watched=stride * grid.watched,
        rest=stride * grid.rest,
    )
    search = Search(question, members, fine, report)
    weights, merit = best.weights, search.merit(best.weights)
    most = (1.0 + _WORSE) * best.merit.residuals.max()
    if merit.residuals.max() > max(most, NOTHING) or merit.missed > _MET:
        weights = search.joined(weights, used)[0].weights
        merit = search.merit(weights)
    if merit.missed > _MISSED:
        raise PlanFailed(
            f"no efforts were found that lead to the goal in {question.duration:g} s within the "
            f"limits: the best ones miss by {100.0 * merit.missed:.3g} % of them"
        )
    optimum = Optimum(weights, merit.residuals, 0.0, merit.missed)
    words = (
        f"the best local optimum from {1 + len(others)} starts, not a bound: the plant is not "
        "linear"
    )
    efforts = fine.held(weights)
    return Found(question.duration, efforts, members, optimum, False, report.count, words)


@dataclass(frozen=True)
class Search:
    """The search of a local optimum on some members and a grid."""

    question: Question
    members: tuple[Member, ...]
    grid: Grid
    report: _Report

    @cached_property
    def ensemble(self) -> Flown:
        """The members as they are flown."""
        q = self.question
        rests = _rests(q, self.members, self.grid)
        ends = q.slew.start, q.slew.goal
        return Flown(self.members, rests, ends, q.gains, self.grid, q.limits)

    @cached_property
    def price(self) -> float:
        """Of what is missed [m]."""
        return _PRICE * float(np.abs(self.question.slew.goal - self.question.slew.start).max())

    def program(self, responses: Sequence[Response]) -> Program:
        """Return what is asked for, about some flights."""
        return _program(self.question, self.members, self.grid, responses)

    def run(self, start: Vector, steps: int) -> Local:
        """Return the local optimum near some weights."""

        def listener(number: int, weights: Vector, merit: Merit, bound: float) -> None:
            self.report(number, weights, float(merit.residuals.max()), bound)

        return improved(self.program, self.ensemble, start, self.price, steps, listener)

    def of(self, used: Sequence[int]) -> "Search":
        """Return the search on some of the members."""
        return replace(self, members=tuple(self.members[i] for i in used))

    def joined(self, start: Vector, used: list[int]) -> tuple[Local, list[int]]:
        """Return the optimum for all members near some weights, and those that decide it.

        It is sought on some members; the worst of the others joins them until none is worse.
        """
        for _ in range(_MORE):
            local = self.of(used).run(start, self.question.steps)
            start = local.weights
            merit = self.merit(start)
            worse = merit.residuals > (1.0 + _WORSE) * local.merit.residuals.max()
            worse &= merit.residuals > NOTHING
            worse |= merit.misses > _MET
            new = [int(i) for i in np.flatnonzero(worse) if i not in used]
            if not new:
                break
            price = merit.residuals + self.price * merit.misses
            used = [*used, *sorted(new, key=lambda i: -float(price[i]))[:_AT_ONCE]]
        return local, used

    def merit(self, weights: Vector) -> Merit:
        """Return what all members come to."""
        return merit_of(
            self.program, self.ensemble, weights, self.ensemble.flown(weights), self.price
        )


def search_of(question: Question) -> Search:
    """Return the search on all members and the ticks of the bench."""
    members = members_of(question.ensemble, question.slew)
    grid = question.grid(question.slew.period)
    return Search(question, members, grid, _Report(lambda update: None))


def _outermost(members: Sequence[Member]) -> list[int]:
    """Return the indices of the nominal member and of those with all errors at their ends."""
    errors = np.array([list(member.errors.values()) for member in members])
    if not errors.size:
        return [0]
    ends = (errors == errors.min(axis=0)) | (errors == errors.max(axis=0))
    return [0, *(int(i) for i in np.flatnonzero(ends.all(axis=1)) if i)]


def _stride(question: Question) -> int:
    """Return how many ticks make a coarse one: a divisor of the slew's ticks."""
    slew = question.slew
    rest = slew.model.rest(slew.named(slew.goal))
    poles = slew.model.linearise(rest).with_feedback(slew.kp, slew.kd).eigenvalues
    most = _ANGLE / float(np.abs(poles).max()) / slew.period
    grid = question.grid(slew.period)
    most = min(most, grid.ticks / grid.pieces / _A_PIECE)
    return max(c for c in range(1, max(int(most), 1) + 1) if grid.ticks % c == 0)


def starts(question: Question, grid: Grid) -> list[Vector]:
    """Return efforts to start from: those of a smooth rigid turn, and none."""
    slew = question.slew
    rest = slew.model.rest(slew.named(0.5 * (slew.start + slew.goal)))
    m = slew.goal.size
    inertia = slew.model.mass_matrix(rest)[:m, :m]
    edges = np.array(grid.edges) / grid.ticks
    middle = 0.5 * (edges[1:] + edges[:-1])
    smooth = (6.0 - 12.0 * middle) / question.driven**2  # of the cubic 3 s^2 - 2 s^3
    rigid = np.outer(smooth, inertia @ (slew.goal - slew.start)).ravel()
    limit = np.tile(question.limits.demand, grid.pieces)
    return [np.clip(rigid, -limit, limit), np.zeros(grid.size)]
