"""Times of the steps of a run in bounded memory: median, 99 %, extremes and jitter."""

from math import exp, inf, log, sqrt
from typing import NamedTuple

import numpy as np

_LEAST, _MOST = 1e-7, 1e3  # of the bins [s]
_GROWTH = log(1.01)  # of a bin against the one before it


class TimeSummary(NamedTuple):
    """Summary of some times [s]; the quantiles are exact to 1 %."""

    steps: int
    least: float
    median: float
    late: float  # 99 % are at most as long
    longest: float
    jitter: float  # standard deviation

    def __str__(self) -> str:
        """Return it in milliseconds."""
        numbers = (1e3 * value for value in self[1:])
        least, median, late, longest, jitter = (f"{value:.3f} ms" for value in numbers)
        return (
            f"{self.steps} steps: shortest {least}, median {median}, 99 % {late}, "
            f"longest {longest}, jitter {jitter}"
        )


class StepTimes:
    """Histogram with bins of 1 %, with the exact mean, variance (Welford 1962) and extremes."""

    def __init__(self) -> None:
        self._bins = [0] * (int(log(_MOST / _LEAST) / _GROWTH) + 1)
        self._count, self._mean, self._squares = 0, 0.0, 0.0
        self._least, self._longest = inf, 0.0

    def add(self, seconds: float) -> None:
        """Count a time [s]."""
        place = int(log(min(max(seconds, _LEAST), _MOST) / _LEAST) / _GROWTH)
        self._bins[place] += 1
        self._count += 1
        change = seconds - self._mean
        self._mean += change / self._count
        self._squares += change * (seconds - self._mean)
        self._least = min(self._least, seconds)
        self._longest = max(self._longest, seconds)

    def summary(self) -> TimeSummary | None:
        """Return the summary; None: no time was counted."""
        if not self._count:
            return None
        median, late = (self._quantile(share) for share in (0.5, 0.99))
        jitter = sqrt(self._squares / self._count)
        return TimeSummary(self._count, self._least, median, late, self._longest, jitter)

    def summary_of_power(self, least: int) -> TimeSummary | None:
        """Return the summary after `least`, 2 `least`, 4 `least`, ... times, else None."""
        factor, rest = divmod(self._count, least)
        return self.summary() if factor and not rest and not factor & (factor - 1) else None

    def _quantile(self, share: float) -> float:
        """Return the middle of the bin in which a share of all times is reached [s]."""
        place = int(np.searchsorted(np.cumsum(self._bins), share * self._count))
        middle = _LEAST * exp((place + 0.5) * _GROWTH)
        return min(max(middle, self._least), self._longest)
