"""Closed forms of the linear slew with one undamped mode: where a bang-bang search starts.

Times are phase angles of the mode; the effort is antisymmetric about T, half of t_f, with its
other switches at T +- t1 and T +- t2.
"""

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, compiled
from flexslew_plant.errors import PlanFailed

_CELL = 0.1  # side of the cells that are searched for five switches [rad]
_REACH = (np.pi, 4.0 * np.pi)  # searched beyond the rigid body's T, one after the other [rad]


def three_switches(a: float) -> tuple[float, float]:
    """Return T and t1 [rad] of T^2/2 - t1^2 = a/2, 2 cos t1 = 1 + cos T with the smallest t1.

    Args:
        a: w^2 J x/u, the slew as a phase angle squared.

    Raises:
        PlanFailed: no such switches within two periods.
    """
    y: Vector = np.linspace(0.0, 4.0 * np.pi, 20001)[1:]

    def excess(t1: Vector) -> Vector:
        return np.asarray(2.0 * np.cos(t1) - 1.0 - np.cos(np.sqrt(a + 2.0 * t1**2)))

    g = excess(y)
    crossing = np.flatnonzero(np.signbit(g[1:]) != np.signbit(g[:-1]))
    if crossing.size == 0:
        raise PlanFailed("no three-switch slew of the linear model was found")
    low, high = y[crossing[0]], y[crossing[0] + 1]
    for _ in range(60):
        middle = 0.5 * (low + high)
        same = np.signbit(excess(middle)) == np.signbit(excess(low))
        low, high = (middle, high) if same else (low, middle)
    return float(np.sqrt(a + 2.0 * low**2)), float(low)


def five_switches(a: float) -> Matrix:
    """Return every T, t1 and t2 [rad] of a robust slew, the smallest T first, shape (slews, 3).

    f = 1 - 2 cos t1 + 2 cos t2 - cos T = 0 and its derivative by the frequency,
    g = 2 t1 sin t1 - 2 t2 sin t2 + T sin T = 0, with T^2 = a + 2 (t2^2 - t1^2) from the way.
    The plane of t1 and t2 is divided into cells. A cell is left out only where bounds of the
    second derivatives show that f or g has no zero in it, so no slew is missed for want of a
    guess. Newton's method starts in all others.

    Args:
        a: as in three_switches.

    Raises:
        PlanFailed: no such switches within two periods of the rigid body's.
    """
    for reach in _REACH:
        found = _roots(a, np.sqrt(a) + reach, _CELL)
        if len(found):
            found = found[np.argsort(found[:, 0])]
            is_new = np.abs(np.diff(found, axis=0)).max(axis=1) > 1e-7
            return np.asarray(found[np.concatenate(([True], is_new))])
    raise PlanFailed("no five-switch slew of the linear model was found")


@compiled
def _roots(a: float, max_time: float, cell: float) -> Matrix:
    """Return T, t1 and t2 up to the longest T, unsorted, some of them twice."""
    found = np.empty((0, 3))
    limit, r = 0.5 * (max_time**2 - a), 0.5 * cell
    for j in range(int(np.ceil(max_time / cell))):
        t2 = (j + 0.5) * cell
        first = int(np.sqrt(max(0.0, t2**2 - limit)) / cell)
        for i in range(max(0, first - 1), j + 1):
            t1 = (i + 0.5) * cell
            square = a + 2.0 * (t2**2 - t1**2)
            if square <= 0.0:  # on the diagonal of a slew that hardly moves
                square = 0.25 * cell**2
            t = np.sqrt(square)
            s1, s2, s = np.sin(t1), np.sin(t2), np.sin(t)
            c1, c2, c = np.cos(t1), np.cos(t2), np.cos(t)
            by_1, by_2 = -2.0 * t1 / t, 2.0 * t2 / t  # dT/dt1 and dT/dt2
            f, g = 1.0 - 2.0 * c1 + 2.0 * c2 - c, 2.0 * t1 * s1 - 2.0 * t2 * s2 + t * s
            f1, f2 = 2.0 * s1 + s * by_1, -2.0 * s2 + s * by_2
            g_t = s + t * c
            g1, g2 = 2.0 * (s1 + t1 * c1) + g_t * by_1, -2.0 * (s2 + t2 * c2) + g_t * by_2
            if abs(f) > (abs(f1) + abs(f2)) * r + 22.0 * r**2:
                continue
            if abs(g) > (abs(g1) + abs(g2)) * r + (48.0 + 12.0 * (t + 2.0 * cell)) * r**2:
                continue
            root = _refine(a, t1, t2)
            if 0.0 < root[1] < root[2] < root[0] <= max_time:
                found = np.concatenate((found, root.reshape((1, 3))))
    return found


@compiled
def _refine(a: float, t1: float, t2: float) -> Vector:
    """Return T, t1 and t2 by Newton's method from here, zeros where it does not converge."""
    for _ in range(40):
        square = a + 2.0 * (t2**2 - t1**2)
        if not square > 0.0:
            break
        t = np.sqrt(square)
        s1, s2, s = np.sin(t1), np.sin(t2), np.sin(t)
        by_1, by_2 = -2.0 * t1 / t, 2.0 * t2 / t
        f = 1.0 - 2.0 * np.cos(t1) + 2.0 * np.cos(t2) - np.cos(t)
        g = 2.0 * t1 * s1 - 2.0 * t2 * s2 + t * s
        f1, f2 = 2.0 * s1 + s * by_1, -2.0 * s2 + s * by_2
        g_t = s + t * np.cos(t)
        g1 = 2.0 * (s1 + t1 * np.cos(t1)) + g_t * by_1
        g2 = -2.0 * (s2 + t2 * np.cos(t2)) + g_t * by_2
        determinant = f1 * g2 - f2 * g1
        if determinant == 0.0:
            break
        step_1, step_2 = (f2 * g - g2 * f) / determinant, (g1 * f - f1 * g) / determinant
        largest = max(abs(step_1), abs(step_2))
        step_scale = min(1.0, 0.5 / largest) if largest > 0.0 else 1.0
        t1, t2 = t1 + step_scale * step_1, t2 + step_scale * step_2
        if largest < 1e-13 * (1.0 + t2):
            return np.array([np.sqrt(a + 2.0 * (t2**2 - t1**2)), t1, t2])
    return np.zeros(3)
