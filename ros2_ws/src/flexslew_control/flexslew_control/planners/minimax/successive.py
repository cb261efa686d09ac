"""The least worst residual of plants that are not linear: successive convex programs.

All members are flown with the present efforts; the convex program about these flights gives the
step inside a trust region; it is taken if the true merit falls, and the region grows or shrinks by
how well the program predicted the gain (Nocedal and Wright, chapters 4 and 18). The merit is the
worst residual plus a price on what misses the end or the limits. What is found is a local optimum:
the bound of the last program holds near it and nowhere else.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from flexslew_control.analysis.lti import Lti
from flexslew_control.planners.minimax.members import Member
from flexslew_control.planners.minimax.motion import MemberMotion
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
    Limits,
    ProgramKey,
    TrustRegion,
    residual,
)
from flexslew_control.planners.minimax.response import AtRest, Grid, Indices, Response
from flexslew_control.planners.minimax.rounds import Goal, solved
from flexslew_control.planners.residual.closed_loop import ClosedLoopResponse
from flexslew_control.planners.residual.whole_bench import TIP_FLOOR
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds import Model

_GOAL = Goal(close=0.02, iterations=3)  # of every program
FIRST_RADIUS = 0.3  # of the limits
_SMALLEST_RADIUS = 1e-4
_GOOD, _LOW_RATIO = (
    0.7,
    0.2,
)  # shares of the predicted gain, above and below which the region changes
_TARGET_LOSS = 0.4  # share of the predicted gain that a smaller region may lose
_FORGOTTEN = 1.4  # times, by which a region that was too large counts as larger with every step
_CONVERGED = 5e-3  # relative gain at which it ends
_PRICE_FACTOR = 5.0  # times, of the price of missing
_FEASIBLE = 1e-4  # share of end and limits that may be missed


@dataclass(frozen=True)
class EnsembleProblem:
    """The members of a slew, as they are flown.

    Args:
        members: the nominal one first.
        rests: about the goal, one per member.
        motion: how they move.
        goal: joint positions, shape (joints,).
        gains: [Kp Kd], shape (joints, 2 joints).
        motors: from commands to efforts, tick by tick.
        grid: ticks and pieces.
        limits: that every member keeps to.
    """

    members: Sequence[Member]
    rests: Sequence[AtRest]
    motion: MemberMotion
    goal: Vector
    gains: Matrix
    motors: Lti
    grid: Grid
    limits: Limits

    @property
    def limited(self) -> list[int]:
        """The channels that have limits."""
        tips = len(self.rests[0].tip_of_modes)
        low, high, _ = self.limits.of(tips)
        return [int(c) for c in np.flatnonzero(np.isfinite(low) | np.isfinite(high))]

    def simulate(self, weights: Vector) -> list[ClosedLoopResponse]:
        """Return the flights of all members."""
        efforts, trajectories = self.grid.tick_efforts(weights), list[ClosedLoopResponse]()
        for i, member in enumerate(self.members):
            path = trajectories[0].states if i else None
            trajectories.append(
                self.motion.flight(member.model, efforts, self.gains, path, self.motors)
            )
        return trajectories

    def responses(
        self, weights: Vector, trajectories: Sequence[ClosedLoopResponse]
    ) -> list[Response]:
        """Return the answers of all members about their flights."""
        problem = PathProblem(self.motion, self.gains, self.motors, self.grid, self.limited)
        nominal = affine_path(problem, self.members[0].model, trajectories[0], None, weights)
        paths = [nominal.path]  # the other members' derivatives of all states are not kept
        for member, trajectory in zip(self.members[1:], trajectories[1:], strict=True):
            paths.append(affine_path(problem, member.model, trajectory, nominal, weights).path)
        return [
            Response(path, rest, self.grid, self.goal)
            for path, rest in zip(paths, self.rests, strict=True)
        ]

    def fixed(self, weights: Vector, trajectories: Sequence[ClosedLoopResponse]) -> list[Response]:
        """Return what was flown as responses that know no other weights."""
        found = []
        for member, rest, trajectory in zip(self.members, self.rests, trajectories, strict=True):
            values, end = self._read(member.model, trajectory)
            found.append(
                Response(SimulatedPath(values, weights.size, end), rest, self.grid, self.goal)
            )
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

    def _read(self, model: Model, trajectory: ClosedLoopResponse) -> tuple[Matrix, Vector]:
        """Return a flight's channels and its deviation at the last tick."""
        return channels(self.motion, model, trajectory), deviation(self.motion, model, trajectory)


class SimulatedPath(NamedTuple):
    """What a member did with one choice of weights; see response.ResponsePath."""

    values: Matrix  # (ticks, channels)
    size: int  # of the weights
    deviation: Vector  # from the rest at the goal, (2 n + s,)

    def simulate(self, weights: Vector) -> Matrix:
        """Return the channels at every tick but the last, (ticks, channels)."""
        return self.values

    def rows(self, ticks: Indices, channel: int) -> tuple[Matrix, Vector]:
        """Return no derivatives and the values of a channel at some ticks."""
        values: Vector = self.values[ticks, channel]
        return np.zeros((values.size, self.size)), values

    @property
    def end(self) -> tuple[Matrix, Vector]:
        """No derivatives and the deviation at the last tick."""
        return np.zeros((self.deviation.size, self.size)), self.deviation


class Merit(NamedTuple):
    """What a flight of all members comes to."""

    residuals: Vector  # of the members, (members,) [m]
    violations: Vector  # largest share of the end or a limit that each misses, (members,) [-]
    cost: float  # with rho and the price [m]

    @property
    def max_violation(self) -> float:
        """The largest share that is missed [-]."""
        return float(self.violations.max())


class Local(NamedTuple):
    """A local optimum."""

    weights: Vector
    merit: Merit
    steps: int
    settled: bool
    radius: float  # of the last step's region, of the limits [-]


def merit_of(
    program: Callable[[Sequence[Response]], ConeProgram],
    ensemble: EnsembleProblem,
    weights: Vector,
    trajectories: Sequence[ClosedLoopResponse],
    price: float,
) -> Merit:
    """Return the merit of the flights of all members.

    Args:
        program: returns the program of the members' responses.
        ensemble: the members.
        weights: weights that were flown.
        trajectories: flights of the members.
        price: price of missing the end or the limits [m].
    """
    residuals, violations = np.empty(len(trajectories)), np.zeros(len(trajectories))
    responses = ensemble.fixed(weights, trajectories)
    problem = program(responses)
    for i, response in enumerate(responses):
        signals, end = response.simulate(weights), response.path.end[1]
        residuals[i] = residual(response, end, problem.no_damping, signals)
        low, high, size = problem.limits.of(response.tips)
        for excess in (low - signals.min(axis=0), signals.max(axis=0) - high):
            violations[i] = max(violations[i], float((excess / size).max(initial=0.0)))
        if i == 0:
            violations[i] = max(
                violations[i], float(np.abs(problem.end_error(end)).max(initial=0.0))
            )
    cost = residuals.max() + problem.rho * float(weights @ weights) + price * violations.max()
    return Merit(residuals, violations, float(cost) if np.isfinite(cost) else np.inf)


def improved(
    program: Callable[[Sequence[Response]], ConeProgram],
    ensemble: EnsembleProblem,
    start: Vector,
    price: float,
    steps: int,
    radius: float = FIRST_RADIUS,
    listener: Callable[[int, Vector, Merit, float], None] = lambda *_: None,
    feasible: bool = False,
) -> Local:
    """Return the local optimum near some efforts.

    Args:
        program: returns the program of the members' responses.
        ensemble: the members.
        start: first weights.
        price: price of missing the end or the limits [m].
        steps: most steps.
        radius: size of the first step, as a share of the limits [-].
        listener: called with number, weights, merit and the bound of the program [m].
        feasible: whether any efforts do that keep to the limits.
    """
    weights, known, failed = start, tuple[ProgramKey, ...](), np.inf
    unit = np.tile(ensemble.limits.demand, ensemble.grid.pieces)
    trajectories = ensemble.simulate(weights)
    problem = program(ensemble.responses(weights, trajectories))
    merit = merit_of(program, ensemble, weights, trajectories, price)
    for k in range(steps):
        trust = TrustRegion(weights, radius, price)
        try:
            found = solved(replace(problem, trust=trust), goal=_GOAL, known=known)
        except Infeasible:  # the changes of the start are too large
            return Local(weights, merit, k, False, radius)
        known = found.rows
        predicted_cost = found.worst + price * found.missed
        predicted_cost += problem.rho * float(found.weights @ found.weights)
        trajectories = ensemble.simulate(found.weights)
        new = merit_of(program, ensemble, found.weights, trajectories, price)
        predicted_decrease = merit.cost - predicted_cost
        step = found.weights
        if predicted_decrease > 0.0 and merit.cost - new.cost < _GOOD * predicted_decrease:
            # the same derivatives about what was flown: a correction of second order
            updated = ensemble.update_values(problem, found.weights, trajectories)
            correction = replace(problem, responses=updated, trust=trust)
            second = solved(correction, goal=_GOAL, known=known)
            del updated, correction
            others = ensemble.simulate(second.weights)
            other = merit_of(program, ensemble, second.weights, others, price)
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
        none = feasible or merit.residuals.max() < TIP_FLOOR
        converged = (small_gain or none) and merit.max_violation <= _FEASIBLE
        if small_gain and not converged:  # missing is too cheap
            price *= _PRICE_FACTOR
            merit = merit._replace(
                cost=merit.cost + (1.0 - 1.0 / _PRICE_FACTOR) * price * merit.max_violation
            )
        if gain > 0.0:
            listener(k + 1, weights, merit, found.bound)
            if not converged:
                del problem  # never the derivatives of two flights at once
                problem = program(ensemble.responses(weights, trajectories))
        if converged:
            return Local(weights, merit, k + 1, True, radius)
        if share < _LOW_RATIO:  # the error of the program grows with the square of the step
            failed = min(radius, size)
            radius = failed * float(np.clip(np.sqrt(_TARGET_LOSS / (1.0 - share)), 0.2, 0.5))
        elif share > _GOOD and size > 0.9 * radius:
            radius = max(radius, min(2.0 * radius, 0.7 * failed, 2.0))
            failed *= _FORGOTTEN
        if radius < _SMALLEST_RADIUS:
            break
    return Local(weights, merit, steps, False, radius)
