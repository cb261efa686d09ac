"""The score of a member, and that of an ensemble with confidence bounds."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from flexslew_lab.benchmark.task import Task

WORST, BEST = 0.0, 100.0
CONFIDENCE = 0.95  # of the bounds
_RESAMPLES = 2000
_SEED = 0xB007

Metrics = Mapping[str, float | None]


class Score(NamedTuple):
    """Mean score of an ensemble with the bounds of its bootstrap."""

    mean: float
    low: float
    high: float


def violation(task: Task, metrics: Metrics) -> str:
    """Return which requirement of the task a member violates; empty: none."""
    for name, bound in task.require.items():
        value = metrics.get(name)
        if value is None:
            return f"{name} has no value"
        if bound.below is not None and not value < bound.below:
            return f"{name} is {value:.4g}, required below {bound.below:g}"
        if bound.above is not None and not value > bound.above:
            return f"{name} is {value:.4g}, required above {bound.above:g}"
    return ""


def score_of(task: Task, metrics: Metrics | None) -> float:
    """Return the score of a member: 100 sum_i w_i / (1 + |m_i| / h_i), from 0 to 100.

    Args:
        task: the benchmark problem, with weights w_i and half values h_i.
        metrics: m_i by column of a study; None: the member has failed. A metric without a value
            adds nothing; a member that violates a requirement has failed, too.
    """
    if metrics is None or violation(task, metrics):
        return WORST
    total = 0.0
    for name, term in task.score.items():
        value = metrics.get(name)
        if value is not None and np.isfinite(value):
            total += term.weight / (1.0 + abs(value) / term.half)
    return BEST * total


def ensemble_score(scores: Sequence[float]) -> Score:
    """Return the mean of the members' scores with its percentile bootstrap (Efron, 1979)."""
    values = np.array(scores, dtype=np.float64)
    rng = np.random.default_rng(_SEED)
    picks = rng.integers(len(values), size=(_RESAMPLES, len(values)))
    means = values[picks].mean(axis=1)
    tail = 0.5 * (1.0 - CONFIDENCE)
    low, high = np.quantile(means, [tail, 1.0 - tail])
    return Score(float(values.mean()), float(low), float(high))
