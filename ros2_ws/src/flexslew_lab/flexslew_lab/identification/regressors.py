"""What a fit of modes is linear in: responses of oscillators, the rigid motion, bias and drift."""

from dataclasses import replace

import numpy as np

from flexslew_lab.identification.oscillators import Oscillator, double_integral, times
from flexslew_lab.identification.projection import LowFrequencies
from flexslew_lab.identification.record import Record
from flexslew_plant.arrays import Matrix

_STEP = 1e-6  # relative, of the differences with respect to frequency
_DAMPING_STEP = 1e-6
_KEPT = 64  # modes whose responses are kept


class Signals:
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
        if mode not in self._responses:
            found = responses_in_time(mode, self.record.effort, self.record.period)
            if self._low is None:
                return found
            if len(self._responses) >= _KEPT:
                del self._responses[next(iter(self._responses))]
            self._responses[mode] = self.cut(found[0]), self.cut(found[1])
        return self._responses[mode]

    def slopes(self, mode: Oscillator) -> list[tuple[Matrix, Matrix]]:
        """Return the slopes of these columns by frequency and by damping ratio."""
        if mode not in self._slopes:
            if len(self._slopes) >= _KEPT:
                del self._slopes[next(iter(self._slopes))]
            found = []
            for pair in neighbours(mode):
                by = difference_in_time(self.record.effort, self.record.period, pair)
                found.append((self.cut(by[0]), self.cut(by[1])))
            self._slopes[mode] = found
        return self._slopes[mode]


def responses_in_time(mode: Oscillator, effort: Matrix, h: float) -> tuple[Matrix, Matrix]:
    """Return the columns of a mode: positions and rates, forced by each input, then free."""
    forced, free = mode.forced(effort, h), mode.free(len(effort), h)
    w = mode.frequency
    size = np.array([1.0, w])  # a start of 1 and of w: columns of one size
    return (
        np.hstack((forced[0] * w * w, free[0] * size)),
        np.hstack((forced[1] * w * w, free[1] * size)),
    )


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


def difference_in_time(
    effort: Matrix, h: float, pair: tuple[Oscillator, Oscillator, float]
) -> tuple[Matrix, Matrix]:
    """Return the slope of the columns of a mode."""
    ahead, behind = (responses_in_time(one, effort, h) for one in pair[:2])
    return (ahead[0] - behind[0]) / pair[2], (ahead[1] - behind[1]) / pair[2]
