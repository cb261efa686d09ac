"""What a fit of modes is linear in: responses of oscillators, the rigid motion, bias and drift."""

from dataclasses import replace

import numpy as np

from flexslew_lab.identification.oscillators import Oscillator, double_integral, times
from flexslew_lab.identification.projection import LowFrequencies
from flexslew_lab.identification.record import Record
from flexslew_plant.arrays import Matrix

_STEP = 1e-6  # relative, of the differences with respect to frequency
_DAMPING_STEP = 1e-6
_KEPT = 256  # modes whose responses are kept: those of a search, too


class RegressorSignals:
    """The signals of a record and the responses to its efforts, below a frequency.

    Args:
        record: of the experiment.
        highest: end of the band [rad/s]; None: all ticks as they are.
    """

    def __init__(self, record: Record, highest: float | None) -> None:
        self.record = record
        h, ticks = record.period, record.ticks
        self._low = None if highest is None else LowFrequencies(ticks + 1, h, highest)
        t = times(ticks, h) / record.duration
        one = np.ones_like(t)
        self.measured = self.cut(record.measured)
        self.slope = 1.0 / record.duration
        self.constant = self.cut(one[:, None])
        self.line = self.cut(np.column_stack((one, t)))
        position, rate = double_integral(record.effort, h)
        self.rigid = self.cut(position), self.cut(rate)
        self._responses: dict[Oscillator, tuple[Matrix, Matrix]] = {}
        self._slopes: dict[Oscillator, list[tuple[Matrix, Matrix]]] = {}

    def cut(self, columns: Matrix) -> Matrix:
        """Return what columns of the time domain hold below the frequency."""
        return columns if self._low is None else self._low(columns)

    def responses(self, mode: Oscillator) -> tuple[Matrix, Matrix]:
        """Return the columns of a mode: positions and rates, forced by each input, then free."""
        if self._low is None:
            return mode.responses(self.record.effort, self.record.period)
        if mode not in self._responses:
            if len(self._responses) >= _KEPT:
                del self._responses[next(iter(self._responses))]
            q, rate = self._sums(mode, self._low)
            self._responses[mode] = self._low.of_sums(q), self._low.of_sums(rate)
        return self._responses[mode]

    def slopes(self, mode: Oscillator) -> list[tuple[Matrix, Matrix]]:
        """Return the slopes of these columns by frequency and by damping ratio.

        They are needed below the frequency alone.
        """
        assert self._low is not None
        if mode not in self._slopes:
            if len(self._slopes) >= _KEPT:
                del self._slopes[next(iter(self._slopes))]
            found = []
            for ahead, behind, distance in neighbours(mode):
                (q, rate), (q_behind, rate_behind) = (
                    self._sums(one, self._low) for one in (ahead, behind)
                )
                by = (q - q_behind) / distance, (rate - rate_behind) / distance
                found.append((self._low.of_sums(by[0]), self._low.of_sums(by[1])))
            self._slopes[mode] = found
        return self._slopes[mode]

    def _sums(self, mode: Oscillator, low: LowFrequencies) -> tuple[Matrix, Matrix]:
        return mode.responses(self.record.effort, self.record.period, low.each)


def neighbours(mode: Oscillator) -> tuple[tuple[Oscillator, Oscillator, float], ...]:
    """Return the two pairs of modes whose differences are the slopes, with their distances."""
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
