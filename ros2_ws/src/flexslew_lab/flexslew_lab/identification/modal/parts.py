"""The solution of one group of outputs, and what groups of the same kind share."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from flexslew_lab.identification.modal.parameter_groups import ParameterGroup
from flexslew_lab.identification.modal.projection import Projection
from flexslew_plant.arrays import Matrix, Vector


@dataclass(frozen=True)
class SharedColumns:
    """What groups with the same quantities and weights share."""

    columns: Matrix  # of unit length
    scale: Vector  # lengths that they had
    projection: Projection
    turned: Matrix  # d(columns of the modes)/d(nonlinear), orthogonal to the columns
    along: Matrix  # weights of the columns in it

    @cached_property
    def products(self) -> Matrix:
        """Return those of the turned columns with one another."""
        return np.asarray(self.turned.T @ self.turned)

    @cached_property
    def factors(self) -> tuple[Matrix, Matrix]:
        """Return Q and R of the columns."""
        q, r = np.linalg.qr(self.columns)
        return np.asarray(q), np.asarray(r)


@dataclass(frozen=True)
class Part:
    """The solution of one group."""

    group: ParameterGroup
    weights: Vector  # linear parameters
    of_modes: Matrix  # those of each mode's own columns, (modes, columns)
    sigma: float  # standard deviation of the first quantity's noise
    basis: SharedColumns
    residual: Vector  # in standard deviations
    gradient: Vector  # J^T r
    information: Matrix  # J^T J
    along: Matrix  # d(linear)/d(nonlinear) of the scaled columns, negative
    own: Matrix  # what turns the slopes of all columns into those by the modes' numbers

    def with_pieces(
        self, gradient: Vector, cross: Matrix, piece_information: Matrix, along: Matrix
    ) -> "Part":
        """Return the part with unknown efforts behind the numbers of the modes.

        Args:
            gradient: slopes by the pieces times the residual, (pieces,).
            cross: slopes by the modes' numbers times those by the pieces, (2 modes, pieces).
            piece_information: slopes by the pieces times one another, (pieces, pieces).
            along: weights of the columns in the pulses, (n, pieces).
        """
        cross = cross / self.sigma**2
        return replace(
            self,
            gradient=np.concatenate((self.gradient, gradient / self.sigma)),
            information=np.block(
                [[self.information, cross], [cross.T, piece_information / self.sigma**2]]
            ),
            along=np.hstack((self.along, along)),
        )
