"""Samples of one number with what is known of their dependence: each figure with its bounds."""

from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from flexslew_lab.studies.findings import replicates, statistics
from flexslew_plant.arrays import Vector


class Bounds(NamedTuple):
    """An estimate with its bounds; None where the sample gives none."""

    low: float | None
    estimate: float | None
    high: float | None


class Population:
    """Samples of one number.

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
        self._parts: NDArray[np.int64] | None = None  # 0 to R - 1
        if parts is not None:
            found, self._parts = np.unique(parts, return_inverse=True)
            self._bounded = bounded and len(found) > 1

    def quantile(self, q: float, confidence: float) -> Bounds:
        """Return the q-quantile with its bounds."""
        if not len(self.values):
            return Bounds(None, None, None)
        low, high = -inf, inf
        if self._bounded and self._parts is not None:
            low, high = replicates.quantile_bounds(self.values, self._parts, q, confidence)
        elif self._bounded:
            low, high = statistics.quantile_bounds(self.values, q, confidence)
        return _bounds(low, statistics.quantile(self.values, q), high)

    def mean(self, confidence: float) -> Bounds:
        """Return the mean with its bounds by Student's t, on the samples or on the replicates."""
        if not np.isfinite(self.values).all() or not len(self.values):
            return Bounds(None, None, None)
        low, high = -inf, inf
        # a power of two, by which sums and squares are finite, and above zero, in any unit
        unit = 2.0 ** (np.frexp(np.abs(self.values).max())[1] - 1)
        values = self.values / unit
        mean = float(np.mean(values))
        if self._bounded and self._parts is not None:
            margin = replicates.scatter(values, self._parts).margin(confidence)
            low, high = mean - margin, mean + margin
        elif self._bounded:
            low, high = statistics.mean_bounds(values, confidence)
        return _bounds(*(float(end) * unit for end in (low, mean, high)))

    def success(self, kept: NDArray[np.bool_], confidence: float) -> Bounds:
        """Return the share of samples that kept to a criterion, each bound with the confidence.

        From replicates, Student's t on their shares, and never narrower than as many independent
        samples would show: replicates that all succeed differ in nothing.

        Args:
            kept: which samples did, shape (n,).
            confidence: of each bound alone.
        """
        if not len(kept):
            return Bounds(None, None, None)
        share = float(np.mean(kept))
        if not self._bounded:
            return Bounds(None, share, None)
        low, high = statistics.success_bounds(int(np.count_nonzero(kept)), len(kept), confidence)
        if self._parts is not None:
            found = replicates.scatter(kept.astype(np.float64), self._parts)
            margin = found.margin(2.0 * confidence - 1.0)
            low, high = min(low, share - margin), max(high, share + margin)
        return Bounds(max(low, 0.0), share, min(high, 1.0))

    def sign_p_value(self) -> float | None:
        """Return the p-value of positive and negative numbers being equally likely.

        The exact sign test assumes only that samples are independent: not that they are symmetric,
        as Wilcoxon's does, nor that they are finite. From replicates, Student's t on their mean
        signs, and never a smaller value than that of independent samples.
        """
        if not self._bounded or not len(self.values):
            return None
        signs = np.sign(self.values)
        p_value = statistics.sign_test(int((signs > 0.0).sum()), int((signs < 0.0).sum()))
        if self._parts is None:
            return p_value
        found = replicates.scatter(signs, self._parts)
        if found.error == 0.0:  # the replicates agree
            return p_value
        t_test = 2.0 * special.stdtr(found.replicates - 1, -abs(found.mean) / found.error)
        return max(p_value, float(t_test))


def _bounds(low: float, estimate: float, high: float) -> Bounds:
    def finite_or_none(value: float) -> float | None:
        return float(value) if np.isfinite(value) else None

    return Bounds(finite_or_none(low), finite_or_none(estimate), finite_or_none(high))
