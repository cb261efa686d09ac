"""What a sample shows of its population: every number with bounds, or with none and why.

Bounds of independent samples rest on counts alone, whatever the distribution. Sobol points and
Latin hypercubes are not independent of each other; their bounds come from independently
randomised replicates.
"""

from math import ceil, inf, log, log1p, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from flexslew_plant.arrays import Vector


class Bounds(NamedTuple):
    """An estimate with its bounds; None where the sample gives none."""

    low: float | None
    estimate: float | None
    high: float | None


def dkw_half_width(n: int, confidence: float) -> float:
    """Return how far an empirical distribution may be from the true one, anywhere.

    sqrt(ln(2 / alpha) / (2 n)): Dvoretzky, Kiefer and Wolfowitz with Massart's constant.

    Args:
        n: independent samples.
        confidence: 1 - alpha.
    """
    return sqrt(log(2.0 / (1.0 - confidence)) / (2.0 * n))


def quantile(values: Vector, q: float) -> float:
    """Return the smallest sample that a share q of all does not exceed; inf counts as largest."""
    ordered = np.sort(values)
    return float(ordered[max(ceil(q * len(ordered) - 1e-9) - 1, 0)])


def quantile_bounds(values: Vector, q: float, confidence: float) -> tuple[float, float]:
    """Return order statistics between which the q-quantile lies, each end with half of alpha.

    The number of samples not above the quantile is binomial (n, q), so X_(l) exceeds it with
    probability P(K < l). An end that no order statistic gives is -inf or inf.

    Args:
        values: independent samples, inf where larger than any number.
        q: of the quantile.
        confidence: 1 - alpha.
    """
    ordered, n = np.sort(values), len(values)
    share = 0.5 * (1.0 - confidence)
    low = int(stats.binom.ppf(share, n, q))  # the largest l with P(K < l) <= share
    if stats.binom.cdf(low - 1, n, q) > share:
        low -= 1
    high = int(stats.binom.ppf(1.0 - share, n, q)) + 1  # the smallest h with P(K >= h) <= share
    return (
        float(ordered[low - 1]) if low >= 1 else -inf,
        float(ordered[high - 1]) if high <= n else inf,
    )


def success_bound(successes: int, n: int, confidence: float) -> float:
    """Return the lower bound of a success probability (Clopper and Pearson, one side).

    Args:
        successes: of n independent trials.
        n: at least 1.
        confidence: that the probability is not below.
    """
    return float(stats.beta.ppf(1.0 - confidence, successes, n - successes + 1)) if successes else 0


def trials_needed(probability: float, confidence: float, failures: int = 0) -> int:
    """Return how many trials with this many failures show a success probability.

    The smallest n with P(at most `failures` of n fail) <= 1 - confidence at that probability.
    852 for 99.73 % at 90 % without a failure.
    """
    if failures == 0:
        return ceil(log1p(-confidence) / log(probability) - 1e-12)
    low = high = failures + 1
    while stats.binom.cdf(failures, high, 1.0 - probability) > 1.0 - confidence:
        low, high = high, 2 * high
    while low < high:
        middle = (low + high) // 2
        if stats.binom.cdf(failures, middle, 1.0 - probability) > 1.0 - confidence:
            low = middle + 1
        else:
            high = middle
    return high


def replicate_bounds(estimates: Vector, confidence: float) -> tuple[float, float]:
    """Return the bounds of a mean from independent estimates, with Student's t.

    Args:
        estimates: one a replicate, at least two; with an inf among them there are no bounds.
        confidence: two-sided.
    """
    count = len(estimates)
    if count < 2 or not np.isfinite(estimates).all():
        return -inf, inf
    width = stats.t.ppf(0.5 + 0.5 * confidence, count - 1) * np.std(estimates, ddof=1)
    middle = float(np.mean(estimates))
    return middle - float(width) / sqrt(count), middle + float(width) / sqrt(count)


class Population:
    """Samples of one number with what is known of their dependence.

    Args:
        values: inf where a trial failed or the number is larger than any, shape (n,).
        parts: the replicate of each sample, shape (n,); None: the samples are independent.
        bounded: False: neither independent nor replicated, so that nothing has bounds.
    """

    def __init__(
        self, values: Vector, parts: NDArray[np.int32] | None = None, bounded: bool = True
    ) -> None:
        self.values = values
        self._bounded = bounded
        self._rows: list[NDArray[np.int64]] = []  # of each replicate
        if parts is not None:
            self._rows = [np.flatnonzero(parts == k) for k in np.unique(parts)]
            self._bounded = bounded and len(self._rows) > 1

    def quantile(self, q: float, confidence: float) -> Bounds:
        """Return the q-quantile with its bounds."""
        if not len(self.values):
            return Bounds(None, None, None)
        low, high = -inf, inf
        if self._bounded and self._rows:
            each = np.array([quantile(self.values[rows], q) for rows in self._rows])
            low, high = replicate_bounds(each, confidence)
        elif self._bounded:
            low, high = quantile_bounds(self.values, q, confidence)
        return _bounds(low, quantile(self.values, q), high)

    def mean(self, confidence: float) -> Bounds:
        """Return the mean with its bounds: Student's t on the samples or on the replicates."""
        if not len(self.values):
            return Bounds(None, None, None)
        low, high = -inf, inf
        if self._bounded:
            each = [float(np.mean(self.values[rows])) for rows in self._rows]
            low, high = replicate_bounds(np.array(each) if each else self.values, confidence)
        return _bounds(low, float(np.mean(self.values)), high)

    def success(self, kept: NDArray[np.bool_], confidence: float) -> Bounds:
        """Return the share of samples that kept to a criterion with its lower bound.

        From replicates, the lower end of Student's t on their shares, and never more than as many
        independent samples would show: replicates that all succeed differ in nothing.

        Args:
            kept: which samples did, shape (n,).
            confidence: of the lower bound.
        """
        if not len(kept):
            return Bounds(None, None, None)
        successes = int(np.count_nonzero(kept))
        if not self._bounded:
            return Bounds(None, successes / len(kept), None)
        low = success_bound(successes, len(kept), confidence)
        if self._rows:
            shares = np.array([float(np.mean(kept[rows])) for rows in self._rows])
            low = min(low, replicate_bounds(shares, 2.0 * confidence - 1.0)[0])
        return Bounds(max(low, 0.0), successes / len(kept), None)


def _bounds(low: float, estimate: float, high: float) -> Bounds:
    def shown(value: float) -> float | None:
        return float(value) if np.isfinite(value) else None

    return Bounds(shown(low), shown(estimate), shown(high))
