"""A campaign: how often the stated bounds of studies hold, over synthetic studies.

Run it to print the whole matrix: every way of sampling that has bounds, 64 to 4,096 samples, and
smooth, noisy and failing metrics. A row shows the shares of studies whose bounds hold the true
median, 90 % and 99 % quantile, with the share of studies that bound both ends in brackets; then
those whose bounds hold the true mean, and those whose lower and upper bound hold the probability
of success.

    python benchmarks/study_bounds.py --studies 2000 --n 64 256 1024 4096
"""

import argparse
from collections.abc import Callable
from functools import cache, lru_cache
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.stats import qmc

from flexslew_lab.studies.findings.population import Bounds, Population
from flexslew_lab.studies.sampling.distributions import Distribution
from flexslew_lab.studies.sampling.methods import METHODS, Samples, Sampling, draw_samples
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.settings import validated

CONFIDENCE = 0.9
QUANTILES = (0.5, 0.9, 0.99)
SAMPLED = tuple(name for name, m in METHODS.items() if m.independent or m.replicated)
SIZES = (64, 128, 256, 512, 1024, 2048, 4096)
_UNIT = Distribution("uniform", (0.0, 1.0))
_TRUTH = 2**18  # Sobol points: the distribution is known to 1e-5 or so
_MOST_VARIED, _MOST_NOISE = 5, 1


class Metric(NamedTuple):
    """A number of a trial as a function of the unit cube."""

    varied: int  # values that the study draws
    noise: int  # values that each trial draws for itself
    value: Callable[[Matrix], Vector]  # of varied and noise together
    continuous: bool = True  # on steps no bounds can be close


class Cell(NamedTuple):
    """What became of the bounds of many studies."""

    covered: Vector  # share of studies whose bounds hold each quantile, shape (3,)
    bounded: Vector  # share that bounds it on both sides, shape (3,)
    covered_if_bounded: Vector  # share of these that hold it; NaN without any, shape (3,)
    mean: float  # share whose bounds hold the mean; NaN where it has no value
    success: tuple[float, float]  # shares whose lower and upper bound hold, at each bound alone
    disordered: int  # bounds that are not in order, or leave out their estimate


def _bent(u: Matrix) -> Vector:
    return np.asarray(np.sin(3.0 * u[:, 0]) + u[:, 1] ** 2 * u[:, 2] + 0.3 * u[:, 2])


def _plane(u: Matrix) -> Vector:
    return np.asarray(u[:, 0] + 0.6 * u[:, 1])


def _corner(u: Matrix) -> Vector:
    return np.asarray(np.abs(u - 0.5).max(axis=1) + 0.2 * np.abs(u[:, 0] - 0.3))


def _resonance(u: Matrix) -> Vector:
    """Return the gain of an oscillator near its resonance."""
    ratio, damping = 0.8 + 0.4 * u[:, 0], 0.005 + 0.02 * u[:, 1]
    return np.asarray(1.0 / np.hypot(1.0 - ratio**2, 2.0 * damping))


def _edge(u: Matrix) -> Vector:
    """Return a distance whose median lies just beyond an edge of the strata of every size."""
    return np.asarray(-np.abs(u[:, 0] - 0.5 + 0.32 / 1024.0))


def _largest(u: Matrix) -> Vector:
    """Return the largest of three responses, as a worst case of several appendages is."""
    return np.asarray(np.max([np.exp(u[:, 0]), 1.0 + u[:, 1], 3.0 - 3.0 * u[:, 2]], axis=0))


def _residual(u: Matrix) -> Vector:
    """Return what a shaper of one frequency leaves of an oscillation of another."""
    return np.asarray((1.0 + 0.2 * u[:, 1]) * np.abs(np.cos(np.pi * (0.2 + 1.1 * u[:, 0]))))


def _failing(values: Vector, failed: NDArray[np.bool_]) -> Vector:
    return np.where(failed, inf, values)


METRICS: dict[str, Metric] = {
    "one value": Metric(1, 0, lambda u: np.exp(2.0 * u[:, 0])),
    "plane": Metric(2, 0, _plane),
    "bent": Metric(3, 0, _bent),
    "corner": Metric(4, 0, _corner),
    "product": Metric(5, 0, lambda u: np.exp((u - 0.5) @ np.array([2.0, 1.5, 1.0, 0.5, 0.3]))),
    "peak": Metric(2, 0, lambda u: 1.0 / (1.0 + 100.0 * (u[:, 0] - 0.37) ** 2) + 0.1 * u[:, 1]),
    "resonance": Metric(2, 0, _resonance),
    "edge": Metric(1, 0, _edge),
    "kinked": Metric(2, 0, lambda u: np.abs(u[:, 0] - 0.3) + 0.5 * np.abs(u[:, 1] - 0.6)),
    "largest": Metric(3, 0, _largest),
    "residual": Metric(2, 0, _residual),
    "oscillating": Metric(1, 0, lambda u: np.sin(40.0 * u[:, 0])),
    "beating": Metric(2, 0, lambda u: np.sin(20.0 * u[:, 0]) + np.sin(23.0 * u[:, 1])),
    "noisy": Metric(2, 1, lambda u: _plane(u) + 0.2 * stats.norm.ppf(u[:, 2])),
    "noise": Metric(2, 1, lambda u: -np.log1p(-u[:, 2])),
    "fails in a region": Metric(3, 0, lambda u: _failing(_bent(u), u[:, :2].min(axis=1) > 0.78)),
    "fails at random": Metric(3, 1, lambda u: _failing(_bent(u), u[:, 3] < 0.03)),
    "fails rarely": Metric(3, 1, lambda u: _failing(_bent(u), u[:, 3] < 0.009)),
    "steps": Metric(2, 0, lambda u: np.round(4.0 * _plane(u)), continuous=False),
}


@cache
def truth(name: str) -> tuple[Vector, float]:
    """Return the true quantiles, shape (3,), and the true mean (inf if trials fail) of a metric."""
    metric = METRICS[name]
    points = qmc.Sobol(metric.varied + metric.noise, rng=np.random.default_rng(1)).random(_TRUTH)
    values = np.sort(metric.value(points))
    places = [round(q * _TRUTH) for q in QUANTILES]
    return values[places], float(np.mean(values))


def study(method: str, n: int, name: str, seed: int) -> Population:
    """Return what a synthetic study of a metric finds."""
    metric = METRICS[name]
    samples, noise = _design(method, n, seed)
    values = metric.value(np.hstack((samples.unit[:, : metric.varied], noise[:, : metric.noise])))
    return Population(values, samples.replicate if METHODS[method].replicated else None)


def cell(method: str, n: int, name: str, studies: int, seed: int = 0) -> Cell:
    """Return how often the bounds of synthetic studies hold.

    Args:
        method: of sampling.
        n: samples a study.
        name: of the metric.
        studies: how many.
        seed: of the first one.
    """
    quantiles, mean = truth(name)
    limit = quantiles[1]  # a criterion that nine of ten trials keep to
    kept = float(np.mean(_values(name) <= limit))
    holds, both = np.zeros((studies, 3), dtype=bool), np.zeros((studies, 3), dtype=bool)
    means, success, disordered = 0, np.zeros(2), 0
    for k in range(studies):
        found = study(method, n, name, seed + k)
        for j, q in enumerate(QUANTILES):
            bounds = found.quantile(q, CONFIDENCE)
            disordered += not _ordered(bounds)
            holds[k, j] = _holds(bounds, float(quantiles[j]))
            both[k, j] = bounds.low is not None and bounds.high is not None
        if np.isfinite(mean):
            means += _holds(found.mean(CONFIDENCE), mean)
        share = found.success(found.values <= limit, CONFIDENCE)
        disordered += not _ordered(share)
        assert share.low is not None
        assert share.high is not None
        success += (share.low <= kept, kept <= share.high)
    counts = both.sum(axis=0)
    inside = np.where(counts > 0, (holds & both).sum(axis=0) / np.maximum(counts, 1), np.nan)
    return Cell(
        holds.mean(axis=0),
        both.mean(axis=0),
        inside,
        means / studies if np.isfinite(mean) else np.nan,
        (float(success[0]) / studies, float(success[1]) / studies),
        disordered,
    )


def figures() -> dict[str, float]:
    """Return the smallest and largest coverage of each way of sampling, of a stated 90 %."""
    found: dict[str, float] = {}
    for method in SAMPLED:
        cells = [cell(method, 1024, name, 200) for name, m in METRICS.items() if m.continuous]
        shares = np.array([one.covered_if_bounded for one in cells])
        found[f"study_bounds_{method}_least_share"] = float(np.nanmin(shares))
        found[f"study_bounds_{method}_largest_share"] = float(np.nanmax(shares))
    return found


def line(method: str, n: int, name: str, one: Cell) -> str:
    """Return a row of the table."""
    shares = "  ".join(f"{c:.3f} ({b:.2f})" for c, b in zip(one.covered, one.bounded, strict=True))
    low, high = one.success
    return (
        f"{method:6} {n:6} {name:18} {shares}  {one.mean:.3f} {low:.3f} {high:.3f}"
        f"{'  DISORDERED' if one.disordered else ''}"
    )


@lru_cache(maxsize=2000)  # all metrics are looked at on the same samples
def _design(method: str, n: int, seed: int) -> tuple[Samples, Matrix]:
    sampling: Sampling = validated(Sampling, {"method": method, "n": n}, "campaign")
    noise = np.random.default_rng((seed, 1)).random((n, _MOST_NOISE))
    return draw_samples(sampling, [_UNIT] * _MOST_VARIED, seed), noise


@cache
def _values(name: str) -> Vector:
    metric = METRICS[name]
    points = qmc.Sobol(metric.varied + metric.noise, rng=np.random.default_rng(2)).random(_TRUTH)
    return metric.value(points)


def _holds(bounds: Bounds, true: float) -> bool:
    """Return whether bounds hold a number; a bound beyond any number is None on that side."""
    low, estimate, high = bounds
    if low is None and estimate is None and high is None:
        return True  # wholly among the failures, nothing is claimed
    return (low is None or low <= true) and (high is None or true <= high)


def _ordered(bounds: Bounds) -> bool:
    low, estimate, high = bounds
    if estimate is None:
        return high is None
    return (low is None or low <= estimate) and (high is None or estimate <= high)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=int, default=2000)
    parser.add_argument("--n", type=int, nargs="+", default=SIZES)
    parser.add_argument("--methods", nargs="+", default=SAMPLED)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    print(
        "method      n metric             median        90 %          99 %          mean  success"
    )
    for method in given.methods:
        for n in given.n:
            for name in METRICS:
                one = cell(method, n, name, given.studies, given.seed)
                print(line(method, n, name, one), flush=True)
