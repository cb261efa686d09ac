"""Bounds from independent samples that rest on counts alone and hold for any distribution."""

from functools import lru_cache
from math import ceil, inf, log, log1p, sqrt

import numpy as np
from scipy import special, stats

from flexslew_plant.arrays import Vector


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


@lru_cache(maxsize=256)
def quantile_ranks(n: int, q: float, confidence: float) -> tuple[int, int]:
    """Return the ranks l and h of the samples that bound the q-quantile, counted from 1.

    The number of samples not above the quantile is binomial (n, q), so X_(l) exceeds it with
    probability P(K < l): l is the largest and h the smallest rank that leaves at most half of alpha
    outside. Rank 0 or n + 1: no sample bounds that end.

    Args:
        n: number of independent samples.
        q: share of the quantile.
        confidence: 1 - alpha.
    """
    share = 0.5 * (1.0 - confidence)
    low = int(stats.binom.ppf(share, n, q))  # the largest l with P(K < l) <= share
    if stats.binom.cdf(low - 1, n, q) > share:
        low -= 1
    high = int(stats.binom.ppf(1.0 - share, n, q)) + 1  # the smallest h with P(K >= h) <= share
    return max(low, 0), min(high, n + 1)


def quantile_bounds(values: Vector, q: float, confidence: float) -> tuple[float, float]:
    """Return the samples that bound the q-quantile; -inf or inf where none does.

    Args:
        values: independent samples, inf where larger than any number.
        q: share of the quantile.
        confidence: see quantile_ranks.
    """
    low, high = quantile_ranks(len(values), q, confidence)
    ordered = np.concatenate(([-inf], np.sort(values), [inf]))
    return float(ordered[low]), float(ordered[high])


def mean_bounds(values: Vector, confidence: float) -> tuple[float, float]:
    """Return the bounds of the mean, by Student's t: none for one sample, or with an inf.

    It holds for numbers that are spread like a normal distribution, and for others nearly, the
    better the more samples there are and the less skewed they are.

    Args:
        values: independent samples.
        confidence: two-sided.
    """
    n = len(values)
    if n < 2 or not np.isfinite(values).all():
        return -inf, inf
    margin = special.stdtrit(n - 1, 0.5 + 0.5 * confidence) * np.std(values, ddof=1) / sqrt(n)
    middle = float(np.mean(values))
    return middle - float(margin), middle + float(margin)


def success_bounds(successes: int, n: int, confidence: float) -> tuple[float, float]:
    """Return the lower and the upper bound of a success probability (Clopper and Pearson).

    Args:
        successes: of n independent trials.
        n: at least 1.
        confidence: of each bound alone.
    """
    failures = n - successes
    low = special.betaincinv(successes, failures + 1, 1.0 - confidence) if successes else 0.0
    high = special.betaincinv(successes + 1, failures, confidence) if failures else 1.0
    return float(low), float(high)


def sign_test(positive: int, negative: int) -> float:
    """Return how likely two equal alternatives split at least so unevenly, both ways (exact).

    Args:
        positive: independent pairs with the larger number on one side.
        negative: those with the smaller one there; pairs without a difference are left out.
    """
    n = positive + negative
    return float(min(1.0, 2.0 * special.bdtr(min(positive, negative), n, 0.5))) if n else 1.0


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
