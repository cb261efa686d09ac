"""Bang-bang slews that are extremals: as many switches as the optimum has.

The linear programme of the linearised model gives the structure. Newton's method on the conditions
of Karush, Kuhn and Tucker for the shortest slew with that structure,
    r(d) = 0,    (dr/dd)^T mu = 1,
gives the arcs: then H = 1 on every arc and the switching function vanishes at every switch.
"""

from dataclasses import replace

import numpy as np

from flexslew_control.planners.time_optimal.linear_time_optimal import programmed_durations
from flexslew_control.planners.time_optimal.pontryagin import Arcs, switching_function
from flexslew_control.planners.time_optimal.switching import BangBang
from flexslew_plant.arrays import Matrix, Vector

_INTERVALS = (160, 480)  # of the linear programme, until the optimum's arcs are found
_CHANGE = 1e-6  # of an arc, for the second derivatives [s]
_ITERATIONS = 25
_END, _SLOPE = 1e-11, 1e-8  # at which the two conditions hold, relative


def extremal_durations(slew: BangBang) -> Vector | None:
    """Return the arcs of an extremal, or of the best slew found; None if there is none.

    Raises:
        PlanFailed: the linear model takes too long.
    """
    best = None
    for intervals in _INTERVALS:
        found = shortest_durations(slew, programmed_durations(slew, intervals))
        if found is None and slew.robust and slew.insensitive == "state":
            start = extremal_durations(replace(slew, insensitive="modes"))
            found = None if start is None else shortest_durations(slew, start)
        if found is not None:
            if switching_function(slew, found).holds:
                return found
            if best is None or found.sum() < best.sum():
                best = found
    return best


def shortest_durations(slew: Arcs, guess: Vector) -> Vector | None:
    """Return the arcs of the shortest slew with as many arcs near these; None if it fails."""
    d, j = guess, slew.linearised(guess)[1]
    if d.size < len(j):
        return None
    scale = 1.0 / np.linalg.norm(j * d, axis=1)  # of the end conditions
    mu = np.linalg.lstsq((scale[:, None] * j).T, np.ones(d.size), rcond=None)[0]
    for _ in range(_ITERATIONS):
        r, j = slew.linearised(d)
        r, j = scale * r, scale[:, None] * j
        slope = j.T @ mu - 1.0
        if not (np.isfinite(r).all() and np.isfinite(j).all()):
            return None
        if np.abs(r).max() < _END and np.abs(slope).max() < _SLOPE:
            return np.asarray(d)
        curvature = _curvature(slew, d, j, scale, mu)
        matrix = np.block([[curvature, j.T], [j, np.zeros((len(r), len(r)))]])
        step = -np.linalg.lstsq(matrix, np.concatenate((slope, r)), rcond=1e-14)[0]
        shrinking = step[: d.size] < 0.0
        room = np.min(-d[shrinking] / step[: d.size][shrinking], initial=np.inf)
        step = min(1.0, 0.5 * float(room)) * step
        d, mu = d + step[: d.size], mu + step[d.size :]
    return None


def nearest_durations(slew: Arcs, guess: Vector) -> Vector | None:
    """Return the arcs next to these that meet the end conditions; None if Newton's method fails."""
    d = guess
    for _ in range(_ITERATIONS):
        r, j = slew.linearised(d)
        if not np.isfinite(r).all() or d.min() <= 0.0:
            return None
        if np.abs(r).max() < _END:
            return np.asarray(d)
        d = d - np.linalg.lstsq(j, r, rcond=None)[0]
    return None


def _curvature(
    slew: Arcs, durations: Vector, slopes: Matrix, scale: Vector, multipliers: Vector
) -> Matrix:
    """Return the second derivatives of multipliers^T r by the durations, from its slopes."""
    rows = []
    for change in _CHANGE * np.eye(durations.size):
        ahead = scale[:, None] * slew.linearised(durations + change)[1]
        rows.append((ahead - slopes).T @ multipliers / _CHANGE)
    return np.array(rows)
