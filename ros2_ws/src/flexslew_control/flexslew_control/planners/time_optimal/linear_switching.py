"""Closed forms of the linear slew with one undamped mode: where a bang-bang search starts.

Times are phase angles of the mode; the effort is antisymmetric about T, half of t_f, with its
other switches at T +- t1 and T +- t2.
"""

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import PlanFailed


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
        raise PlanFailed("no three-switch slew of the linear model was found; use another goal")
    low, high = y[crossing[0]], y[crossing[0] + 1]
    for _ in range(60):
        middle = 0.5 * (low + high)
        same = np.signbit(excess(middle)) == np.signbit(excess(low))
        low, high = (middle, high) if same else (low, middle)
    return float(np.sqrt(a + 2.0 * low**2)), float(low)


def five_switches(a: float) -> tuple[float, float, float]:
    """Return T, t1 and t2 [rad] of the robust slew with the smallest T.

    T^2/2 - t2^2 + t1^2 = a/2, 1 - 2 cos(w t1) + 2 cos(w t2) = cos(w T) at w = 1, and the
    derivative of the latter by w.

    Args:
        a: as in three_switches.

    Raises:
        PlanFailed: no such switches within two periods of the rigid body's.
    """

    def equations(z: Vector) -> Vector:
        t, t1, t2 = z
        return np.array(
            [
                t**2 / 2 - t2**2 + t1**2 - a / 2,
                1 - 2 * np.cos(t1) + 2 * np.cos(t2) - np.cos(t),
                2 * t1 * np.sin(t1) - 2 * t2 * np.sin(t2) + t * np.sin(t),
            ]
        )

    def slopes(z: Vector) -> Matrix:
        t, t1, t2 = z
        return np.array(
            [
                [t, 2 * t1, -2 * t2],
                [np.sin(t), 2 * np.sin(t1), -2 * np.sin(t2)],
                [
                    np.sin(t) + t * np.cos(t),
                    2 * (np.sin(t1) + t1 * np.cos(t1)),
                    -2 * (np.sin(t2) + t2 * np.cos(t2)),
                ],
            ]
        )

    # on a grid in (T, t1) with t2 from the first equation; the best cells are polished
    rigid = np.sqrt(a)
    t = rigid + np.linspace(0.0, 4.0 * np.pi, 160)[1:, None]
    t1 = np.linspace(0.0, min(rigid + 4.0 * np.pi, 8.0 * np.pi), 200)[None, 1:]
    square = t**2 / 2 + t1**2 - a / 2
    t2 = np.sqrt(square)
    merit = (1 - 2 * np.cos(t1) + 2 * np.cos(t2) - np.cos(t)) ** 2
    merit += (2 * t1 * np.sin(t1) - 2 * t2 * np.sin(t2) + t * np.sin(t)) ** 2 / t**2
    merit = np.where((t2 > t1) & (t2 < t), merit, np.inf)
    inner = merit[1:-1, 1:-1]
    lowest = (inner < np.inf) & (inner <= merit[:-2, 1:-1]) & (inner <= merit[2:, 1:-1])
    lowest &= (inner <= merit[1:-1, :-2]) & (inner <= merit[1:-1, 2:]) & (inner < 0.3)
    for i, j in np.argwhere(lowest) + 1:
        z = np.array([t[i, 0], t1[0, j], t2[i, j]])
        for _ in range(20):
            z = z - np.linalg.lstsq(slopes(z), equations(z), rcond=None)[0]
        if np.abs(equations(z)).max() < 1e-9 and 0.0 < z[1] < z[2] < z[0]:
            return float(z[0]), float(z[1]), float(z[2])
    raise PlanFailed("no five-switch slew of the linear model was found; use another goal")
