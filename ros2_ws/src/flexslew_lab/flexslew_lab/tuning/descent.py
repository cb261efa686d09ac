"""Minimisation of functions that are not smooth where they are smallest.

BFGS with a weak Wolfe line search (Lewis and Overton, Math. Program. 141, 2013), then gradient
sampling (Burke, Lewis and Overton, SIAM J. Optim. 15, 2005), as HANSO does.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from flexslew_plant.arrays import Matrix, Vector

Function = Callable[[Vector], tuple[float, Vector]]  # value and gradient; inf where undefined

_ARMIJO, _WOLFE = 1e-4, 0.5
_BISECTIONS = 40
_RADII = (1e-1, 1e-2, 1e-3, 1e-4)  # of the sampled ball, relative to 1 + |x|
_SAMPLED_STEPS = 12  # at each radius
_STALLED, _PATIENCE = 1e-7, 8  # relative decrease, and iterations in which it is less
_STABILISING = 500  # evaluations of the growth rate from each start
_SUM = 1e3  # weight of the sum of the multipliers, of the largest gradient


class Minimum(NamedTuple):
    """Where a descent ended.

    Args:
        x: there, shape (parameters,).
        value: of the function.
        evaluations: of the function.
        optimality: length of the shortest convex combination of the gradients near x; nan: no
            gradients were sampled.
    """

    x: Vector
    value: float
    evaluations: int
    optimality: float


class _Counted:
    """A function that counts, and ends a descent by a target or a number of evaluations."""

    def __init__(self, function: Function, most: int, target: float) -> None:
        self.function, self.most, self.target, self.count = function, most, target, 0

    def __call__(self, x: Vector) -> tuple[float, Vector]:
        self.count += 1
        value, gradient = self.function(x)
        return (value, gradient) if np.isfinite(value) else (np.inf, np.zeros_like(x))

    def done(self, value: float) -> bool:
        return value < self.target or self.count >= self.most


def minimise(
    function: Function,
    start: Vector,
    evaluations: int = 2000,
    target: float = -np.inf,
    rng: np.random.Generator | None = None,
) -> Minimum:
    """Return a local minimum of a function.

    Args:
        function: value and gradient, inf where it is not defined.
        start: where it is finite, shape (parameters,).
        evaluations: at most, approximately.
        target: a smaller value ends the descent.
        rng: of the sampled gradients; None: BFGS alone.
    """
    counted = _Counted(function, evaluations, target)
    value, gradient = counted(start)
    x = np.array(start, dtype=np.float64)
    if np.isfinite(value) and x.size:
        x, value, gradient = _bfgs(counted, x, value, gradient)
        if rng is not None and not counted.done(value):
            x, value, optimality = _sampled(counted, x, value, gradient, rng)
            return Minimum(x, value, counted.count, optimality)
    return Minimum(x, value, counted.count, np.nan)


def _bfgs(
    function: _Counted, x: Vector, value: float, gradient: Vector
) -> tuple[Vector, float, Vector]:
    inverse, first, stalled = np.eye(x.size), True, 0
    while not function.done(value):
        direction = -inverse @ gradient
        slope = float(direction @ gradient)
        if not slope < 0.0:
            if first:
                break
            inverse, first = np.eye(x.size), True
            continue
        found = _weak_wolfe(function, x, value, direction, slope)
        if found is None:
            if first:
                break
            inverse, first = np.eye(x.size), True
            continue
        step, new_value, new_gradient = found
        s, y = step * direction, new_gradient - gradient
        stalled = stalled + 1 if value - new_value <= _STALLED * abs(value) else 0
        x, value, gradient = x + s, new_value, new_gradient
        if stalled >= _PATIENCE or not gradient.any():
            break
        product = float(s @ y)
        if product > 1e-14 * float(np.linalg.norm(s) * np.linalg.norm(y)):
            if first:  # the scale of the first step, Nocedal and Wright (6.20)
                inverse, first = inverse * product / float(y @ y), False
            inverse = _updated(inverse, s, y, product)
    return x, value, gradient


def _updated(inverse: Matrix, s: Vector, y: Vector, product: float) -> Matrix:
    left = np.eye(s.size) - np.outer(s, y) / product
    return np.asarray(left @ inverse @ left.T + np.outer(s, s) / product)


def _weak_wolfe(
    function: _Counted, x: Vector, value: float, direction: Vector, slope: float
) -> tuple[float, float, Vector] | None:
    """Return step, value and gradient by bisection; None: no smaller value was found."""
    low, high, step = 0.0, np.inf, 1.0
    best = None
    for _ in range(_BISECTIONS):
        new_value, new_gradient = function(x + step * direction)
        if not new_value < value + _ARMIJO * step * slope:
            high = step
        else:
            best = step, new_value, new_gradient
            if float(new_gradient @ direction) >= _WOLFE * slope or function.done(new_value):
                break
            low = step
        step = 0.5 * (low + high) if np.isfinite(high) else 2.0 * step
        if high - low <= 1e-14 * max(1.0, low):
            break
    return best


def _sampled(
    function: _Counted, x: Vector, value: float, gradient: Vector, rng: np.random.Generator
) -> tuple[Vector, float, float]:
    """Descend along the shortest vector of the convex hull of gradients near x."""
    optimality = np.nan
    for relative in _RADII:
        radius = relative * (1.0 + float(np.linalg.norm(x)))
        for _ in range(_SAMPLED_STEPS):
            if function.done(value):
                return x, value, optimality
            points = x + radius * _ball(rng, min(2 * x.size, 40), x.size)
            near = [function(point) for point in points]
            gradients = [gradient, *(g for v, g in near if np.isfinite(v))]
            shortest = shortest_in_hull(np.array(gradients))
            optimality = float(np.linalg.norm(shortest))
            if optimality <= relative * 1e-3 * (1.0 + abs(value)):
                break
            direction = -shortest / optimality * radius
            found = _weak_wolfe(function, x, value, direction, -optimality * radius)
            if found is None or value - found[1] <= _STALLED * abs(value):
                break
            x, value, gradient = x + found[0] * direction, found[1], found[2]
    return x, value, optimality


def _ball(rng: np.random.Generator, count: int, size: int) -> Matrix:
    points = rng.standard_normal((count, size))
    points /= np.linalg.norm(points, axis=1)[:, None]
    return points * rng.uniform(0.0, 1.0, (count, 1)) ** (1.0 / size)


def shortest_in_hull(gradients: Matrix) -> Vector:
    """Return the shortest convex combination of rows, shape (parameters,).

    The problem min |G^T l|, l >= 0, sum l = 1 as non-negative least squares, its sum as one
    heavily weighted row.
    """
    size = max(float(np.linalg.norm(gradients, axis=1).max()), 1e-300)
    system = np.vstack((gradients.T / size, _SUM * np.ones(len(gradients))))
    right = np.zeros(len(system))
    right[-1] = _SUM
    weights, _ = nnls(system, right)
    return np.asarray(weights @ gradients / max(float(weights.sum()), 1e-300))


def stabilised(growth: Function, start: Vector) -> Vector | None:
    """Return parameters from which the growth rate is negative, or None.

    Args:
        growth: largest growth rate [1/s] and its gradient.
        start: shape (parameters,).
    """
    found = minimise(growth, start, _STABILISING, 0.0)
    return found.x if found.value < 0.0 else None
