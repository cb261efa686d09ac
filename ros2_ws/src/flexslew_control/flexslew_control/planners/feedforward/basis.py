"""Functions of time of which a feedforward is the sum (18): B-splines and sines on [0, T]."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from scipy.interpolate import BSpline

from flexslew_plant.arrays import Matrix, Vector

BasisName: TypeAlias = Literal["hat", "constant", "cubic", "trigonometric"]
_DEGREES = {"constant": 0, "hat": 1, "cubic": 3}


@dataclass(frozen=True)
class Basis:
    """n functions B_j(t) on [0, T], zero outside.

    hat, cubic: uniform B-splines of degree 1 and 3; their supports fill [0, T] exactly, so that
        they are zero at both ends. hat: B_j = 1 at t = j T / (n + 1) (Gorinevsky and Vukovich
        1998, section 3.1).
    constant: n pieces of length T / n.
    trigonometric: sin(j pi t / T), j = 1 .. n.

    Args:
        name: which family.
        functions: n.
        duration: T [s].
    """

    name: BasisName
    functions: int
    duration: float

    @property
    def nodes(self) -> Vector:
        """Times between which every function is smooth, with 0 and T, rising [s]."""
        pieces = self.functions + _DEGREES.get(self.name, 0)
        return np.linspace(0.0, self.duration, pieces + 1)

    def values(self, times: Vector) -> Matrix:
        """Return B_j(t), shape (times, n); at a jump the value after it.

        Args:
            times: shape (k,) [s].
        """
        active = (times >= 0.0) & (times <= self.duration)
        clipped = np.clip(times, 0.0, self.duration)
        if self.name == "trigonometric":
            table = np.sin(np.multiply.outer(clipped, self._frequencies))
        else:
            table = np.asarray(self._spline(clipped))
        return np.where(active[:, None], table, 0.0)

    def means(self, edges: Vector) -> Matrix:
        """Return the mean of each B_j between neighbouring edges, exact, shape (edges - 1, n).

        Args:
            edges: rising times, shape (k,) [s].
        """
        return np.diff(self._antiderivative(edges), axis=0) / np.diff(edges)[:, None]

    def _antiderivative(self, times: Vector) -> Matrix:
        clipped = np.clip(times, 0.0, self.duration)
        if self.name == "trigonometric":
            w = self._frequencies
            half = np.sin(np.multiply.outer(clipped, 0.5 * w))
            return np.asarray(2.0 * half**2 / w, dtype=np.float64)  # (1 - cos) / w
        integral: Callable[[Vector], Matrix] = self._spline.antiderivative()
        return np.asarray(integral(clipped))

    @property
    def _frequencies(self) -> Vector:
        order: Vector = np.arange(1, self.functions + 1, dtype=np.float64)
        return order * (np.pi / self.duration)

    @property
    def _spline(self) -> BSpline:
        n, d = self.functions, _DEGREES[self.name]
        spacing = self.duration / (n + d)
        knots = np.arange(-d, n + 2 * d + 1) * spacing  # d extra at each side, unused
        return BSpline(knots, np.eye(n + 2 * d)[:, d : d + n], d)
