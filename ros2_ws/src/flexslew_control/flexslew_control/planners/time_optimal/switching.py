"""Bang-bang slews of one joint by their switch times (Liu and Singh 1997, sections 2 and 3).

Newton's method solves the end conditions (see bang_bang) from the closed form of the linear model.
Where that start is too far away, goal and effort are both scaled up from nearly zero, where the
closed form is exact.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from flexslew_control.planners.time_optimal.arcs import final_sensitivity
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
# Newton's last change, times half of the rigid slew: of what is kept, of what is only compared
_EXACT, _NEAR = 1e-12, 1e-3


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


def solve_durations(
    slew: BangBang, guess: Vector, scale: float = 1.0, slopes: Matrix | None = None
) -> Vector | None:
    """Return the durations that meet the end conditions, by Newton's method; None if it fails.

    Args:
        slew: what is turned.
        guess: durations to start from.
        scale: of goal and effort.
        slopes: dr/dd to use everywhere; None: exact ones, kept up while they serve.
    """
    d: Vector = guess.copy()
    last: _Step | None = None
    for _ in range(10):
        if slopes is None:
            r, j = _residual_jacobian(slew, d, scale, last)
        else:
            r, j = slew.residual(d, scale), slopes
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


def _residual_jacobian(
    slew: BangBang, d: Vector, scale: float, last: _Step | None
) -> tuple[Vector, Matrix]:
    """Return the residual and dr/dd: by Broyden's rule after a step that was good, else exact."""
    if last is not None:
        r = slew.residual(d, scale)
        if np.abs(r).max() < _FAST * np.abs(last.residual).max():
            mismatch = r - last.residual - last.slopes @ last.change
            rank_one = np.outer(mismatch, last.change) / (last.change @ last.change)
            return r, np.asarray(last.slopes + rank_one)
    return slew.residual_jacobian(d, scale)


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
    best = _minimum_duration(coarse, candidates[:_MAX_CANDIDATES], solve_durations)
    if best is None:
        best = _minimum_duration(coarse, candidates[:1], _scaled_up)
    if best is None:
        return None
    return solve_durations(slew, best, slopes=coarse.residual_jacobian(best)[1])


def linear(slew: BangBang) -> bool:
    """Return whether the linear model's slew is that of the model."""
    return _ends_at_goal(slew, linear_candidates(slew, True)[0])


def _ends_at_goal(slew: BangBang, durations: Vector) -> bool:
    return bool(np.abs(slew.residual(durations)).max() < _LINEAR)


def _minimum_duration(
    slew: BangBang,
    candidates: list[Vector],
    solve: Callable[[BangBang, Vector], Vector | None],
) -> Vector | None:
    """Return the shortest slew that `solve` finds from candidates in rising order."""
    best, shift = None, 0.0
    for guess in candidates:
        if best is not None and guess.sum() - _MARGIN * shift > best.sum():
            break
        found = solve(slew, guess)
        if found is not None:
            shift = max(shift, abs(float(found.sum() - guess.sum())))
            best = found if best is None or found.sum() < best.sum() else best
    return best


def _scaled_up(slew: BangBang, guess: Vector) -> Vector | None:
    """Return the durations reached while goal and effort grow from nearly zero, if any."""
    scale, step = 0.0, 0.125
    while scale < 1.0:
        found = solve_durations(slew, guess, min(1.0, scale + step))
        if found is None:
            step /= 2.0
            if step < 1.0 / 32.0:
                return None
        else:
            scale, guess = min(1.0, scale + step), found
    return guess


def five_switch_durations(slew: BangBang) -> Vector | None:
    """Return the shortest arcs with five switches that end at rest, shape (6,); None if none.

    For undamped models: the effort is antisymmetric about the middle, where the joint must be
    half way and the mode zero. For a first switch at p these two equations give the width of
    the first pulse and T(p) by Newton's method; the smallest T(p) is taken.
    """
    half = slew.rigid_duration / 2.0
    rows = slew.rest_rows[:2]
    middle = rows @ slew.start + np.array([0.5 * slew.distance, 0.0])
    ensemble, efforts = slew.model_ensemble((1.0,)), slew.efforts(3)
    coarse = replace(slew, coarse=True).step

    def arc_durations(p: float, close: float = _EXACT, step: float = slew.step) -> Vector | None:
        d = np.array([p, 0.0, half - p])
        for _ in range(8):
            x, by_duration = final_sensitivity(ensemble, slew.start, efforts, d, step)
            change = np.linalg.solve(rows @ by_duration[:, 1:], middle - rows @ x)
            if not np.isfinite(change).all() or np.abs(change).max() > half:
                return None
            d = d + np.append(0.0, change)
            if np.abs(change).max() < close * half:
                return d if d.min() > 0.0 else None
        return None

    def length(p: float, close: float = _EXACT) -> float:
        d = arc_durations(p, close, coarse)
        return float("inf") if d is None else float(d.sum())

    grid: Vector = half * np.linspace(0.01, 0.99, 49)
    lengths = [length(float(p), _NEAR) for p in grid]
    best = int(np.argmin(lengths))
    if not np.isfinite(lengths[best]):
        return None
    bounds = (float(grid[max(best - 1, 0)]), float(grid[min(best + 1, 48)]))
    found = minimize_scalar(length, bounds=bounds, method="bounded", options={"xatol": 1e-9})
    d = (
        arc_durations(float(found.x))
        if found.fun <= lengths[best]
        else arc_durations(float(grid[best]))
    )
    if d is None:
        return None
    whole = np.concatenate((d, d[::-1]))
    return whole if np.abs(slew.residual(whole)).max() < 1e-7 else None


def minimum_switch_durations(slew: BangBang) -> Vector | None:
    """Return the arcs of the shortest slew with the fewest switches that end at rest; None: none.

    Without robustness five switches are taken where no three lead to the goal: near a goal with a
    rigid slew that hardly excites the mode, the two inner arcs of three switches vanish.

    Args:
        slew: the slew.

    Raises:
        PlanFailed: if the linear model has none.
    """
    durations = continued_durations(slew)
    if durations is None and not slew.robust:
        return five_switch_durations(slew)
    return durations
