"""What a study found, as plain data with stable keys: what --json prints and the report shows."""

from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from flexslew_lab.metrics.rows import row_unit
from flexslew_lab.studies.findings.columns import CONFIDENCE, Column, column, population, worst_of
from flexslew_lab.studies.findings.criteria import criterion_rows
from flexslew_lab.studies.findings.pairs import paired
from flexslew_lab.studies.findings.population import Population
from flexslew_lab.studies.findings.sensitivity import indices
from flexslew_lab.studies.findings.stopping import interim_confidence, joint_confidence
from flexslew_lab.studies.sampling.methods import METHODS, replicates_of
from flexslew_lab.studies.store import Store
from flexslew_lab.studies.study import Study
from flexslew_lab.trial.overrides import override_values
from flexslew_plant.testbeds import read_testbed

QUANTILES = (0.5, 0.9, 0.99)
_WORST = 5
_REASONS = 20


def summary(study: Study, store: Store, run_facts: dict[str, Any]) -> dict[str, Any]:
    """Return the results of a study in summary.

    Args:
        study: its file.
        store: its folder.
        run_facts: wall_time, trials_per_second, batch check and the other facts of the run.
    """
    columns = store.identity["columns"]
    rows = store.table(["status", "reason", "way"])
    failed = pc.not_equal(rows["status"], "ok")
    metric_names = [name for name in columns if _is_relevant(name)]
    joints, user_keys = _joint_units(study), store.user_keys
    metrics = {
        name: _metric(study, store, name) | {"unit": row_unit(name, joints, user_keys) or "-"}
        for name in metric_names
    }
    samples, stopped = store.samples.num_rows, run_facts.get("stopped")
    sample_limit = samples if stopped is None else stopped["samples"]
    criteria = [
        row
        for name, c in study.settings.criteria.items()
        for row in criterion_rows(study, store, name, c, sample_limit)
    ]
    return {
        "study": study.settings.study,
        "trials": rows.num_rows,
        "planned": samples * len(study.variants),
        "to_fly": (
            trial_count := sample_limit * len(study.variants)
        ),  # fewer where a criterion stopped it
        "complete": rows.num_rows >= trial_count,
        "failed": pc.sum(failed).as_py() or 0,
        "wall_time": run_facts.get("wall_time"),
        "trials_per_second": run_facts.get("trials_per_second"),
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
        "ways": dict(sorted(_frequencies(rows["way"]).items())),
        "reasons": _frequencies(rows["reason"].filter(failed)),
        "paired": paired(study, store, list(study.settings.criteria) or metric_names[:1]),
        "sensitivity": _sensitivity(
            study, store, list(study.settings.criteria) or metric_names[:1]
        ),
        "damaged": store.damaged,
        "check": run_facts.get("check"),
        "stopped": stopped,
    }


def passed(found: dict[str, Any]) -> bool:
    """Return whether every criterion is shown and every check of the batches agreed."""
    check = found["check"]
    return all(row["passed"] for row in found["criteria"]) and (check is None or check["ok"])


def _metric(study: Study, store: Store, name: str) -> dict[str, Any]:
    each = {}
    confidence = _confidence(study, store, name)
    for k, variant in enumerate(study.variants):
        found, rows = column(study, store, name, k)
        samples = population(study, found.values, rows["replicate"].to_numpy())
        each[variant.label] = _numbers(samples, confidence) | {
            "trials": len(found.values),
            "failed": found.failed,
            "missing": found.missing,
            "worst": _worst(found),
        }
    whole, rows = column(study, store, name, None)
    if len(each) == 1:
        return next(iter(each.values()))
    pooled = _numbers(Population(whole.values[~np.isnan(whole.values)], None, False), CONFIDENCE)
    for q, bounds in pooled["quantiles"].items():  # of a mixture: between those of its parts
        parts = [one["quantiles"][q] for one in each.values()]
        bounds[0] = None if any(p[0] is None for p in parts) else min(p[0] for p in parts)
        bounds[2] = None if any(p[2] is None for p in parts) else max(p[2] for p in parts)
    return pooled | {
        "trials": len(whole.values),
        "failed": whole.failed,
        "missing": whole.missing,
        "worst": _worst(whole),
        "variants": each,
    }


def _joint_units(study: Study) -> dict[str, str]:
    """Return the units of the joints by name, of all benches that are compared."""
    changes = [v.changes for v in study.variants if any(k[:7] == "testbed" for k in v.changes)]
    sections = [override_values(study.base, change)["testbed"] for change in ({}, *changes)]
    units: dict[str, str] = {}
    for one in sections:
        units |= read_testbed(one, study.source, study.trust).model().units_by_joint
    return units


def _confidence(study: Study, store: Store, name: str) -> float:
    """Return the confidence of each variant's bounds, so that those of all hold at once."""
    stop = study.settings.stop
    if stop is not None and stop.metric == name:  # the look at which it ended was chosen by it
        return interim_confidence(study, store.samples, stop)
    variant_confidence = 1.0 - (1.0 - CONFIDENCE) / len(study.variants)
    return joint_confidence(study, store.samples, variant_confidence)


def _numbers(found: Population, confidence: float) -> dict[str, Any]:
    mean = found.mean(confidence)
    return {
        "mean": mean.estimate,
        "mean_bounds": [mean.low, mean.high],
        "quantiles": {str(q): list(found.quantile(q, confidence)) for q in QUANTILES},
    }


def _worst(found: Column) -> list[dict[str, Any]]:
    """Return the trials with the largest numbers."""
    return [
        {
            "index": int(found.numbers[k]),
            "value": float(found.values[k]) if np.isfinite(found.values[k]) else None,
            "failed": bool(found.lost[k]),
        }
        for k in worst_of(found, _WORST)
    ]


def _sensitivity(study: Study, store: Store, names: list[str]) -> list[dict[str, Any]]:
    if study.settings.sampling.method != "saltelli":
        return []
    lines: list[dict[str, Any]] = []
    count, parts = store.samples.num_rows, replicates_of(study.settings.sampling)
    for name in names:
        for k, variant in enumerate(study.variants):
            found, _ = column(study, store, name, k)
            values = np.full(count, np.nan)
            values[found.numbers // len(study.variants)] = found.values
            variable_names = [v.name for v in study.varied]
            rows, why = indices(values, variable_names, CONFIDENCE, study.settings.seed, parts)
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


def _is_relevant(name: str) -> bool:
    return name not in ("ticks", "duration", "manoeuvre_start", "manoeuvre_end")


def _frequencies(words: pa.ChunkedArray) -> dict[str, int]:
    """Return the most frequent words, each with how often it is there."""
    found = {entry["values"]: entry["counts"] for entry in pc.value_counts(words).to_pylist()}
    return dict(sorted(found.items(), key=lambda item: (-item[1], item[0]))[:_REASONS])
