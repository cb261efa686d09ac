"""What a fit of modes is linear in: responses of oscillators, the rigid motion, bias and drift."""

from collections.abc import Callable
from dataclasses import replace
from itertools import accumulate, pairwise
from typing import NamedTuple, TypeAlias, TypeVar

import numpy as np

from flexslew_lab.identification.oscillators import Oscillator, double_integral
from flexslew_lab.identification.projection import LowFrequencies
from flexslew_lab.identification.record import Record
from flexslew_lab.identification.unknown_effort import estimates
from flexslew_plant.arrays import Matrix, Vector

_STEP = 1e-6  # relative, of the differences with respect to frequency
_DAMPING_STEP = 1e-6
_BLOCK = 4096  # rows that are turned at once
_KEPT = 256  # modes with responses that are kept: those of a search, too

Pair: TypeAlias = tuple[Matrix, Matrix]  # of positions and of rates
T = TypeVar("T")


class Terms(NamedTuple):
    """What a position (or a rate) is linear in, and what was measured: columns of as many rows."""

    constant: Matrix
    line: Matrix  # constant and time
    rigid: Matrix  # of each input
    modes: tuple[Matrix, ...]  # of each: forced by each input, free, forced in its rate (all ticks)
    slopes: tuple[Matrix, ...]  # of these by frequency and by damping ratio, mode by mode
    measured: Matrix  # of every output


class RegressorSignals:
    """The signals of a record and the responses to its efforts, below a frequency.

    Args:
        record: record of the experiment.
        highest: end of the band [rad/s]; None: all ticks as they are.
        lowest: frequency below which all is filtered away [rad/s]; 0: nothing.
    """

    def __init__(self, record: Record, highest: float | None, lowest: float = 0.0) -> None:
        self.record = record
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
        position, rate = double_integral(record.effort, h)
        self.rigid = self.cut(position), self.cut(rate)
        self._responses: dict[Oscillator, Pair] = {}
        self._slopes: dict[Oscillator, list[Pair]] = {}
        self._reduced_terms: (
            tuple[tuple[tuple[Oscillator, ...], bool], tuple[Terms, Terms]] | None
        ) = None

    def cut(self, columns: Matrix) -> Matrix:
        """Return what columns of the time domain hold below the frequency."""
        return columns if self._low is None else self._low(columns)

    @property
    def rows(self) -> int:
        """The number of values of each output before they are turned."""
        return len(self.measured)

    def columns(self, modes: tuple[Oscillator, ...], slopes: bool = False) -> tuple[Terms, Terms]:
        """Return the terms of positions and of rates, row by row as the signals are.

        Args:
            modes: of the fit.
            slopes: whether those of the modes are needed, too.
        """
        found = [self.responses(mode) for mode in modes]
        derivatives = [pair for mode in (modes if slopes else ()) for pair in self.slopes(mode)]
        position, rate = (
            Terms(
                self.constant,
                self.line,
                self.rigid[k],
                tuple(pair[k] for pair in found),
                tuple(pair[k] for pair in derivatives),
                self.measured,
            )
            for k in (0, 1)
        )
        return position, rate

    def with_effort_step(self, step: Vector) -> "RegressorSignals":
        """Return the signals of all ticks with other estimates of the unknown efforts.

        Args:
            step: by which they move, shape (pieces,); empty where all are known.
        """
        if not step.size:
            return self
        return RegressorSignals(self.record.with_efforts(estimates(self.record) + step), None)

    def terms(self, modes: tuple[Oscillator, ...], slopes: bool) -> tuple[Terms, Terms]:
        """Return the terms for least squares: of all ticks, turned to as many rows as columns."""
        if self._low is not None or not self.record.is_complete:
            return self.columns(modes, slopes)
        key = modes, slopes
        if self._reduced_terms is None or self._reduced_terms[0] != key:
            position, rate = self.columns(modes, slopes)
            self._reduced_terms = key, (reduce_rows(position), reduce_rows(rate))
        return self._reduced_terms[1]

    def responses(self, mode: Oscillator) -> Pair:
        """Return the columns of a mode: positions and rates, forced by each input, then free."""
        return self._cached(self._responses, mode, self._computed)

    def slopes(self, mode: Oscillator) -> list[Pair]:
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

    def _computed(self, mode: Oscillator) -> Pair:
        q, rate = self._sums(mode)
        return self._of_sums(q), self._of_sums(rate)

    def _differences(self, mode: Oscillator) -> list[Pair]:
        found = []
        for forward, backward, distance in difference_modes(mode):
            (q, rate), (q_backward, rate_backward) = self._sums(forward), self._sums(backward)
            by = (q - q_backward) / distance, (rate - rate_backward) / distance
            found.append((self._of_sums(by[0]), self._of_sums(by[1])))
        return found

    def _sums(self, mode: Oscillator) -> Pair:
        effort, h = self.record.effort, self.record.lengths
        if self._low is not None:
            return mode.responses(effort, h, self._low.each)
        q, rate = mode.responses(effort, h)
        w, inputs = mode.frequency, effort.shape[1]
        forced, derivatives = q[:, :inputs], rate[:, :inputs]  # times w^2
        # q' and q'' less the effort, of which all modes together have nothing
        acceleration = -2.0 * mode.damping_ratio / w * derivatives - forced
        return np.hstack((q, derivatives / w**2)), np.hstack((rate, acceleration))

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
