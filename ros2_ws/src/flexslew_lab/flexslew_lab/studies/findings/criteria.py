"""What the criteria of a study come to: passed, refuted, or undecided by these trials."""

from enum import StrEnum
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from flexslew_lab.studies.findings.columns import Column, column, population
from flexslew_lab.studies.findings.population import Bounds
from flexslew_lab.studies.findings.statistics import trials_needed
from flexslew_lab.studies.findings.stopping import joint_confidence
from flexslew_lab.studies.sampling.methods import METHODS
from flexslew_lab.studies.store import Store
from flexslew_lab.studies.study import Study
from flexslew_lab.studies.study_settings import Criterion


class Decision(StrEnum):
    """The verdict of the trials on a criterion."""

    PASSED = "passed"  # shown at the requested confidence
    REJECTED = "refuted"  # the opposite is
    UNKNOWN = "undecided"


def criterion_rows(
    study: Study, store: Store, name: str, c: Criterion, planned: int
) -> list[dict[str, Any]]:
    """Return one row per variant: a failed trial and one without a number do not keep to it.

    Args:
        study: its file.
        store: its folder, with the table.
        name: name of the metric.
        c: the criterion.
        planned: trials of a variant, all of which a criterion without a probability needs.
    """
    lines = []
    confidence = joint_confidence(study, store.samples, c.confidence)
    for k, variant in enumerate(study.variants):
        found, rows = column(study, store, name, k)
        kept = _success_mask(found, c)
        values = np.where(np.isnan(found.values), np.inf, found.values)  # every trial counts
        whole = population(study, values, rows["replicate"].to_numpy())
        bound = whole.success(kept, confidence)
        has_probability = c.probability is not None
        decision = decide(c, kept, bound, planned)
        lines.append(
            {
                "metric": name,
                "variant": variant.label,
                "below": c.below,
                "above": c.above,
                "probability": c.probability,
                "confidence": c.confidence,
                "trials": len(kept),
                "planned": planned,
                "successes": int(kept.sum()),
                "failed": found.failed,
                "missing": found.missing,
                "estimate": bound.estimate,
                "lower_bound": bound.low if has_probability else None,
                "upper_bound": bound.high if has_probability else None,
                "needed": None
                if c.probability is None
                else trials_needed(c.probability, confidence, int(np.count_nonzero(~kept))),
                "verdict": decision.value,
                "passed": decision is Decision.PASSED,
            }
        )
    return lines


def _success_mask(found: Column, c: Criterion) -> NDArray[np.bool_]:
    kept = np.isfinite(found.values)
    with np.errstate(invalid="ignore"):
        if c.below is not None:
            kept &= found.values < c.below
        if c.above is not None:
            kept &= found.values > c.above
    return kept


def decide(c: Criterion, kept: NDArray[np.bool_], bound: Bounds, planned: int) -> Decision:
    """Return what is shown: by the bounds of the probability, or by one counterexample."""
    if c.probability is None:
        if not kept.all():
            return Decision.REJECTED
        return Decision.PASSED if len(kept) >= planned else Decision.UNKNOWN
    if bound.low is not None and bound.low >= c.probability:
        return Decision.PASSED
    if bound.high is not None and bound.high < c.probability:
        return Decision.REJECTED
    return Decision.UNKNOWN


def needed(study: Study, planned: pa.Table) -> list[str]:
    """Return, in words, how many trials each criterion needs at least.

    Args:
        study: its file.
        planned: its samples.
    """
    lines = []
    samples = study.settings.sampling
    for name, c in study.settings.criteria.items():
        if c.probability is None:
            continue
        least = trials_needed(c.probability, joint_confidence(study, planned, c.confidence))
        line = (
            f"{name}: {least} trials without a failure show {100 * c.probability:g} % at "
            f"{100 * c.confidence:g} %"
        )
        method = METHODS[samples.method]
        if not (method.independent or method.replicated):
            line += f"; samples of method {samples.method} show no probability, however many"
        lines.append(line)
    return lines
