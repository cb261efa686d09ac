"""When a study may stop: decided after fixed numbers of samples, whichever worker flies them."""

from collections.abc import Iterator
from math import inf
from typing import Any

import numpy as np
import pyarrow as pa

from flexslew_lab.studies.findings.columns import column, population
from flexslew_lab.studies.findings.population import Bounds, Population
from flexslew_lab.studies.store import Store
from flexslew_lab.studies.study import Study
from flexslew_lab.studies.study_settings import Stop

_FIRST = 64  # samples before the first look


def interim_sizes(study: Study, samples: pa.Table) -> list[int]:
    """Return the numbers of samples after which the study may stop; the last is all of them.

    Random samples and Sobol points double in between, where the latter are balanced; Latin
    hypercubes are checked after whole replicates.
    """
    last: int = samples.num_rows
    if study.settings.stop is None:
        return [last]
    if study.settings.sampling.method == "lhs":
        replicate = samples["replicate"].to_numpy()
        ends = (np.flatnonzero(np.diff(replicate)) + 1).tolist()
        return [*ends[2:], last]
    counts, count = [], _FIRST
    while count < last:
        counts.append(count)
        count *= 2
    return [*counts, last]


def interim_confidence(study: Study, samples: pa.Table, stop: Stop) -> float:
    """Return at what confidence each check of each variant bounds the quantile (Bonferroni).

    All checks hold at once with the confidence of the stop, so that the bounds of the check at
    which a study ended hold with it, too.
    """
    return joint_confidence(study, samples, 1.0 - (1.0 - stop.confidence) / len(study.variants))


def joint_confidence(study: Study, samples: pa.Table, confidence: float) -> float:
    """Return the confidence of bounds at each check, so that those of all checks hold at once.

    The number of samples of a study that may stop depends on the samples: bounds for a given
    number of samples hold less often there (Bonferroni).

    Args:
        study: the study; one that cannot stop has one check.
        samples: samples of it.
        confidence: confidence of all checks together.
    """
    return 1.0 - (1.0 - confidence) / len(interim_sizes(study, samples))


def stop_result(
    study: Study, store: Store, samples: pa.Table, sample_count: int
) -> dict[str, Any] | None:
    """Return what is known if the first `sample_count` samples are enough, else None."""
    stop = study.settings.stop
    if stop is None:
        return None
    confidence = interim_confidence(study, samples, stop)
    known = []
    for found in _first_samples(study, store, stop.metric, sample_count):
        bounds = found.quantile(stop.quantile, confidence)
        if _half_width(bounds) > stop.half_width:
            return None
        known.append(bounds)
    return {
        "samples": sample_count,
        "half_width": max(_half_width(bounds) for bounds in known),
        "metric": stop.metric,
        "quantile": stop.quantile,
        "confidence": stop.confidence,
        "bounds": {v.label: list(b) for v, b in zip(study.variants, known, strict=True)},
    }


def _half_width(bounds: Bounds) -> float:
    """Return half of how far the ends are apart; inf without one."""
    low, _, high = bounds
    return inf if low is None or high is None else 0.5 * (high - low)


def _first_samples(
    study: Study, store: Store, metric: str, sample_count: int
) -> Iterator[Population]:
    """Yield the metric of the first samples, variant by variant, as the report has it."""
    store.write_table()
    count = len(study.variants)
    for variant in range(count):
        found, rows = column(study, store, metric, variant)
        first = found.numbers < sample_count * count
        yield population(study, found.values[first], rows["replicate"].to_numpy()[first])
