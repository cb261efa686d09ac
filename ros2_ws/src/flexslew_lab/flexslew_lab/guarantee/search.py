"""Lower bound: the smallest part of the box that contains an unstable loop.

A gradient ascent of the spectral radius over the box from its corners, random points and the last
worst one (Packard and Pandey's power iteration does not converge for real parameters, so poles are
ascended directly). What it finds is confirmed on the sampled loop itself.
"""

from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from flexslew_lab.guarantee.box import corners
from flexslew_lab.guarantee.certificate import UncertainLoop
from flexslew_plant.arrays import Matrix, Vector

_STARTS, _MOST_CORNERS, _ASCENTS = 16, 64, 4
_ROUNDING = 1e-9  # of poles on the circle that the loop does not show
_INWARD = 1e-3  # of the scale: the next search begins so much nearer to the centre
_ROUNDS, _BISECTIONS = 6, 30


class Breakdown(NamedTuple):
    """The nearest loop that is not stable.

    Args:
        scale: of the box, on whose side it is [-].
        values: of the parameters, shape (m,).
        angle: of the pole on the circle [rad].
    """

    scale: float
    values: Vector
    angle: float


def breakdown(loop: UncertainLoop, seed: int = 1) -> Breakdown | None:
    """Return the nearest loop that is not stable, as a search has found it, or None.

    Args:
        loop: over the largest box to be searched.
        seed: of random starts.
    """
    m, rng = len(loop.box.centre), np.random.default_rng(seed)
    starts = corners(m)
    if len(starts) > _MOST_CORNERS:
        starts = starts[rng.choice(len(starts), _MOST_CORNERS, replace=False)]
    starts = np.vstack((starts, rng.uniform(-1.0, 1.0, (_STARTS, m))))
    found, scale = None, 1.0
    for _ in range(_ROUNDS):
        worst = _ascend(loop, scale, starts)
        if worst is None:
            break
        edge = _edge(loop, worst)
        if edge is None:
            break
        found = edge
        scale = edge.scale * (1.0 - _INWARD)
        starts = np.vstack((worst / abs(worst).max(), starts))
    return found


def _ascend(loop: UncertainLoop, scale: float, starts: Matrix) -> Vector | None:
    """Return normalised coordinates with an unstable loop within a scale, or None."""
    points = starts * scale
    radii = np.array([_radius(loop, delta)[0] for delta in points])
    best = np.argsort(-radii)[:_ASCENTS]
    if radii[best[0]] > 1.0 + _ROUNDING:
        return np.asarray(points[best[0]])
    for start in points[best]:
        result = minimize(
            partial(_negative, loop), start, jac=True, method="L-BFGS-B",
            bounds=[(-scale, scale)] * points.shape[1], options={"maxiter": 30},
        )  # fmt: skip
        if -result.fun > 1.0 + _ROUNDING:
            return np.asarray(result.x)
    return None


def _edge(loop: UncertainLoop, worst: Vector) -> Breakdown | None:
    """Return where the way from the centre to an unstable loop leaves stability, just outside."""
    if loop.stable(loop.box.at(worst)):
        return None
    low, high = 0.0, 1.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if loop.stable(loop.box.at(middle * worst)) else (low, middle)
    delta = high * worst
    angle = _radius(loop, delta)[1]
    return Breakdown(float(abs(delta).max()), loop.box.at(delta), angle)


def _negative(loop: UncertainLoop, delta: Vector) -> tuple[float, Vector]:
    """Return minus the spectral radius, and its slope, at normalised coordinates."""
    h, value = 1e-5, _radius(loop, delta)[0]
    slope = [(_radius(loop, delta + h * one)[0] - value) / h for one in np.eye(len(delta))]
    return -value, -np.array(slope)


def _radius(loop: UncertainLoop, delta: Vector) -> tuple[float, float]:
    """Return the spectral radius, and the angle of its pole [rad]; hidden rigid motions count."""
    z = np.linalg.eigvals(loop.form.at(delta)[: loop.states, : loop.states])
    largest = z[np.argmax(abs(z))]
    return float(abs(largest)), float(abs(np.angle(largest)))
