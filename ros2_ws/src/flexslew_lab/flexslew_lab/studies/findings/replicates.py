"""Bounds from independently randomised replicates, which account for the evenness of the samples.

Sobol points and Latin hypercubes are not independent of each other, but their replicates are. At
any threshold each replicate has an unbiased share of samples up to it, and the scatter of these
shares shows how well the distribution is known there. A replicate's own quantile is biased where
it has few samples beyond, so no quantile of a replicate is used.
"""

from functools import lru_cache
from math import ceil, floor, hypot, inf, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from flexslew_lab.studies.findings.statistics import quantile, quantile_ranks
from flexslew_plant.arrays import Vector

MARGIN = 0.1  # of the error, kept back because sums of a few replicates are only nearly normal
MIN_EXPECTED = (
    8.0  # expected samples on a side of a quantile, below which their scatter proves no evenness
)


class Scatter(NamedTuple):
    """The mean of some numbers, and how well replicates know it."""

    mean: float
    error: float  # standard error of the mean
    replicates: int

    def margin(self, confidence: float) -> float:
        """Return the half width of two-sided bounds of the mean, by Student's t."""
        upper = 0.5 + 0.5 * _with_margin(confidence)
        return float(special.stdtrit(self.replicates - 1, upper)) * self.error


def scatter(values: Vector, parts: NDArray[np.int64]) -> Scatter:
    """Return mean and standard error of finite numbers from the sums of their replicates.

    s^2 = R / (R - 1) sum_k (S_k - n_k S / n)^2, the ratio estimate (Cochran, Sampling Techniques,
    1977, eq. 6.13), so that replicates may lack samples.

    Args:
        values: shape (n,).
        parts: the replicate of each, 0 to R - 1, R at least 2, shape (n,).
    """
    sizes = np.bincount(parts)
    sums = np.bincount(parts, weights=values)
    mean = float(np.sum(sums) / len(values))
    count = len(sizes)
    square = float(np.sum((sums - sizes * mean) ** 2)) * count / (count - 1)
    return Scatter(mean, sqrt(square) / len(values), count)


def quantile_bounds(
    values: Vector, parts: NDArray[np.int64], q: float, confidence: float
) -> tuple[float, float]:
    """Return bounds of the q-quantile from the scatter of the replicates at its estimate.

    The ranks that bound the quantile of independent samples (binomial, as real numbers) move
    towards n q + 1/2 by the ratio of the shares' standard error to sqrt(q (1 - q) / n), times t / z
    because it is estimated (Woodruff, J. Am. Stat. Assoc. 47, 1952, with replicates). The variance
    of the count of samples up to the quantile is raised by 1: where the quantile is on the edge
    of a stratum, counts differ so rarely that a few replicates may all agree by chance. The place
    of the quantile between two samples adds (1 - alpha) / 2 of a gap to each side. Where fewer than
    FEW samples are expected on a side of the quantile, the ranks never come closer than those of
    independent samples, and are whole.

    Args:
        values: inf where larger than any number, -inf where smaller, shape (n,).
        parts: the replicate of each, 0 to R - 1, R at least 2, shape (n,).
        q: share of the quantile.
        confidence: 1 - alpha.
    """
    ordered, n = np.sort(values), len(values)
    estimate = quantile(values, q)
    share = scatter((values <= estimate).astype(np.float64), parts)
    if np.isinf(estimate) or np.count_nonzero(values == estimate) > 1:  # on a step: of both sides
        before = scatter((values < estimate).astype(np.float64), parts)
        share = max(share, before, key=lambda side: side.error)
    share = share._replace(error=hypot(share.error, 1.0 / n))
    t_margin = share.margin(confidence)
    confidence = _with_margin(confidence)
    normal = float(special.ndtri(0.5 + 0.5 * confidence)) * sqrt(q * (1.0 - q) / n)
    ratio = t_margin / normal  # of margins, to that of independent samples
    middle, gap = n * q + 0.5, 0.5 * confidence
    if n * min(q, 1.0 - q) < MIN_EXPECTED:
        first, last = quantile_ranks(n, q, confidence)
        ratio = max(ratio, 1.0)
        below: float = floor(middle - ratio * (middle - first)) if first >= 1 else 0
        above: float = ceil(middle + ratio * (last - middle)) if last <= n else n + 1
    else:
        low, high = _real_ranks(n, q, confidence)
        below = middle - hypot(ratio * (middle - low), gap)
        above = middle + hypot(ratio * (high - middle), gap)
    return (
        min(_interpolate(ordered, below, -1), estimate),
        max(_interpolate(ordered, above, 1), estimate),
    )


def _with_margin(confidence: float) -> float:
    return 1.0 - (1.0 - MARGIN) * (1.0 - confidence)


@lru_cache(maxsize=256)
def _real_ranks(n: int, q: float, confidence: float) -> tuple[float, float]:
    """Return the ranks of quantile_ranks as real numbers: P(K < l) = P(K >= h) = alpha / 2."""
    share = 0.5 * (1.0 - confidence)
    return (
        float(special.bdtrik(share, n, q)) + 1.0,
        float(special.bdtrik(1.0 - share, n, q)) + 1.0,
    )


def _interpolate(ordered: Vector, rank: float, side: int) -> float:
    """Return the sample of a rank from 1 to n, interpolated; next to an infinity the outer one."""
    if not 1.0 <= rank <= len(ordered):
        return side * inf
    whole = floor(rank)
    first = float(ordered[whole - 1])
    if rank == whole:
        return first
    second = float(ordered[whole])
    if not np.isfinite([first, second]).all():
        return second if side > 0 else first
    return first + (rank - whole) * (second - first)
