"""Bang-bang slews of a linear model with one damped mode, by Newton's method from many starts.

Damping takes the antisymmetry away, and without damping some slews have none: all durations d of
the arcs are unknown. Times are multiplied by the mode's frequency. With the effort +-1, its edges
at tau before the end and its jumps c there, the joint rests at the goal for
    sum c tau = 0,    sum c tau^2/2 = a,
the mode does for sum c x(tau) = sum c y(tau) = 0, where x and y are its free motions from a
deflection and from a rate of one, and neither is sensitive to the frequency for
    sum c tau x(tau) = sum c tau y(tau) = 0.
Starts are the rigid body's slew with a reversed pulse, or two, anywhere (the form of an optimum
that takes some periods) and arcs of any lengths (for a shorter one). They fill their cube evenly,
so the same slew is found every time.
"""

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, compiled
from flexslew_plant.errors import PlanFailed

_STARTS, _STARTS_PER_RADIAN = 800, 15  # more for longer slews, which have more pulses to place
_REACH = (2.0 * np.pi, 8.0 * np.pi)  # searched beyond the rigid slew, one after the other [rad]
_KEPT = 200  # slews at most


def linear_slews(a: float, damping: float, switches: int, excess: float = 0.0) -> Matrix:
    """Return the arcs of the shortest slew and of those that are hardly longer, shortest first.

    Args:
        a: w^2 J x/u, the slew as a phase angle squared.
        damping: ratio of the mode [-]; one or more is overdamped.
        switches: 3, or 5 for a slew that is not sensitive to the frequency.
        excess: by how much a slew may be longer than the shortest [rad].

    Returns:
        durations as phase angles, shape (slews, switches + 1).

    Raises:
        PlanFailed: none was found within four periods beyond the rigid body's.
    """
    starts = _STARTS + int(_STARTS_PER_RADIAN * np.sqrt(a))
    for reach in _REACH:
        found = _search(a, damping, switches + 1, starts, reach, excess, _even(6))
        if len(found):
            found = found[np.argsort(found.sum(axis=1), kind="stable")]
            total = found.sum(axis=1)
            return np.asarray(found[total <= total[0] + excess])
    raise PlanFailed(f"no {switches}-switch slew of the linear model was found")


def _even(dimensions: int) -> Vector:
    """Return the strides, modulo one, of points that fill a cube evenly (Kronecker's sequence)."""
    root = 2.0
    for _ in range(64):  # of x^(n + 1) = x + 1
        root = (1.0 + root) ** (1.0 / (dimensions + 1))
    return np.asarray(root ** -np.arange(1.0, dimensions + 1.0))


@compiled
def _search(
    a: float, damping: float, arcs: int, starts: int, reach: float, excess: float, strides: Vector
) -> Matrix:
    """Return the different slews found, unsorted, shape (slews, arcs)."""
    rigid, best = 2.0 * np.sqrt(a), np.inf
    found, kept = np.empty((_KEPT, arcs)), 0
    d, at = np.empty(arcs), np.full(strides.size, 0.5)
    for start in range(starts):
        for k in range(at.size):
            at[k] = (at[k] + strides[k]) % 1.0
        last = min(rigid + reach, best + excess)
        total = rigid + (last - rigid) * at[0]
        if start % 3 == 0:
            for k in range(arcs):
                d[k] = -np.log((at[k] + 0.5 * at[0]) % 1.0 + 1e-12)
            d *= total / d.sum()
        else:
            _pulse_durations(total, at, d)
        if not _solve(a, damping, last + 4.0, d) or d.min() < 1e-9 or d.sum() > best + excess:
            continue
        best = min(best, d.sum())
        new = True
        for k in range(kept):
            if np.abs(found[k] - d).max() < 1e-6:
                new = False
        if new:
            if kept == _KEPT:  # in place of the longest
                kept -= 1
                longest = int(np.argmax(found.sum(axis=1)))
                found[longest] = found[kept]
            found[kept] = d
            kept += 1
    return found[:kept]


@compiled
def _pulse_durations(total: float, at: Vector, d: Vector) -> None:
    """Write the arcs of the rigid slew with reversed pulses, their places and widths in `at`."""
    edges = np.empty(d.size - 1)
    edges[0] = 0.5 * total
    for k in range((d.size - 2) // 2):
        middle = total * at[1 + 2 * k]
        width = min(np.pi, 0.3 * total) * at[2 + 2 * k]
        first, last = middle - 0.5 * width, middle + 0.5 * width
        edges[1 + 2 * k] = first if first > 0.0 else 0.3 * middle
        edges[2 + 2 * k] = last if last < total else total - 0.3 * (total - middle)
    edges.sort()
    before = 0.0
    for k in range(edges.size):
        d[k] = max(edges[k] - before, 1e-3)
        before = edges[k]
    d[edges.size] = max(total - before, 1e-3)


@compiled
def _solve(a: float, damping: float, longest: float, d: Vector) -> bool:
    """Replace d by arcs that meet the conditions; False if Newton's method goes elsewhere."""
    size = d.size
    slopes, r = np.empty((size, size)), np.empty(size)
    for _ in range(25):
        _residual_jacobian(a, damping, d, r, slopes)
        if not _solve_linear(slopes, r):
            return False
        largest, share = np.abs(r).max(), 1.0
        if not largest < 1e6:
            return False
        if largest > 1.5:
            share = 1.5 / largest
        for k in range(size):
            if -0.8 * d[k] > share * r[k]:
                share = -0.8 * d[k] / r[k]
        if share < 1e-3:
            return False
        for k in range(size):
            d[k] += share * r[k]
        if share == 1.0 and largest < 1e-11:
            return True
        if d.sum() > longest:
            return False
    return False


@compiled
def _residual_jacobian(a: float, damping: float, d: Vector, r: Vector, slopes: Matrix) -> None:
    """Write the conditions and their derivatives by the durations."""
    size, frequency_ratio = d.size, np.sqrt(abs(1.0 - damping**2))
    frequency_ratio = max(frequency_ratio, 1e-9)
    r[:] = 0.0
    r[1] = -a
    # an arc moves every edge before it away from the end
    v, by_tau, tau = np.zeros(6), np.zeros(6), d.sum()
    for edge in range(size + 1):
        jump = -2.0 if edge % 2 == 1 else 2.0
        if edge == 0 or edge == size:
            jump *= 0.5
        decay = np.exp(-damping * tau)
        if damping < 1.0:
            y, x = np.sin(frequency_ratio * tau) / frequency_ratio, np.cos(frequency_ratio * tau)
        else:
            y, x = np.sinh(frequency_ratio * tau) / frequency_ratio, np.cosh(frequency_ratio * tau)
        y *= decay
        x = decay * x + damping * y
        x_rate, y_rate = -y, x - 2.0 * damping * y
        v[0], v[1], v[2], v[3], v[4], v[5] = tau, 0.5 * tau**2, x, y, tau * x, tau * y
        by_tau[0] += jump
        by_tau[1] += jump * tau
        by_tau[2] += jump * x_rate
        by_tau[3] += jump * y_rate
        by_tau[4] += jump * (x + tau * x_rate)
        by_tau[5] += jump * (y + tau * y_rate)
        for i in range(size):
            r[i] += jump * v[i]
            if edge < size:
                slopes[i, edge] = by_tau[i]
        if edge < size:
            tau -= d[edge]


@compiled
def _solve_linear(matrix: Matrix, r: Vector) -> bool:
    """Replace r by -matrix^-1 r, both used up; False if the matrix is singular."""
    size = r.size
    for i in range(size):
        scale = np.abs(matrix[i]).max()
        if not scale > 1e-200:
            return False
        for j in range(size):
            matrix[i, j] /= scale
        r[i] /= -scale
    for column in range(size):
        pivot = column
        for i in range(column + 1, size):
            if abs(matrix[i, column]) > abs(matrix[pivot, column]):
                pivot = i
        if abs(matrix[pivot, column]) < 1e-13:
            return False
        if pivot != column:
            for j in range(column, size):
                swapped = matrix[pivot, j]
                matrix[pivot, j] = matrix[column, j]
                matrix[column, j] = swapped
            swapped = r[pivot]
            r[pivot] = r[column]
            r[column] = swapped
        for i in range(column + 1, size):
            factor = matrix[i, column] / matrix[column, column]
            for j in range(column + 1, size):
                matrix[i, j] -= factor * matrix[column, j]
            r[i] -= factor * r[column]
    for i in range(size - 1, -1, -1):
        for j in range(i + 1, size):
            r[i] -= matrix[i, j] * r[j]
        r[i] /= matrix[i, i]
    return True
