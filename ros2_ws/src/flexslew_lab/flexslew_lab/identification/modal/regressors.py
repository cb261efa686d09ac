"""What a fit of modes is linear in: responses of oscillators, the rigid motion, bias and drift."""

from collections.abc import Callable
from dataclasses import replace
from itertools import accumulate, pairwise
from typing import NamedTuple, TypeAlias, TypeVar

import numpy as np
from scipy.signal import lfilter

from flexslew_lab.identification.modal.oscillators import Oscillator, double_integral
from flexslew_lab.identification.modal.projection import LowFrequencies
from flexslew_lab.identification.modal.unknown_effort import estimates
from flexslew_lab.identification.records.record import Quantity, Record
from flexslew_plant.arrays import Matrix, Vector

_STEP = 1e-6  # relative, of the differences with respect to frequency
_DAMPING_STEP = 1e-6
_BLOCK = 4096  # rows that are turned at once
_KEPT = 256  # modes with responses that are kept: those of a search, too

Orders: TypeAlias = tuple[Matrix, ...]  # of positions, rates and, if measured, accelerations
T = TypeVar("T")


class Terms(NamedTuple):
    """What an output of one order is linear in, and what was measured: columns of as many rows."""

    constant: Matrix
    line: Matrix  # constant and time
    rigid: Matrix  # of each input; of an acceleration the efforts before and after each tick
    modes: tuple[Matrix, ...]  # of each: forced by each input, free, forced in its rate (all ticks)
    slopes: tuple[Matrix, ...]  # of these by frequency and by damping ratio, mode by mode
    measured: Matrix  # of every output


class RegressorSignals:
    """The signals of a record and the responses to its efforts, below a frequency.

    Args:
        record: record of the experiment.
        highest: end of the band [rad/s]; None: all ticks as they are.
        lowest: frequency below which all is filtered away [rad/s]; 0: nothing.
        filters: that make the noise of every output white, of all ticks, shape
            (outputs, coefficients); None: it is white.
    """

    def __init__(
        self,
        record: Record,
        highest: float | None,
        lowest: float = 0.0,
        filters: Matrix | None = None,
    ) -> None:
        self.record, self.filters = record, filters
        h, ticks = record.lengths, record.ticks
        self._low = (
            None if highest is None else LowFrequencies(ticks + 1, record.period, highest, lowest)
        )
        t = record.times / record.duration
        one = np.ones_like(t)
        self.measured = self.cut(record.measured)
        self.slope = 1.0 / record.duration
        self.constant = self.cut(one[:, None])
        self.line = self.cut(np.column_stack((one, t)))
        self._accelerations = bool(record.columns(Quantity.ACCELERATION))
        rigid: Orders = double_integral(record.effort, h)
        if self._accelerations:
            u = record.effort
            rigid = (*rigid, np.hstack((np.vstack((u[:1], u)), np.vstack((u, u[-1:])))))
        self.rigid = tuple(map(self.cut, rigid))
        self._responses: dict[Oscillator, Orders] = {}
        self._slopes: dict[Oscillator, list[Orders]] = {}
        self._reduced_terms: (
            tuple[tuple[tuple[Oscillator, ...], bool], tuple[Terms, ...]] | None
        ) = None

    def cut(self, columns: Matrix) -> Matrix:
        """Return what columns of the time domain hold below the frequency."""
        return columns if self._low is None else self._low(columns)

    def whitened(self, column: int, columns: Matrix) -> Matrix:
        """Return columns as the noise filter of an output passes them, without its start."""
        if self.filters is None:
            return columns
        taps = self.filters[column]
        return np.asarray(lfilter(taps, [1.0], columns, axis=0)[len(taps) - 1 :])

    @property
    def rows(self) -> int:
        """The number of values of each output before they are turned."""
        return len(self.measured)

    def columns(self, modes: tuple[Oscillator, ...], slopes: bool = False) -> tuple[Terms, ...]:
        """Return the terms of positions, of rates and of accelerations, row by row.

        Args:
            modes: of the fit.
            slopes: whether those of the modes are needed, too.
        """
        found = [self.responses(mode) for mode in modes]
        derivatives = [pair for mode in (modes if slopes else ()) for pair in self.slopes(mode)]
        return tuple(
            Terms(
                self.constant,
                self.line,
                rigid,
                tuple(orders[k] for orders in found),
                tuple(orders[k] for orders in derivatives),
                self.measured,
            )
            for k, rigid in enumerate(self.rigid)
        )

    def with_effort_step(self, step: Vector) -> "RegressorSignals":
        """Return the signals of all ticks with other estimates of the unknown efforts.

        Args:
            step: by which they move, shape (pieces,); empty where all are known.
        """
        if not step.size:
            return self
        return RegressorSignals(self.record.with_efforts(estimates(self.record) + step), None)

    def terms(self, modes: tuple[Oscillator, ...], slopes: bool) -> tuple[Terms, ...]:
        """Return the terms for least squares: of all ticks, turned to as many rows as columns."""
        filtered = self.filters is not None  # by output, which needs the rows in their order
        if self._low is not None or filtered or not self.record.is_complete:
            return self.columns(modes, slopes)
        key = modes, slopes
        if self._reduced_terms is None or self._reduced_terms[0] != key:
            self._reduced_terms = key, tuple(map(reduce_rows, self.columns(modes, slopes)))
        return self._reduced_terms[1]

    def responses(self, mode: Oscillator) -> Orders:
        """Return the columns of a mode by order: forced by each input, then free."""
        return self._cached(self._responses, mode, self._computed)

    def slopes(self, mode: Oscillator) -> list[Orders]:
        """Return the slopes of these columns by frequency and by damping ratio."""
        return self._cached(self._slopes, mode, self._differences)

    def _cached(
        self, kept: dict[Oscillator, T], mode: Oscillator, new: Callable[[Oscillator], T]
    ) -> T:
        if self._low is None:  # too large to be kept
            return new(mode)
        if mode not in kept:
            if len(kept) >= _KEPT:
                del kept[next(iter(kept))]
            kept[mode] = new(mode)
        return kept[mode]

    def _computed(self, mode: Oscillator) -> Orders:
        return tuple(map(self._of_sums, self._sums(mode)))

    def _differences(self, mode: Oscillator) -> list[Orders]:
        found = []
        for forward, backward, distance in difference_modes(mode):
            pairs = zip(self._sums(forward), self._sums(backward), strict=True)
            found.append(tuple(self._of_sums((one - other) / distance) for one, other in pairs))
        return found

    def _sums(self, mode: Oscillator) -> Orders:
        """Return q, q' and, if measured, q'' less the effort, which the rigid columns hold."""
        effort, h = self.record.effort, self.record.lengths
        w, drag = mode.frequency, 2.0 * mode.damping_ratio * mode.frequency
        if self._low is not None:
            q, rate = mode.responses(effort, h, self._low.each)
            return (q, rate, -drag * rate - w**2 * q) if self._accelerations else (q, rate)
        q, rate = mode.responses(effort, h)
        inputs = effort.shape[1]
        orders: Orders = (q, rate, -drag * rate - w**2 * q)
        # the rates of what is forced, times w^2, less the effort, of which all modes together
        # have nothing
        forced = [one[:, :inputs] / w**2 for one in orders]
        rates = (*forced[1:], -drag * forced[2] - w**2 * forced[1])
        count = 3 if self._accelerations else 2
        return tuple(
            np.hstack((one, its)) for one, its in zip(orders[:count], rates[:count], strict=True)
        )

    def _of_sums(self, columns: Matrix) -> Matrix:
        return columns if self._low is None else self._low.of_sums(columns)


def difference_modes(mode: Oscillator) -> tuple[tuple[Oscillator, Oscillator, float], ...]:
    """Return two pairs of modes for the slopes by differences, with their distances."""
    dw, dz = _STEP * mode.frequency, _DAMPING_STEP
    return (
        (
            replace(mode, frequency=mode.frequency + dw),
            replace(mode, frequency=mode.frequency - dw),
            2.0 * dw,
        ),
        (
            replace(mode, damping_ratio=mode.damping_ratio + dz),
            replace(mode, damping_ratio=mode.damping_ratio - dz),
            2.0 * dz,
        ),
    )


def reduce_rows(terms: Terms) -> Terms:
    """Return the terms times an orthogonal matrix that leaves as many rows as columns.

    It is the triangular factor of all columns, block of rows by block (Golub and Van Loan 2013,
    5.2.3): every inner product stays, and no large matrix is ever put together.
    """
    parts = (terms.constant, terms.line, terms.rigid, *terms.modes, *terms.slopes, terms.measured)
    edges = [0, *accumulate(part.shape[1] for part in parts)]
    factor = np.zeros((0, edges[-1]))
    for first in range(0, len(terms.measured), _BLOCK):
        rows = np.hstack([part[first : first + _BLOCK] for part in parts])
        factor = np.asarray(np.linalg.qr(np.vstack((factor, rows)), mode="r"))
    constant, line, rigid, *rest = (factor[:, a:b] for a, b in pairwise(edges))
    modes = len(terms.modes)
    return Terms(constant, line, rigid, tuple(rest[:modes]), tuple(rest[modes:-1]), rest[-1])
