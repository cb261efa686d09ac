"""Efforts that no sample gives, estimated with the modes: their part of the least squares.

A constant effort d over one span adds d times the bench's response to a pulse there, z(t), to
every output. With the modes and residues of the present step, z is a column like those of
frequencies and damping ratios (variable projection, Kaufman 1975), shared by all outputs:

    z(t) = R0 iint u + sum_i (R_i q_i + S_i q_i') of the unit pulse u over the span.

The prior of an effort is a line between the samples around it, with the largest error that such a
line has anywhere in the record as its standard deviation. It separates spans with pulses that no
sensor can distinguish.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from flexslew_lab.identification.modal.oscillators import Oscillator
from flexslew_lab.identification.records.record import Record
from flexslew_plant.arrays import Matrix, Vector

_BLOCK = 1024  # rows at once
_KEPT = 20_000_000  # numbers of all pulses, up to which they are computed once


def estimates(record: Record) -> Vector:
    """Return the present efforts of the pieces, (pieces,)."""
    assert record.pieces is not None
    return np.asarray(record.effort[record.pieces.first, record.pieces.column])


def log_prior(record: Record) -> float:
    """Return half the squared distance of the estimates from their guesses, in its deviations."""
    pieces = record.pieces
    if pieces is None:
        return 0.0
    deviation = (estimates(record) - pieces.guess) / pieces.spread
    return float(0.5 * deviation @ deviation)


class PulseResponses:
    """Responses of every output to unit pulses over the pieces of a record.

    Args:
        record: with pieces.
        modes: of the fit.
    """

    def __init__(self, record: Record, modes: tuple[Oscillator, ...]) -> None:
        assert record.pieces is not None
        self._t, self.pieces = record.times, record.pieces
        self._modes = modes
        self._inputs = record.effort.shape[1]
        self._edges, places = np.unique(
            np.concatenate((self.pieces.first, self.pieces.last)), return_inverse=True
        )
        self._first, self._last = np.split(places, 2)
        size = len(self._t) * len(self.pieces.first) * (2 + 2 * len(modes))
        self._cached_blocks: list[tuple[slice, slice, PulseBlock]] | None = (
            [] if size < _KEPT else None
        )

    def blocks(self) -> Iterator[tuple[slice, slice, "PulseBlock"]]:
        """Yield rows, the pieces that begin before their end, and their pulses."""
        if self._cached_blocks:
            yield from self._cached_blocks
            return
        for begin in range(0, len(self._t), _BLOCK):
            rows = slice(begin, min(begin + _BLOCK, len(self._t)))
            count = int(np.searchsorted(self.pieces.first, rows.stop - 1))
            found = rows, slice(0, count), self._block(rows, count)
            if self._cached_blocks is not None:
                self._cached_blocks.append(found)
            yield found

    def _block(self, rows: slice, count: int) -> "PulseBlock":
        """Return pulses as differences of what efforts do that begin at their edges."""
        since = np.maximum(self._t[rows, None] - self._t[self._edges], 0.0)
        first, last = self._first[:count], self._last[:count]
        steps = [(0.5 * since**2, since), *(mode.step_response(since) for mode in self._modes)]
        rigid, *pulses = [(x[:, first] - x[:, last], v[:, first] - v[:, last]) for x, v in steps]
        return PulseBlock(rigid, pulses, self._modes, self.pieces.column[:count], self._inputs)


class PulseBlock:
    """Pulses over some rows, of positions and of rates.

    Args:
        rigid: of a unit inertia, each (rows, pieces).
        pulses: w^2 q and w^2 q' of every mode, each (rows, pieces).
        modes: of the fit.
        column: input of each piece, (pieces,).
        inputs: of the record.
    """

    def __init__(
        self,
        rigid: tuple[Matrix, Matrix],
        pulses: list[tuple[Matrix, Matrix]],
        modes: tuple[Oscillator, ...],
        column: NDArray[np.int64],
        inputs: int,
    ) -> None:
        self._rigid, self._pulses, self._modes = rigid, pulses, modes
        self._column, self._inputs = column, inputs

    def response(self, inverse_inertia: Vector | None, of_modes: Matrix, which: int) -> Matrix:
        """Return z of a position (which 0) or rate (1), (rows, pieces).

        Args:
            inverse_inertia: R0 of the output, (inputs,); None: of a deflection.
            of_modes: weights of each mode's own columns, (modes, columns).
            which: derivative.
        """
        z = np.zeros(self._rigid[0].shape)
        if inverse_inertia is not None:
            z += inverse_inertia[self._column] * self._rigid[which]
        for mode, (x, v), weights in zip(self._modes, self._pulses, of_modes, strict=True):
            z += weights[self._column] * (v if which else x)
            lags = weights[self._inputs + 2 :]
            if lags.size:
                w = mode.frequency
                derivative = -2.0 * mode.damping_ratio / w * v - x if which else v / w**2
                z += lags[self._column] * derivative
        return z


class PieceColumns(NamedTuple):
    """What pieces share with the other parameters of a group of outputs.

    Args:
        orthonormal: Q of the columns Q R of its linear parameters, (rows, n).
        triangular: R, (n, n).
        slopes: by frequencies and damping ratios, orthogonal to the columns, (rows, 2 modes).
        residual: in standard deviations, (rows,).
    """

    orthonormal: Matrix
    triangular: Matrix
    slopes: Matrix
    residual: Vector


class PieceSlopes:
    """Slopes of a group of outputs by the pieces: pulses without what its columns explain.

    Args:
        shared: with the group's other parameters.
        rows: derivative and weight at every tick of each quantity of the group.
        inverse_inertia: R0, (inputs,); None: of a deflection.
        of_modes: weights of each mode's own columns, (modes, columns).
        count: of pieces.
    """

    def __init__(
        self,
        shared: PieceColumns,
        rows: list[tuple[int, Matrix]],
        inverse_inertia: Vector | None,
        of_modes: Matrix,
        count: int,
    ) -> None:
        self._shared, self._rows = shared, rows
        self._inertia, self._of_modes = inverse_inertia, of_modes
        self._ticks = len(shared.residual) // len(rows)
        self._on_columns = np.zeros((len(shared.triangular), count))
        self._on_slopes = np.zeros((shared.slopes.shape[1], count))
        self._on_residual = np.zeros(count)
        self._products = np.zeros((count, count))

    def project(self, rows: slice, pieces: slice, block: PulseBlock) -> None:
        """Add the products of some rows of the pulses with the group's columns."""
        for at, z in self._pulses(rows, block):
            self._on_columns[:, pieces] += self._shared.orthonormal[at].T @ z

    def add(self, rows: slice, pieces: slice, block: PulseBlock) -> None:
        """Add the products of some rows of the slopes, once all pulses are projected."""
        shared = self._shared
        for at, z in self._pulses(rows, block):
            slopes = -shared.orthonormal[at] @ self._on_columns
            slopes[:, pieces] += z
            self._on_slopes += shared.slopes[at].T @ slopes
            self._on_residual += shared.residual[at] @ slopes
            self._products += slopes.T @ slopes

    def products(self) -> tuple[Vector, Matrix, Matrix, Matrix]:
        """Return the slopes times residual, other slopes and themselves, and the columns in them.

        The factor Q R keeps the digits of a pulse at the beginning, which is nearly the free motion
        of another start.
        """
        along = np.asarray(solve_triangular(self._shared.triangular, self._on_columns))
        return self._on_residual, self._on_slopes, self._products, along

    def _pulses(self, rows: slice, block: PulseBlock) -> Iterator[tuple[slice, Matrix]]:
        """Yield the rows of each quantity of the group, and the weighted pulses there."""
        for k, (which, weight) in enumerate(self._rows):
            z = block.response(self._inertia, self._of_modes, which)
            z *= weight[rows] if weight.ndim > 1 else weight
            yield slice(k * self._ticks + rows.start, k * self._ticks + rows.stop), z
