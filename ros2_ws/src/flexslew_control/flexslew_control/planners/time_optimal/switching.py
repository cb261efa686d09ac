"""Bang-bang slews of one joint by their switch times (Liu and Singh 1997, sections 2 and 3).

Newton's method solves the end conditions (see bang_bang) from the closed form of the linear model.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flexslew_control.planners.time_optimal.bang_bang import BangBang
from flexslew_control.planners.time_optimal.linear.linear_multistart import linear_slews
from flexslew_control.planners.time_optimal.linear.linear_switching import (
    five_switches,
    three_switches,
)
from flexslew_plant.arrays import Matrix, Vector

_LINEAR = 1e-8  # residual of a linear slew at which the model counts as linear
_MAX_RATIO = 3.0  # of Newton's iterates, times the guess
_MAX_CANDIDATES = 24  # candidates at most
_FAST = 0.2  # residual after a step, over that before, from which the slopes are still good
_MARGIN = 3.0  # see continued_durations


def linear_candidates(slew: BangBang, antisymmetric: bool, excess: float = 0.0) -> list[Vector]:
    """Return the arcs of linear one-mode slews, shortest first, each shape (4,) or, robust, (6,).

    Args:
        slew: the slew; its model is linearised at the start.
        antisymmetric: whether only slews with an effort antisymmetric about the middle count, as
            in Liu and Singh 1997; a damped mode has none, so there it changes nothing.
        excess: by how much they may be longer than the shortest [s].

    Raises:
        PlanFailed: if there are no such arcs within the range searched.
    """
    frequency, damping = slew.mode
    a = slew.inertia * abs(slew.distance) / slew.amplitude * frequency**2  # in phase angles
    if damping > 0.0 or not antisymmetric:
        found = linear_slews(a, damping, 5 if slew.robust else 3, excess * frequency)
        return list(found / frequency)
    if slew.robust:
        halves = [np.array([t - t2, t2 - t1, t1]) for t, t1, t2 in five_switches(a)]
    else:
        t, t1 = three_switches(a)
        halves = [np.array([t - t1, t1])]
    last = halves[0].sum() + 0.5 * excess * frequency
    return [np.concatenate((half, half[::-1])) / frequency for half in halves if half.sum() <= last]


def linear_durations(slew: BangBang) -> Vector:
    """Return the arcs of the shortest linear one-mode slew, shape (4,) or, robust, (6,).

    Undamped, with switches at T, T +- t1 (and T +- t2), T the half of t_f, w the frequency and J
    the inertia:
        three:  T^2/2 - t1^2 = J x/(2 u),  2 cos(w t1) = 1 + cos(w T);
        five:   T^2/2 - t2^2 + t1^2 = J x/(2 u),  1 - 2 cos(w t1) + 2 cos(w t2) = cos(w T), and
                the derivative of the latter by w.

    Raises:
        PlanFailed: no such arcs within the range searched.
    """
    return linear_candidates(slew, True)[0]


def solve_durations(slew: BangBang, guess: Vector, slopes: Matrix | None = None) -> Vector | None:
    """Return the durations that meet the end conditions, by Newton's method; None if it fails.

    Args:
        slew: what is turned.
        guess: durations to start from.
        slopes: dr/dd to use everywhere; None: exact ones, kept up while they serve.
    """
    d: Vector = guess.copy()
    last: _Step | None = None
    for _ in range(10):
        if slopes is None:
            r, j = _residual_jacobian(slew, d, last)
        else:
            r, j = slew.residual(d), slopes
        if not (np.isfinite(r).all() and np.isfinite(j).all()) or np.linalg.cond(j) > 1e13:
            return None
        change = -np.linalg.solve(j, r)
        negative = change < 0.0
        ratio = float(np.min(-d[negative] / change[negative])) if negative.any() else np.inf
        last = _Step(r, j, np.asarray(min(1.0, 0.8 * ratio) * change, dtype=float))
        d = d + last.change
        if d.sum() > _MAX_RATIO * guess.sum():
            return None
        if ratio > 1.0 and np.abs(change).max() < 1e-9:
            return d
    return None


class _Step(NamedTuple):
    """Where a step of Newton's method began, and how far it went."""

    residual: Vector
    slopes: Matrix
    change: Vector


def _residual_jacobian(slew: BangBang, d: Vector, last: _Step | None) -> tuple[Vector, Matrix]:
    """Return the residual and dr/dd: by Broyden's rule after a step that was good, else exact."""
    if last is not None:
        r = slew.residual(d)
        if np.abs(r).max() < _FAST * np.abs(last.residual).max():
            mismatch = r - last.residual - last.slopes @ last.change
            rank_one = np.outer(mismatch, last.change) / (last.change @ last.change)
            return r, np.asarray(last.slopes + rank_one)
    return slew.residual_jacobian(d)


def continued_durations(slew: BangBang, antisymmetric: bool = True) -> Vector | None:
    """Return the arcs of the shortest slew that a linear one leads to; None if there is none.

    On a non-linear model the linear slews are followed from the shortest on, until the next ones
    are longer than the best so far by more than the non-linearity has changed any, with a margin.

    Args:
        slew: what is turned.
        antisymmetric: as in linear_candidates.

    Raises:
        PlanFailed: the linear model has none.
    """
    guess = linear_candidates(slew, antisymmetric)[0]
    if _ends_at_goal(slew, guess):
        return solve_durations(slew, guess)
    candidates = linear_candidates(slew, antisymmetric, 2.0 * np.pi / slew.mode[0])
    coarse = replace(slew, coarse=True)
    best, shift = None, 0.0
    for start in candidates[:_MAX_CANDIDATES]:
        if best is not None and start.sum() - _MARGIN * shift > best.sum():
            break
        found = solve_durations(coarse, start)
        if found is not None:
            shift = max(shift, abs(float(found.sum() - start.sum())))
            best = found if best is None or found.sum() < best.sum() else best
    if best is None:
        return None
    return solve_durations(slew, best, coarse.residual_jacobian(best)[1])


def linear(slew: BangBang) -> bool:
    """Return whether the linear model's slew is that of the model."""
    return _ends_at_goal(slew, linear_candidates(slew, True)[0])


def _ends_at_goal(slew: BangBang, durations: Vector) -> bool:
    return bool(np.abs(slew.residual(durations)).max() < _LINEAR)
