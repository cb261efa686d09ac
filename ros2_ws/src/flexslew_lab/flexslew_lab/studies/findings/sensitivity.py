"""Which of the varied values a metric depends on: Sobol indices with bounds."""

import warnings
from typing import NamedTuple

import numpy as np
from scipy.stats import bootstrap, t

from flexslew_plant.arrays import Tensor, Vector

_RESAMPLES = 500


class Index(NamedTuple):
    """Share of a metric's variance that comes from one varied value."""

    name: str
    first: tuple[float, float, float]  # alone: low, estimate, high
    total: tuple[float, float, float]  # with all others: low, estimate, high


def indices(
    values: Vector, names: list[str], confidence: float, seed: int, replicates: int = 1
) -> tuple[list[Index], str]:
    """Return the first-order and total indices of a Saltelli sample, or why there are none.

    Args:
        values: of the metric in the order of sampling: f(A), f(B), then f(A with column j of B);
            shape (n (d + 2),). NaN or inf where a trial gave none.
        names: of the d varied values.
        confidence: of the bounds.
        seed: of the bootstrap.
        replicates: independently randomised parts of the rows, one after another.
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
    scaled = values / np.abs(values).max()  # with finite squares in any unit
    blocks = (scaled - scaled[: 2 * n].mean()).reshape(d + 2, n)
    if replicates > 1:
        return _indices(names, *_replicate_indices(blocks, replicates, confidence)), ""
    estimate = _sobol_indices(blocks)
    with warnings.catch_warnings():  # of values without effect: equal resamples
        warnings.simplefilter("ignore")
        spread = bootstrap(
            [np.arange(n)],
            lambda rows, axis: _sobol_indices(blocks[:, rows]),
            n_resamples=_RESAMPLES,
            confidence_level=confidence,
            method="BCa",
            rng=np.random.default_rng(seed),
        )
    levels = [0.5 - 0.5 * confidence, 0.5 + 0.5 * confidence]
    plain = np.quantile(spread.bootstrap_distribution, levels, axis=-1)
    ends = np.array(spread.confidence_interval)
    low, high = np.where(np.isfinite(ends), ends, plain)  # percentiles where BCa has no number
    return _indices(names, low, estimate, high), ""


def _indices(names: list[str], low: Tensor, estimate: Tensor, high: Tensor) -> list[Index]:
    bounded = np.stack((low, estimate, high), axis=-1).tolist()
    first, total = ([tuple(triple) for triple in kind] for kind in bounded)
    return list(map(Index, names, first, total))


def _replicate_indices(
    blocks: Tensor, count: int, confidence: float
) -> tuple[Tensor, Tensor, Tensor]:
    """Return low, estimate and high of the indices, shape (2, d) each.

    An index is the ratio of two means over the replicates; to first order its error is that of the
    mean of their N - S V, over V (Cochran, Sampling Techniques, 1977, ch. 6): Student's t.
    """
    parts = blocks.reshape(len(blocks), count, -1)
    terms, squares = _terms(parts), 0.5 * np.mean(parts[0] ** 2 + parts[1] ** 2, axis=-1)
    estimate = terms.mean(axis=-1) / squares.mean()
    left = terms - estimate[..., None] * squares
    error = left.std(axis=-1, ddof=1) / np.sqrt(count) / squares.mean()
    reach = t.ppf(0.5 + 0.5 * confidence, count - 1) * error
    return estimate - reach, estimate, estimate + reach


def _terms(blocks: Tensor) -> Tensor:
    """Return what is S V and T V of f(A), f(B) and each f(AB), shape (2, d, ...).

    S V = mean(f_B (f_AB - f_A)) and T V = mean((f_A - f_AB)^2) / 2 (Saltelli et al., 2010).

    Args:
        blocks: shape (d + 2, ..., n).
    """
    a, b, mixed = blocks[0], blocks[1], blocks[2:]
    first = np.mean(b * (mixed - a), axis=-1)
    total = 0.5 * np.mean((a - mixed) ** 2, axis=-1)
    return np.stack((first, total))


def _sobol_indices(blocks: Tensor) -> Tensor:
    """Return first-order and total indices, shape (2, d, ...); see _terms."""
    variance = np.var(blocks[:2], axis=(0, -1))
    return np.asarray(_terms(blocks) / variance)
