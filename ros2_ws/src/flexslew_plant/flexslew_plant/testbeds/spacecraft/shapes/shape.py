"""What a flexible shape is: points that move with its modes, and their stiffness."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.spacecraft.shapes.integrals import Integrals


class AppendagePoint(NamedTuple):
    """A place on an appendage and what its modes do there."""

    place: Vector  # undeformed, shape (3,) [m]
    displacement: Matrix  # Phi, shape (3, n) [-]
    turn: Matrix  # Psi, shape (3, n) [rad/m]
    curvature: Matrix  # d^2/ds^2 of the displacement, shape (3, n) [1/m^2]


class DeflectionLine(Protocol):
    """The deflection of the modes of an appendage along it."""

    def point(self, s: float) -> AppendagePoint:
        """Return what the modes do at the distance s from the root [m]."""


@dataclass(frozen=True)
class FlexibleShape:
    """An appendage in its own axes: origin at the hinge.

    Args:
        integrals: sums over its mass points.
        mass: diagonal of the modal mass matrix, shape (n,) [kg].
        stiffness: diagonal of the modal stiffness matrix, shape (n,) [N/m].
        tip: the place with the reported deflection and turn.
        line: places to draw it through, shape (k, 3) [m].
        line_shape: displacements by the modes there, shape (k, 3, n) [-].
        along: finds other places on it; none for modal data.
        damping: modal damping matrix that came with the data, shape (n, n), or none [N s/m].
        tip_scaled: whether a mode is one at the tip; else its modal mass is one.
    """

    integrals: Integrals
    mass: Vector
    stiffness: Vector
    tip: AppendagePoint
    line: Matrix
    line_shape: Matrix
    along: DeflectionLine | None = None
    damping: Matrix | None = None
    tip_scaled: bool = False

    @property
    def modes(self) -> int:
        """N."""
        return self.integrals.modes

    @property
    def frequencies(self) -> Vector:
        """With the root clamped, shape (n,) [rad/s]."""
        frequencies: Vector = np.sqrt(self.stiffness / self.mass)
        return frequencies
