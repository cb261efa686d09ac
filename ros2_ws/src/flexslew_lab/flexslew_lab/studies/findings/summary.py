"""What a study found, as plain data with stable keys: what --json prints and the report shows."""

from math import inf
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from flexslew_lab.metrics.rows import key_of
from flexslew_lab.studies.findings.sensitivity import indices
from flexslew_lab.studies.findings.statistics import Population, trials_needed
from flexslew_lab.studies.sampling.methods import METHODS
from flexslew_lab.studies.store import Store
from flexslew_lab.studies.study import Criterion, Study
from flexslew_plant.arrays import Vector

QUANTILES = (0.5, 0.9, 0.99)
CONFIDENCE = 0.9  # of bounds that no criterion names
_WORST = 5
_REASONS = 20
_NEVER = ("settling_time",)  # null means that it never happened, not that there is no such number


class Column(NamedTuple):
    """One metric of the trials of one variant."""

    numbers: NDArray[np.int64]  # of the trials
    values: Vector  # inf: failed or never; NaN: the trial has no such number
    failed: int
    missing: int  # NaN


def summary(study: Study, store: Store, flights: dict[str, Any]) -> dict[str, Any]:
    """Return what the results of a study show.

    Args:
        study: its file.
        store: its folder.
        flights: wall_time, trials_per_second, lanes check and what else the run says of itself.
    """
    columns = store.identity["columns"]
    rows = store.table(["status", "reason", "way"])
    failed = pc.not_equal(rows["status"], "ok")
    chosen = [name for name in columns if _worth_telling(name)]
    metrics = {name: _metric(study, store, name) for name in chosen}
    criteria = [
        row for name, c in study.settings.criteria.items() for row in _judged(study, store, name, c)
    ]
    total = store.samples.num_rows * len(study.variants)
    return {
        "study": study.settings.study,
        "trials": rows.num_rows,
        "planned": total,
        "failed": pc.sum(failed).as_py() or 0,
        "wall_time": flights.get("wall_time"),
        "trials_per_second": flights.get("trials_per_second"),
        "columns": store.columns,
        "criteria": criteria,
        "metrics": metrics,
        "table": str(store.table_path),
        "sampling": {
            "method": study.settings.sampling.method,
            "replicates": int(np.unique(store.samples["replicate"].to_numpy()).size),
            "bounds": _kind_of_bounds(study),
        },
        "variants": [variant.label for variant in study.variants],
        "ways": dict(sorted(_counted(rows["way"]).items())),
        "reasons": _counted(rows["reason"].filter(failed)),
        "paired": _paired(study, store, list(study.settings.criteria) or chosen[:1]),
        "sensitivity": _sensitivity(study, store, list(study.settings.criteria) or chosen[:1]),
        "check": flights.get("check"),
        "stopped": flights.get("stopped"),
    }


def passed(found: dict[str, Any]) -> bool:
    """Return whether every criterion is shown and every check of the lanes agreed."""
    check = found["check"]
    return all(row["passed"] for row in found["criteria"]) and (check is None or check["ok"])


def column(study: Study, store: Store, name: str, variant: int | None) -> tuple[Column, pa.Table]:
    """Return a metric of one variant (None: of all) with the rows that it comes from."""
    rows = store.table(["index", "replicate", "status", name])
    if variant is not None:
        count = len(study.variants)
        rows = rows.filter(pa.array(rows["index"].to_numpy() % count == variant))
    values = rows[name].to_numpy(zero_copy_only=False).astype(np.float64)
    failed = pc.not_equal(rows["status"], "ok").to_numpy()
    if name.split(".")[0] in _NEVER:
        values = np.where(np.isnan(values), inf, values)
    values = np.where(failed, inf, values)
    missing = int(np.isnan(values).sum())
    return Column(rows["index"].to_numpy(), values, int(failed.sum()), missing), rows


def population(study: Study, found: Column, rows: pa.Table) -> Population:
    """Return the samples that have a number, with what their sampling says of bounds."""
    method = METHODS[study.settings.sampling.method]
    there = ~np.isnan(found.values)
    parts = rows["replicate"].to_numpy()[there] if method.replicated else None
    return Population(found.values[there], parts, method.independent or method.replicated)


def needed(study: Study) -> list[str]:
    """Return, in words, how many trials each criterion needs at least."""
    lines = []
    samples = study.settings.sampling
    for name, c in study.settings.criteria.items():
        if c.probability is None:
            continue
        least = trials_needed(c.probability, c.confidence)
        line = (
            f"{name}: {least} trials without a failure show {100 * c.probability:g} % at "
            f"{100 * c.confidence:g} %"
        )
        if samples.method in ("grid", "list", "saltelli"):
            line += f"; samples of method {samples.method} show no probability, however many"
        lines.append(line)
    return lines


def _metric(study: Study, store: Store, name: str) -> dict[str, Any]:
    each = {}
    for k, variant in enumerate(study.variants):
        found, rows = column(study, store, name, k)
        confidence = 1.0 - (1.0 - CONFIDENCE) / len(study.variants)  # all of them at once
        each[variant.label] = _numbers(population(study, found, rows), confidence) | {
            "failed": found.failed,
            "missing": found.missing,
            "worst": _worst(found),
        }
    whole, rows = column(study, store, name, None)
    if len(each) == 1:
        numbers = next(iter(each.values()))
        return numbers | {"unit": key_of(name).unit}
    pooled = _numbers(Population(whole.values[~np.isnan(whole.values)], None, False), CONFIDENCE)
    for q, bounds in pooled["quantiles"].items():  # of a mixture: between those of its parts
        parts = [one["quantiles"][q] for one in each.values()]
        bounds[0] = None if any(p[0] is None for p in parts) else min(p[0] for p in parts)
        bounds[2] = None if any(p[2] is None for p in parts) else max(p[2] for p in parts)
    return pooled | {
        "failed": whole.failed,
        "missing": whole.missing,
        "worst": _worst(whole),
        "unit": key_of(name).unit,
        "variants": each,
    }


def _numbers(found: Population, confidence: float) -> dict[str, Any]:
    mean = found.mean(confidence)
    return {
        "mean": mean.estimate,
        "mean_bounds": [mean.low, mean.high],
        "quantiles": {str(q): list(found.quantile(q, confidence)) for q in QUANTILES},
    }


def _worst(found: Column) -> list[dict[str, Any]]:
    """Return the trials with the largest numbers, the failed before all others."""
    order = np.argsort(-np.nan_to_num(found.values, nan=-inf), kind="stable")[:_WORST]
    return [
        {
            "index": int(found.numbers[k]),
            "value": float(found.values[k]) if np.isfinite(found.values[k]) else None,
        }
        for k in order
        if not np.isnan(found.values[k])
    ]


def _judged(study: Study, store: Store, name: str, c: Criterion) -> list[dict[str, Any]]:
    """Return one row per variant: a failed trial and one without a number do not keep to it."""
    lines = []
    for k, variant in enumerate(study.variants):
        found, rows = column(study, store, name, k)
        with np.errstate(invalid="ignore"):
            kept = np.ones(len(found.values), dtype=np.bool_)
            if c.below is not None:
                kept &= found.values < c.below
            if c.above is not None:
                kept &= found.values > c.above
        kept &= np.isfinite(found.values)
        method = METHODS[study.settings.sampling.method]
        parts = rows["replicate"].to_numpy() if method.replicated else None
        whole = Population(found.values, parts, method.independent or method.replicated)
        bound = whole.success(kept, c.confidence)
        row: dict[str, Any] = {
            "metric": name,
            "variant": variant.label,
            "below": c.below,
            "above": c.above,
            "probability": c.probability,
            "confidence": c.confidence,
            "trials": len(kept),
            "successes": int(kept.sum()),
            "failed": found.failed,
            "missing": found.missing,
            "estimate": bound.estimate,
            "lower_bound": bound.low if c.probability is not None else None,
            "needed": None,
        }
        if c.probability is None:
            row["passed"] = bool(kept.all()) and len(kept) > 0
        else:
            row["needed"] = trials_needed(c.probability, c.confidence, len(kept) - int(kept.sum()))
            row["passed"] = bound.low is not None and bound.low >= c.probability
        lines.append(row)
    return lines


def _paired(study: Study, store: Store, names: list[str]) -> list[dict[str, Any]]:
    """Return, for each metric, every variant against the first on the same samples."""
    lines = []
    for name in names if len(study.variants) > 1 else []:
        first, rows = column(study, store, name, 0)
        for k, variant in enumerate(study.variants[1:], start=1):
            other, _ = column(study, store, name, k)
            # a stop may have left samples that only one of them has flown
            _, a, b = np.intersect1d(
                first.numbers // len(study.variants),
                other.numbers // len(study.variants),
                return_indices=True,
            )
            both = np.isfinite(first.values[a]) & np.isfinite(other.values[b])
            difference = other.values[b][both] - first.values[a][both]
            method = METHODS[study.settings.sampling.method]
            parts = rows["replicate"].to_numpy()[a][both] if method.replicated else None
            found = Population(difference, parts, method.independent or method.replicated)
            lines.append(
                {
                    "metric": name,
                    "variant": variant.label,
                    "against": study.variants[0].label,
                    "pairs": int(both.sum()),
                    "without_number": int((~both).sum()),
                    "smaller": float(np.mean(difference < 0.0)) if both.any() else None,
                    "mean": list(found.mean(CONFIDENCE)),
                    "median": list(found.quantile(0.5, CONFIDENCE)),
                }
            )
    return lines


def _sensitivity(study: Study, store: Store, names: list[str]) -> list[dict[str, Any]]:
    if study.settings.sampling.method != "saltelli":
        return []
    lines: list[dict[str, Any]] = []
    count = store.samples.num_rows
    for name in names:
        for k, variant in enumerate(study.variants):
            found, _ = column(study, store, name, k)
            values = np.full(count, np.nan)
            values[found.numbers // len(study.variants)] = found.values
            varied = [v.name for v in study.varied]
            rows, why = indices(values, varied, CONFIDENCE, study.settings.seed)
            lines.append(
                {
                    "metric": name,
                    "variant": variant.label,
                    "why_not": why,
                    "indices": {r.name: {"first": r.first, "total": r.total} for r in rows},
                }
            )
    return lines


def _kind_of_bounds(study: Study) -> str:
    method = METHODS[study.settings.sampling.method]
    if method.independent:
        return "independent samples"
    return "randomised replicates" if method.replicated else "none"


def _worth_telling(name: str) -> bool:
    return name not in ("ticks", "duration", "manoeuvre_start", "manoeuvre_end")


def _counted(words: pa.ChunkedArray) -> dict[str, int]:
    """Return the most frequent words, each with how often it is there."""
    found = {entry["values"]: entry["counts"] for entry in pc.value_counts(words).to_pylist()}
    return dict(sorted(found.items(), key=lambda item: (-item[1], item[0]))[:_REASONS])
