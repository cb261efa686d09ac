"""The least worst residual over an ensemble: a second-order cone program with rows on demand.

    minimise    g + rho |p|^2
    subject to  A p = b                                  the nominal member's end
                |demand_i(k)| <= limit, tips and joints within theirs    every member, every tick
                |tip_i(k)| <= g                          every member, every tick after the end

The rows of ticks are too many and nearly all slack: the program is solved with few, flown on all
members at all ticks, and solved again with those that were violated most, until none is. Each
program has fewer rows than the whole one, so its dual objective is a lower bound of the optimum.
Where nothing damps the vibration, the amplitudes of the modes stand for the tips (Boyd and
Vandenberghe, chapter 4): sum_r |phi_r| |(eta_r, eta_r'/w_r)| <= g.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from flexslew_control.planners.minimax.cones import Cones
from flexslew_control.planners.minimax.program import (
    ConeProgram,
    Optimum,
    ProgramKey,
    TrustRegion,
    residual,
)
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import PlanFailed

_CLOSE = 1e-3  # relative distance of residual and bound at which the program is solved
_ROUNDING = 1e-6  # of a limit [-]
_ACCURACY = 1e-4  # of each round's solution, relative to that of the last [-]
_HIGH = 0.7  # of the worst residual, at which a peak may come to hold a step up [-]
_NEAR = 0.4  # of a limit, off which a peak may come to reach it [-]
RESIDUAL_FLOOR = 1e-8  # of the way, by which residual and bound may always differ [m/rad]
_ROUNDING_GAP, _LATE = 1e-6, 10  # what they may differ by from this round on: what rounding leaves
_ITERATIONS = 40
_A_ROUND = 12  # rows that a member's channel gains in each round
_A_STEP = 4  # the same of a step, which is flown and judged anyway: few rows are quick
_FIRST_ROWS = 5  # of each member's tips, after the end
_FIRST_OF_A_STEP = 1  # the rounds find the others

Listener = Callable[[Vector, float, float], None]  # of weights, worst residual and bound [m]


class Goal(NamedTuple):
    """When a program counts as solved."""

    close: float = _CLOSE  # relative distance of cost and bound
    target: float | None = None  # a residual that is good enough, or out of reach [m]
    iterations: int | None = None  # after which the last solution does, even beyond the limits
    feasible: bool = False  # whether any efforts do that keep to the limits


SOLVED = Goal()


def solved(
    program: ConeProgram,
    listener: Listener = lambda *_: None,
    goal: Goal = SOLVED,
    known: Sequence[ProgramKey] = (),
) -> Optimum:
    """Return the efforts with the least worst residual.

    Args:
        program: the program.
        listener: called with every round.
        goal: when it counts as solved.
        known: rows that were active in a similar program.

    Raises:
        Infeasible: if no efforts within the limits lead to the goal in this time.
        PlanFailed: if the program was not solved.
    """
    cones = Cones(program, goal.feasible, _ACCURACY * goal.close)
    if cones.ticks_count:
        _first_rows(cones, _FIRST_ROWS if program.trust is None else _FIRST_OF_A_STEP)
    for key in known:
        if key.side:
            cones.add(key.member, key.channel, [key.tick], key.side)
        elif cones.ticks_count:
            cones.add_residual(key.member, key.channel, [key.tick])
    if program.trust is not None:
        _near_rows(cones, program.trust)
    best: Optimum | None = None
    for k in range(goal.iterations or _ITERATIONS):
        kept, found = _round(cones)
        listener(found.weights, found.worst, found.bound)
        if kept and goal.feasible:
            return found
        if kept and (best is None or cones.cost(found) < cones.cost(best)):
            best = found
        if best is not None:
            best = best._replace(bound=max(best.bound, found.bound))
        if _done(cones, goal, best, found, _ROUNDING_GAP if k >= _LATE else RESIDUAL_FLOOR):
            return best or found
        cones.scale = max(found.worst, cones.least) if np.isfinite(found.worst) else cones.scale
    if best is None and goal.iterations is None:
        raise PlanFailed(f"the limits were not kept after {_ITERATIONS} rounds")
    return best or found


def _first_rows(cones: Cones, count: int) -> None:
    """Add some ticks after the end of every tip, denser at first."""
    grid = cones.program.grid
    last = grid.monitored - grid.rest
    spread = np.unique(np.geomspace(1, last, count).astype(int)) - 1
    for i, response in enumerate(cones.program.responses):
        for tip in range(response.tips):
            cones.add_residual(i, tip, grid.over + spread)


def _near_rows(cones: Cones, trust: TrustRegion) -> None:
    """Add the peaks that are high, or near a limit, in the flights that a step starts from."""
    program = cones.program
    all_signals = [response.simulate(trust.about) for response in program.responses]
    ticks, tips = program.grid.over, program.responses[0].tips
    largest = max(np.abs(signals[ticks:, :tips]).max(initial=0.0) for signals in all_signals)
    low, high, size = program.limits.of(tips)
    for i, signals in enumerate(all_signals):
        for side, limit in ((-1.0, low), (1.0, high)):
            for channel in np.flatnonzero(np.isfinite(limit)):
                excess = side * (signals[:, channel] - limit[channel]) + _NEAR * size[channel]
                cones.add(i, int(channel), _peaks(excess, _A_STEP), side)
        if cones.ticks_count:
            for tip in range(tips):
                for side in (1.0, -1.0):
                    excess = side * signals[ticks:, tip] - _HIGH * largest
                    cones.add_residual(i, tip, ticks + _peaks(excess, _A_STEP), (side,))


def _round(cones: Cones) -> tuple[bool, Optimum]:
    """Return whether all limits were kept, and the solution; add the rows that it violates."""
    program, ticks = cones.program, cones.program.grid.over
    weights, bound, violation = cones.solve()
    most = _A_ROUND if program.trust is None else _A_STEP
    kept, residuals = True, np.empty(len(program.responses))
    for i, response in enumerate(program.responses):
        signals = response.simulate(weights)
        slope, offset = response.path.end
        residuals[i] = residual(response, slope @ weights + offset, program.no_damping, signals)
        kept &= _keep(cones, i, signals, violation, most)
        if cones.ticks_count:
            level = (1.0 + 0.5 * _CLOSE) * max(bound - cones.price * violation, 0.0)
            for tip in range(response.tips):
                if (new := _peaks(np.abs(signals[ticks:, tip]) - level, most)).size:
                    cones.add_residual(i, tip, ticks + new)
    return kept, Optimum(weights, residuals, bound, violation, cones.held)


def _done(cones: Cones, goal: Goal, best: Optimum | None, found: Optimum, floor: float) -> bool:
    """Return whether the best solution that keeps to the limits is good enough, or none can be."""
    if goal.target is not None and found.bound > goal.target:
        return True
    if best is None:
        return False
    if goal.target is not None and best.worst <= goal.target:
        return True
    return cones.cost(best) <= (1.0 + goal.close) * found.bound + floor * cones.program.span


def _peaks(excess: Vector, most: int) -> Vector:
    """Return the ticks of the largest local peaks of what is above zero, so many at most."""
    padded = np.concatenate(([-np.inf], excess, [-np.inf]))
    peaks = np.flatnonzero((excess > padded[:-2]) & (excess > padded[2:]))
    if not peaks.size:  # flat
        peaks = np.array([int(np.argmax(excess))])
    peaks = peaks[excess[peaks] > 0.0]
    return np.asarray(peaks[np.argsort(-excess[peaks])][:most])


def _keep(cones: Cones, member: int, signals: Matrix, violation: float, most: int) -> bool:
    """Return whether a member keeps to the limits, but for a share that is missed.

    Else the rows of the worst ticks are added, so many of a channel at most.
    """
    kept = True
    low, high, size = cones.program.limits.of(cones.program.responses[member].tips)
    for side, limit in ((-1.0, low), (1.0, high)):
        for channel in np.flatnonzero(np.isfinite(limit)):
            excess = side * (signals[:, channel] - limit[channel])
            excess -= (violation + _ROUNDING) * size[channel]
            if excess.max() > 0.0:
                kept = False
                cones.add(member, int(channel), _peaks(excess, most), side)
    return kept
