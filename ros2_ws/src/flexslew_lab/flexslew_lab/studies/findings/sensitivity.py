"""Which of the varied values a metric depends on: Sobol indices with bootstrap bounds."""

import warnings
from typing import NamedTuple

import numpy as np
from scipy.stats import bootstrap

from flexslew_plant.arrays import Tensor, Vector

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
    if n < 2:
        return [], "one row has no scatter; give a larger n"
    if np.ptp(values) <= 1e-12 * np.abs(values).max():
        return [], "the metric does not vary"
    blocks = (values - values[: 2 * n].mean()).reshape(d + 2, n)
    estimate = _shares(blocks)
    with warnings.catch_warnings():  # of values without effect, whose resamples are all alike
        warnings.simplefilter("ignore")
        spread = bootstrap(
            [np.arange(n)],
            lambda rows, axis: _shares(blocks[:, rows]),
            n_resamples=_RESAMPLES,
            confidence_level=confidence,
            method="BCa",
            rng=np.random.default_rng(seed),
        )
    tails = [0.5 - 0.5 * confidence, 0.5 + 0.5 * confidence]
    plain = np.quantile(spread.bootstrap_distribution, tails, axis=-1)
    ends = np.array(spread.confidence_interval)
    low, high = np.where(np.isfinite(ends), ends, plain)  # percentiles where BCa has no number
    bounded = np.stack((low, estimate, high), axis=-1).tolist()
    first, total = ([tuple(triple) for triple in kind] for kind in bounded)
    return list(map(Index, names, first, total)), ""


def _shares(blocks: Tensor) -> Tensor:
    """Return first-order and total indices, shape (2, d, ...), from f(A), f(B) and each f(AB).

    S = mean(f_B (f_AB - f_A)) / V and T = mean((f_A - f_AB)^2) / 2 V (Saltelli et al., 2010).

    Args:
        blocks: shape (d + 2, ..., n).
    """
    a, b, mixed = blocks[0], blocks[1], blocks[2:]
    variance = np.var(np.stack((a, b)), axis=(0, -1))
    first = np.mean(b * (mixed - a), axis=-1)
    total = 0.5 * np.mean((a - mixed) ** 2, axis=-1)
    return np.asarray(np.stack((first, total)) / variance)
