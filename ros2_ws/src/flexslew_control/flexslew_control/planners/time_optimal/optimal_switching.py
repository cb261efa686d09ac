"""Bang-bang slews that are extremals: as many switches as the optimum has.

The optimum of the linearised model gives the structure. Newton's method on the conditions of
Karush, Kuhn and Tucker for the shortest slew with that structure,
    r(d) = 0,    (dr/dd)^T mu = 1,
gives the arcs: then H = 1 on every arc and the switching function vanishes at every switch.
"""

from dataclasses import replace
from typing import NamedTuple, Protocol

import numpy as np

from flexslew_control.planners.time_optimal.arcs import final_sensitivity
from flexslew_control.planners.time_optimal.bang_bang import BangBang
from flexslew_control.planners.time_optimal.linear.linear_time_optimal import (
    Structure,
    linear_optimum,
)
from flexslew_control.planners.time_optimal.switching import linear
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import PlanFailed

_CHANGE = 1e-6  # of an arc, for the second derivatives [s]
_ITERATIONS = 25
_FIXED_ITERATIONS = 60  # with second derivatives that stay as they are
_MAX_RATIO = 3.0  # of the iterates, times the guess
_END, _SLOPE = 1e-11, 1e-8  # at which the two conditions hold, relative
_ROUNDING = 1e-12  # of dr/dd, relative: what multipliers of nearly equal conditions make large
_CLOSE = 1e-6, 1e-3  # the same, near the end
_FIRST_SWITCHES = np.linspace(0.01, 0.99, 49)  # that are tried, of half the rigid slew
_NEAR = 1e-3  # last change of a start, of the same


class Slopes(Protocol):
    """What Newton's method needs of a slew by arcs."""

    def residual_jacobian(self, durations: Vector) -> tuple[Vector, Matrix]:
        """Return r and dr/dd."""


def extremal_durations(slew: BangBang) -> Vector | None:
    """Return the arcs of the slew with the structure of the linear optimum; None if there is none.

    A whole state that is to be insensitive may have none: the joint of a linear plant is as
    sensitive as its modes. The slew then starts from that with insensitive modes.

    Raises:
        PlanFailed: the linear model takes too long.
    """
    structure, found = linear_optimum(slew).structure, None
    start = None if structure is None else _coarse_durations(slew, structure)
    if structure is not None and start is not None:
        found = minimum_durations(slew, start, structure.curvature)
    if found is None and slew.robust and slew.insensitive == "state":
        start = extremal_durations(replace(slew, insensitive="modes"))
        found = None if start is None else minimum_durations(slew, start)
    return found


class KnownOptimum(NamedTuple):
    """What more switches are known to gain."""

    duration: float  # [s]
    switches: int | None  # of the slew; None: of a linear model, where no slew takes less


def known_optimum(slew: BangBang, duration: float) -> KnownOptimum | None:
    """Return how fast the optimum is, where that is known without solving for its exact arcs.

    A rough slew d has r(d) = 0 and (dr/dd)^T mu = 1, so t_f of the exact one near it is
    sum d - mu . r, to second order in what the exact r misses.

    Args:
        slew: what is turned.
        duration: of the slew that is to be beaten [s].
    """
    try:
        optimum = linear_optimum(slew)
    except PlanFailed:
        return None
    d = None if optimum.structure is None else _coarse_durations(slew, optimum.structure)
    if d is not None:
        slopes = replace(slew, coarse=True).residual_jacobian(d)[1]
        mu = np.linalg.lstsq(slopes.T, np.ones(d.size), rcond=None)[0]
        estimate = float(d.sum() - mu @ slew.residual(d))
        return KnownOptimum(estimate, d.size - 1) if estimate < duration else None
    if linear(slew) and optimum.duration < duration:
        return KnownOptimum(optimum.duration, None)
    return None


def _coarse_durations(slew: BangBang, structure: Structure) -> Vector | None:
    return minimum_durations(replace(slew, coarse=True), structure.durations, structure.curvature)


def minimum_durations(
    slew: Slopes, guess: Vector, curvature: Matrix | None = None
) -> Vector | None:
    """Return the arcs of the shortest slew with as many arcs near these; None if it fails.

    Args:
        slew: what is turned.
        guess: durations to start from [s].
        curvature: second derivatives of mu^T r to use everywhere, but once the exact ones near the
            end where it comes there slowly; None: the exact ones.
    """
    d, j = guess, slew.residual_jacobian(guess)[1]
    if d.size < len(j):
        return None
    scale = 1.0 / np.linalg.norm(j * d, axis=1)  # of the end conditions
    mu = np.linalg.lstsq((scale[:, None] * j).T, np.ones(d.size), rcond=None)[0]
    known, before = curvature, 0.0
    for _ in range(_ITERATIONS if curvature is None else _FIXED_ITERATIONS):
        r, j = slew.residual_jacobian(d)
        r, j = scale * r, scale[:, None] * j
        slope = j.T @ mu - 1.0
        if not (np.isfinite(r).all() and np.isfinite(j).all()):
            return None
        end_error, wrong = float(np.abs(r).max()), float(np.abs(slope).max())
        tolerance = _SLOPE + _ROUNDING * float(np.abs(mu).max())
        if end_error < _END and wrong < tolerance:
            return np.asarray(d)
        close = end_error < _CLOSE[0] and wrong < _CLOSE[1] and before > _SLOPE
        # they cost an iteration for each arc: are as many not enough without them?
        if known is curvature and close and wrong * min(1.0, wrong / before) ** d.size > _SLOPE:
            known = None if curvature is None else _curvature(slew, d, j, scale, mu)
        hessian = _curvature(slew, d, j, scale, mu) if known is None else known
        before = wrong
        matrix = np.block([[hessian, j.T], [j, np.zeros((len(r), len(r)))]])
        step = -np.linalg.lstsq(matrix, np.concatenate((slope, r)), rcond=1e-14)[0]
        negative = step[: d.size] < 0.0
        ratio = np.min(-d[negative] / step[: d.size][negative], initial=np.inf)
        step = min(1.0, 0.5 * float(ratio)) * step
        d, mu = d + step[: d.size], mu + step[d.size :]
        if d.sum() > _MAX_RATIO * guess.sum():
            return None
    return None


def five_switch_durations(slew: BangBang) -> Vector | None:
    """Return the arcs of the shortest slew with five switches, shape (6,); None if none is found.

    They are taken where no three lead to the goal: near a goal with a rigid slew that hardly
    excites the mode, the two inner arcs of three switches vanish. The start is antisymmetric about
    the middle, where the joint must be half way and the mode zero: for a first switch at p these
    two conditions give the width of the first pulse and the duration.

    Args:
        slew: what is turned; of one that is to be robust none is looked for.
    """
    if slew.robust:
        return None
    half, rows = 0.5 * slew.rigid_duration, slew.rest_rows[:2]
    middle = rows @ slew.start + np.array([0.5 * slew.distance, 0.0])
    efforts, step = slew.efforts(3), replace(slew, coarse=True).step
    best = None
    for p in half * _FIRST_SWITCHES:
        d = np.array([p, 0.0, half - p])
        for _ in range(8):
            x, slopes = final_sensitivity(slew.ensemble, slew.start, efforts, d, step)
            change = np.linalg.solve(rows @ slopes[:, 1:], middle - rows @ x)
            if not np.abs(change).max() <= half:
                break
            d = d + np.append(0.0, change)
            if np.abs(change).max() < _NEAR * half:
                if d.min() > 0.0 and (best is None or d.sum() < best.sum()):
                    best = d
                break
    return None if best is None else minimum_durations(slew, np.concatenate((best, best[::-1])))


def nearest_durations(slew: Slopes, guess: Vector) -> Vector | None:
    """Return the arcs next to these that meet the end conditions; None if Newton's method fails."""
    d = guess
    for _ in range(_ITERATIONS):
        r, j = slew.residual_jacobian(d)
        if not np.isfinite(r).all() or d.min() <= 0.0:
            return None
        if np.abs(r).max() < _END:
            return np.asarray(d)
        d = d - np.linalg.lstsq(j, r, rcond=None)[0]
    return None


def _curvature(
    slew: Slopes, durations: Vector, slopes: Matrix, scale: Vector, multipliers: Vector
) -> Matrix:
    """Return the second derivatives of multipliers^T r by the durations, from its slopes."""
    rows = []
    for change in _CHANGE * np.eye(durations.size):
        forward = scale[:, None] * slew.residual_jacobian(durations + change)[1]
        rows.append((forward - slopes).T @ multipliers / _CHANGE)
    return np.array(rows)
