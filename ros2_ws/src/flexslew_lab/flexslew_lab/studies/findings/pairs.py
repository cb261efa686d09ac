"""Variants against the first one on the same samples: how far apart, and whether really."""

from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexslew_lab.studies.findings.columns import CONFIDENCE, column, population
from flexslew_lab.studies.findings.population import Population
from flexslew_lab.studies.findings.stopping import joint_confidence
from flexslew_lab.studies.store import Store
from flexslew_lab.studies.study import Study
from flexslew_plant.arrays import Vector


class PairedDifference(StrEnum):
    """How a variant's number compares with the first one's, at the joint confidence of all."""

    SMALLER = "smaller"
    LARGER = "larger"
    UNKNOWN = "undecided"


def paired(study: Study, store: Store, names: list[str]) -> list[dict[str, Any]]:
    """Return, for each metric, every variant against the first on the same samples.

    A trial that failed counts as the worse of its pair, and two that failed as alike; a pair is
    left out where a trial has no such number. The test is that of Population.sign_p_value, and the
    variants share its error, and that of the bounds of each number (Bonferroni).
    """
    lines = []
    error = 1.0 - joint_confidence(study, store.samples, CONFIDENCE)
    variant_error = error / max(len(study.variants) - 1, 1)  # of each variant
    for name in names if len(study.variants) > 1 else []:
        first, rows = column(study, store, name, 0)
        replicate = rows["replicate"].to_numpy()
        for k, variant in enumerate(study.variants[1:], start=1):
            other, _ = column(study, store, name, k)
            # a stop may have left samples that only one of them has flown
            _, a, b = np.intersect1d(
                first.numbers // len(study.variants),
                other.numbers // len(study.variants),
                return_indices=True,
            )
            failure_value = _failure_value(study, name)
            values = first.values[a], other.values[b]
            difference = _differences(*values, failure_value)
            found = population(study, difference, replicate[a])
            lines.append(
                {
                    "metric": name,
                    "variant": variant.label,
                    "against": study.variants[0].label,
                    "pairs": len(found.values),
                    "with_failure": int(np.count_nonzero(np.isinf(found.values))),
                    "without_number": len(difference) - len(found.values),
                    "smaller": _share(found.values < 0.0),
                    "larger": _share(found.values > 0.0),
                    "mean": list(found.mean(1.0 - variant_error)),
                    "median": list(found.quantile(0.5, 1.0 - variant_error)),
                    **_sign_test(found, variant_error),
                }
            )
    return lines


def _failure_value(study: Study, name: str) -> float:
    """Return what a failure counts as: beyond any number on the side that a criterion excludes."""
    criterion = study.settings.criteria.get(name)
    return -np.inf if criterion is not None and criterion.above is not None else np.inf


def _differences(first: Vector, other: Vector, failure_value: float) -> Vector:
    """Return other - first, with infinities for failures; 0 where both failed, NaN for no pair."""
    before, after = (np.where(np.isinf(values), failure_value, values) for values in (first, other))
    equal = before == after  # two infinities too
    return np.subtract(after, before, out=np.zeros(len(after)), where=~equal)


def _share(which: NDArray[np.bool_]) -> float | None:
    return float(np.mean(which)) if len(which) else None


def _sign_test(found: Population, error: float) -> dict[str, Any]:
    """Return the p-value of no difference, and which way it goes if that is below the error."""
    p_value = found.sign_p_value()
    decision = PairedDifference.UNKNOWN
    if p_value is not None and p_value <= error:
        more = np.sum(np.sign(found.values)) > 0.0
        decision = PairedDifference.LARGER if more else PairedDifference.SMALLER
    return {"p_value": p_value, "verdict": decision.value}
