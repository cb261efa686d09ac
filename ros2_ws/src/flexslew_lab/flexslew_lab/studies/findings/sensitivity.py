"""Which of the varied values a metric depends on: Sobol indices with bootstrap bounds."""

from typing import Any, NamedTuple

import numpy as np
from scipy.stats import sobol_indices

from flexslew_plant.arrays import Vector

_RESAMPLES = 500


class Index(NamedTuple):
    """Share of a metric's variance that comes from one varied value."""

    name: str
    first: tuple[float, float, float]  # alone: low, estimate, high
    total: tuple[float, float, float]  # with all others: low, estimate, high


def indices(
    values: Vector, names: list[str], confidence: float, seed: int
) -> tuple[list[Index], str]:
    """Return the first-order and total indices of a Saltelli sample, or why there are none.

    Args:
        values: of the metric in the order of sampling: f(A), f(B), then f(A with column j of B);
            shape (n (d + 2),). NaN or inf where a trial gave none.
        names: of the d varied values.
        confidence: of the bounds.
        seed: of the bootstrap.
    """
    d = len(names)
    n = len(values) // (d + 2)
    missing = int(np.count_nonzero(~np.isfinite(values)))
    if missing:
        return [], f"{missing} of {len(values)} trials gave no number, and every one is needed"
    if np.ptp(values) <= 1e-12 * np.abs(values).max():
        return [], "the metric does not vary"
    blocks = values.reshape(d + 2, 1, n)
    parts: Any = {"f_A": blocks[0], "f_B": blocks[1], "f_AB": blocks[2:]}
    found = sobol_indices(func=parts, n=n, rng=np.random.default_rng(seed))
    spread = found.bootstrap(confidence_level=confidence, n_resamples=_RESAMPLES)
    rows = []
    for j, name in enumerate(names):
        first = spread.first_order.confidence_interval
        total = spread.total_order.confidence_interval
        rows.append(
            Index(
                name,
                _triple(first.low, found.first_order, first.high, j),
                _triple(total.low, found.total_order, total.high, j),
            )
        )
    return rows, ""


def _triple(low: Any, middle: Any, high: Any, j: int) -> tuple[float, float, float]:
    return float(np.ravel(low)[j]), float(np.ravel(middle)[j]), float(np.ravel(high)[j])
