"""The least worst residual of plants that are not linear: successive convex programs.

All members are flown with the present efforts; the convex program about these flights gives the
step inside a trust region; it is taken if the true merit falls, and the region grows or shrinks by
how well the program predicted the gain (Nocedal and Wright, chapters 4 and 18). The merit is the
worst residual plus a price on what misses the end or the limits. What is found is a local optimum:
the bound of the last program holds near it and nowhere else.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from flexslew_control.analysis.lti import Lti
from flexslew_control.planners.minimax.members import Member
from flexslew_control.planners.minimax.nonlinear_path import (
    AffinePath,
    PathProblem,
    affine_path,
    channels,
    deviation,
)
from flexslew_control.planners.minimax.program import (
    ConeProgram,
    Infeasible,
    Optimum,
    ProgramKey,
    TrustRegion,
    residual,
)
from flexslew_control.planners.minimax.question import Question, program_of, rest_models_of
from flexslew_control.planners.minimax.response import AtRest, Grid, Response
from flexslew_control.planners.minimax.rounds import Goal, Listener, solved
from flexslew_control.planners.residual.closed_loop import ClosedLoopResponse
from flexslew_control.planners.residual.whole_bench import TIP_FLOOR
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds import Model

_GOAL = Goal(close=0.02, iterations=3)  # of every program
_PRICE = 10.0  # of missing the end or the limits by all of them, per way [m/rad or -]
FIRST_RADIUS = 0.3  # of the limits
_SMALLEST_RADIUS = 1e-4
_GOOD, _LOW_RATIO = 0.7, 0.2  # shares of the predicted gain between which the region stays
_TARGET_LOSS = 0.4  # share of the predicted gain that a smaller region may lose
_FORGOTTEN = 1.4  # times, by which a region that was too large counts as larger with every step
_CONVERGED = 5e-3  # relative gain at which it ends
_PRICE_FACTOR = 5.0  # times, of the price of missing
_FEASIBLE = 1e-4  # share of end and limits that may be missed


class Merit(NamedTuple):
    """What a flight of all members comes to."""

    residuals: Vector  # of the members, (members,) [m]
    violations: Vector  # largest share of the end or a limit that each misses, (members,) [-]
    cost: float  # with rho and the price [m]

    @property
    def max_violation(self) -> float:
        """The largest share that is missed [-]."""
        return float(self.violations.max())

    def as_optimum(self, weights: Vector) -> Optimum:
        """Return the weights that come to this as an optimum without a bound."""
        return Optimum(weights, self.residuals, 0.0, self.max_violation)


class Local(NamedTuple):
    """A local optimum."""

    weights: Vector
    merit: Merit
    settled: bool
    radius: float  # of the last step's region, of the limits [-]


@dataclass(frozen=True)
class EnsembleProblem:
    """The members of a slew, as they are flown.

    Args:
        question: what is sought.
        members: the nominal one first.
        grid: ticks and pieces.
        rests: motion about the goal, one per member.
    """

    question: Question
    members: Sequence[Member]
    grid: Grid
    rests: Sequence[AtRest]

    @cached_property
    def motors(self) -> Lti:
        """From commands to efforts, tick by tick."""
        return self.question.slew.motors(self.grid.period)

    @property
    def price(self) -> float:
        """Of missing the end or the limits [m]."""
        return _PRICE * self.question.span

    def of(self, used: Sequence[int]) -> "EnsembleProblem":
        """Return the problem of some of the members."""
        members, rests = [self.members[i] for i in used], [self.rests[i] for i in used]
        return replace(self, members=members, rests=rests)

    def program(self, responses: Sequence[Response]) -> ConeProgram:
        """Return the program about some flights."""
        return program_of(self.question, self.members, self.grid, responses)

    def simulate(self, weights: Vector) -> list[ClosedLoopResponse]:
        """Return the flights of all members."""
        efforts, trajectories = self.grid.tick_efforts(weights), list[ClosedLoopResponse]()
        motion, gains = self.question.motion, self.question.gains
        for i, member in enumerate(self.members):
            path = trajectories[0].states if i else None
            trajectories.append(motion.flight(member.model, efforts, gains, path, self.motors))
        return trajectories

    def responses(
        self, weights: Vector, trajectories: Sequence[ClosedLoopResponse]
    ) -> list[Response]:
        """Return the answers of all members about their flights."""
        q = self.question
        low, high, _ = q.limits.of(len(self.rests[0].tip_of_modes))
        limited = np.flatnonzero(np.isfinite(low) | np.isfinite(high)).tolist()
        problem = PathProblem(q.motion, q.gains, self.motors, self.grid, limited)
        nominal = affine_path(problem, self.members[0].model, trajectories[0], None, weights)
        paths = [nominal.path]  # the other members' derivatives of all states are not kept
        for member, trajectory in zip(self.members[1:], trajectories[1:], strict=True):
            paths.append(affine_path(problem, member.model, trajectory, nominal, weights).path)
        return [self._response(*one) for one in zip(paths, self.rests, strict=True)]

    def fixed(self, weights: Vector, trajectories: Sequence[ClosedLoopResponse]) -> list[Response]:
        """Return what was flown as responses without derivatives."""
        found = []
        for member, rest, trajectory in zip(self.members, self.rests, trajectories, strict=True):
            values, end = self._read(member.model, trajectory)
            last = np.zeros((end.size, weights.size)), end
            found.append(self._response(AffinePath(self.grid, weights, values, {}, last), rest))
        return found

    def update_values(
        self, program: ConeProgram, weights: Vector, trajectories: Sequence[ClosedLoopResponse]
    ) -> list[Response]:
        """Return responses with the derivatives of a program and the values of other flights."""
        found = []
        for old, member, trajectory in zip(
            program.responses, self.members, trajectories, strict=True
        ):
            assert isinstance(old.path, AffinePath)
            slope = old.path.end[0]
            values, end = self._read(member.model, trajectory)
            path = replace(
                old.path, about=weights, values=values, end=(slope, end - slope @ weights)
            )
            found.append(replace(old, path=path))
        return found

    def merit(
        self,
        weights: Vector,
        trajectories: Sequence[ClosedLoopResponse] | None = None,
        price: float | None = None,
    ) -> Merit:
        """Return what all members come to.

        Args:
            weights: weights that are flown.
            trajectories: flights of the members with them; None: to be simulated.
            price: price of missing the end or the limits [m]; None: the first one.
        """
        responses = self.fixed(weights, trajectories or self.simulate(weights))
        problem = self.program(responses)
        residuals, violations = np.empty(len(responses)), np.zeros(len(responses))
        for i, response in enumerate(responses):
            signals, end = response.simulate(weights), response.path.end[1]
            residuals[i] = residual(response, end, problem.no_damping, signals)
            low, high, size = problem.limits.of(response.tips)
            missed = [(low - signals.min(axis=0)) / size, (signals.max(axis=0) - high) / size]
            if i == 0:
                missed.append(np.abs(problem.end_error(end)))
            violations[i] = max(0.0, *(float(part.max(initial=0.0)) for part in missed))
        cost = residuals.max() + problem.rho * float(weights @ weights)
        cost += (self.price if price is None else price) * violations.max()
        return Merit(residuals, violations, float(cost) if np.isfinite(cost) else np.inf)

    def _response(self, path: AffinePath, rest: AtRest) -> Response:
        return Response(path, rest, self.grid, self.question.slew.goal)

    def _read(self, model: Model, trajectory: ClosedLoopResponse) -> tuple[Matrix, Vector]:
        """Return a flight's channels and its deviation at the last tick."""
        motion = self.question.motion
        return channels(motion, model, trajectory), deviation(motion, model, trajectory)


def ensemble_problem(question: Question, members: Sequence[Member], grid: Grid) -> EnsembleProblem:
    """Return the problem of some members on a grid."""
    return EnsembleProblem(question, members, grid, rest_models_of(question, members, grid))


def improved(
    ensemble: EnsembleProblem,
    start: Vector,
    steps: int,
    radius: float = FIRST_RADIUS,
    listener: Listener = lambda *_: None,
) -> Local:
    """Return the local optimum near some efforts.

    Args:
        ensemble: the members.
        start: first weights.
        steps: most steps.
        radius: size of the first step, as a share of the limits [-].
        listener: called with every step that is taken.
    """
    weights, known, failed, price = start, tuple[ProgramKey, ...](), np.inf, ensemble.price
    unit = np.tile(ensemble.question.limits.demand, ensemble.grid.pieces)
    trajectories = ensemble.simulate(weights)
    problem = ensemble.program(ensemble.responses(weights, trajectories))
    merit = ensemble.merit(weights, trajectories)
    for _ in range(steps):
        trust = TrustRegion(weights, radius, price)
        try:
            found = solved(replace(problem, trust=trust), goal=_GOAL, known=known)
        except Infeasible:  # the changes of the start are too large
            return Local(weights, merit, False, radius)
        known = found.rows
        predicted_cost = found.worst + price * found.missed
        predicted_cost += problem.rho * float(found.weights @ found.weights)
        trajectories = ensemble.simulate(found.weights)
        new = ensemble.merit(found.weights, trajectories, price)
        predicted_decrease = merit.cost - predicted_cost
        step = found.weights
        if predicted_decrease > 0.0 and merit.cost - new.cost < _GOOD * predicted_decrease:
            # the same derivatives about what was flown: a correction of second order
            updated = ensemble.update_values(problem, found.weights, trajectories)
            correction = replace(problem, responses=updated, trust=trust)
            second = solved(correction, goal=_GOAL, known=known)
            del updated, correction
            others = ensemble.simulate(second.weights)
            other = ensemble.merit(second.weights, others, price)
            if other.cost < new.cost:
                step, trajectories, new = second.weights, others, other
        gain = merit.cost - new.cost
        share = gain / predicted_decrease if predicted_decrease > 0.0 else 0.0
        size = float(np.abs((step - weights) / unit).max())
        small_gain = (
            min(predicted_decrease, gain if gain > 0.0 else predicted_decrease)
            <= _CONVERGED * merit.cost
        )
        if gain > 0.0:
            weights, merit = step, new
        none = ensemble.question.feasible or merit.residuals.max() < TIP_FLOOR
        converged = (small_gain or none) and merit.max_violation <= _FEASIBLE
        if small_gain and not converged:  # missing is too cheap
            price *= _PRICE_FACTOR
            merit = merit._replace(
                cost=merit.cost + (1.0 - 1.0 / _PRICE_FACTOR) * price * merit.max_violation
            )
        if gain > 0.0:
            listener(weights, float(merit.residuals.max()), found.bound)
            if not converged:
                del problem  # never the derivatives of two flights at once
                problem = ensemble.program(ensemble.responses(weights, trajectories))
        if converged:
            return Local(weights, merit, True, radius)
        if share < _LOW_RATIO:  # the error of the program grows with the square of the step
            failed = min(radius, size)
            radius = failed * float(np.clip(np.sqrt(_TARGET_LOSS / (1.0 - share)), 0.2, 0.5))
        elif share > _GOOD and size > 0.9 * radius:
            radius = max(radius, min(2.0 * radius, 0.7 * failed, 2.0))
            failed *= _FORGOTTEN
        if radius < _SMALLEST_RADIUS:
            break
    return Local(weights, merit, False, radius)
