"""Lower bound: the smallest part of the box that contains an unstable loop.

Poles at corners and random points of the box, then an ascent from the worst of them: of the growth,
and of minus the least damping ratio, since a slow pole hides what a faster one does (Packard and
Pandey's power iteration does not converge for real parameters, so poles are ascended directly).
What it finds is confirmed on the sampled loop itself.
"""

from collections.abc import Callable
from functools import partial
from time import thread_time
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from flexslew_lab.guarantee.box import corners_and_inner
from flexslew_lab.guarantee.model.uncertain_loop import UncertainLoop
from flexslew_plant.arrays import Matrix, Vector

_POINTS, _MOST_CORNERS, _ASCENTS = 400, 64, 3
_INWARD = 1e-3  # of the scale: the next search begins so much nearer to the centre
_ROUNDS, _BISECTIONS, _STEPS = 8, 30, 30
_SLOPE = 1e-5  # step of a difference quotient [-]
_LEAST = 1e-12  # of a pole's distance from z = 1


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


def breakdown(
    loop: UncertainLoop, unstable: Vector | None = None, end: float = np.inf
) -> Breakdown | None:
    """Return the nearest loop that is not stable, as a search has found it, or None.

    Args:
        loop: over the largest box to be searched.
        unstable: values of a loop that is not stable, where the search begins, or None.
        end: of the search, as time.thread_time counts [s]; the nearest one until then is returned.
    """
    m, rng = len(loop.box.centre), np.random.default_rng(1)
    starts = corners_and_inner(m, _MOST_CORNERS, _POINTS, rng)
    found, scale = None, 1.0
    if unstable is not None:
        found = _edge(loop, (unstable - loop.box.centre) / loop.box.radius)
        scale = 1.0 if found is None else found.scale * (1.0 - _INWARD)
    for _ in range(_ROUNDS):
        edge = _ascend(loop, scale, starts, end)
        if edge is None:
            break
        found = edge
        scale = edge.scale * (1.0 - _INWARD)
        worst = (edge.values - loop.box.centre) / loop.box.radius
        starts = np.vstack((worst / abs(worst).max(), starts))
    return found


def growth(loop: UncertainLoop, delta: Matrix) -> Vector:
    """Return the logarithm of the spectral radius at normalised coordinates, shape (points,)."""
    return np.asarray(np.log(abs(loop.fit.poles(delta)).max(axis=1)))


def least_damping(loop: UncertainLoop, delta: Matrix) -> Vector:
    """Return the least damping ratio at normalised coordinates, shape (points,) [-]."""
    z = loop.fit.poles(delta)
    s = np.log(np.where(abs(z) > _LEAST, z, _LEAST))
    return np.asarray((-s.real / np.maximum(abs(s), _LEAST)).min(axis=1))


def _ascend(loop: UncertainLoop, scale: float, starts: Matrix, end: float) -> Breakdown | None:
    """Return the edge of stability towards an unstable loop within a scale, or None."""
    points, origin = starts * scale, np.zeros((1, starts.shape[1]))

    def undamped(delta: Matrix) -> Vector:
        return -least_damping(loop, delta)

    for measure in (partial(growth, loop), undamped):
        values = measure(points)
        unit = max(abs(float(measure(origin)[0])), _LEAST)
        for start in points[np.argsort(-values)[:_ASCENTS]]:
            if thread_time() > end:
                return None
            edge = _edge(loop, start)
            if edge is None:
                result = minimize(
                    _negative, start, (measure, unit), jac=True, method="L-BFGS-B",
                    bounds=[(-scale, scale)] * len(start), options={"maxiter": _STEPS},
                )  # fmt: skip
                edge = _edge(loop, np.asarray(result.x))
            if edge is not None:
                return edge
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
    z = loop.fit.poles(delta[None])[0]
    angle = float(abs(np.angle(z[np.argmax(abs(z))])))
    return Breakdown(float(abs(delta).max()), loop.box.at(delta), angle)


def _negative(
    delta: Vector, measure: Callable[[Matrix], Vector], unit: float
) -> tuple[float, Vector]:
    """Return minus a measure and its slope, of its size at the centre."""
    points = np.vstack((delta, delta + _SLOPE * np.eye(len(delta))))
    values = -measure(points) / unit
    return float(values[0]), np.asarray((values[1:] - values[0]) / _SLOPE)
