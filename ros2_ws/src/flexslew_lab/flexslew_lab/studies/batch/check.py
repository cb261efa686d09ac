"""Trials of the batches flown again by the ordinary bench: the worst, and a random part of all."""

from typing import Any

import numpy as np
import pyarrow.compute as pc

from flexslew_lab.progress import count_results
from flexslew_lab.run.pool import Executor
from flexslew_lab.studies.batch.tolerance import TOLERANCE, relative_difference
from flexslew_lab.studies.cases import Case, Cases
from flexslew_lab.studies.execution.worker import Job
from flexslew_lab.studies.flight import FlightResult
from flexslew_lab.studies.run import PreparedStudy, note
from flexslew_lab.studies.store import Store
from flexslew_lab.studies.study import Study
from flexslew_lab.studies.ways import Way

SHARE = 0.01  # of the trials, drawn at random
_WORST = 3  # of each variant
_STREAM = 0xC4EC


def trials_to_check(study: Study, store: Store) -> list[int]:
    """Return the numbers of the trials that are flown again, the same for the same table."""
    first = next(iter(study.settings.criteria), "residual_tip_deflection")
    rows = store.table(["index", "way", first])
    in_batch = pc.equal(rows["way"], Way.BATCH.value).to_numpy()
    numbers = rows["index"].to_numpy()[in_batch]
    if not len(numbers):
        return []
    values = rows[first].to_numpy(zero_copy_only=False).astype(np.float64)[in_batch]
    values = np.nan_to_num(values, nan=-np.inf)
    selected: set[int] = set()
    count = len(study.variants)
    for variant in range(count):
        variant_rows = np.flatnonzero(numbers % count == variant)
        worst = variant_rows[np.argsort(-values[variant_rows], kind="stable")[:_WORST]]
        selected |= {int(number) for number in numbers[worst]}
    rng = np.random.default_rng(np.random.SeedSequence(study.settings.seed, spawn_key=(_STREAM,)))
    some = rng.choice(numbers, size=max(1, round(SHARE * len(numbers))), replace=False)
    return sorted(selected | {int(number) for number in some})


def bench_job(ready: PreparedStudy) -> Job:
    """Return the study as processes fly it without batches."""
    from dataclasses import replace

    settings = replace(ready.study.settings, batch=False)
    return Job(ready.study._replace(settings=settings), ready.plans)


def check_batch(
    ready: PreparedStudy, store: Store, bench: Executor[Case, FlightResult]
) -> dict[str, Any] | None:
    """Fly the chosen trials by the ordinary bench and note how far the metrics are apart.

    Args:
        ready: the study.
        store: its folder, with the table.
        bench: flies without batches.
    """
    numbers = trials_to_check(ready.study, store)
    if not numbers:
        note(store, check=None)
        return None
    columns = store.identity["columns"]
    rows = store.table(["index", *columns], numbers)
    places = {number: k for k, number in enumerate(rows["index"].to_pylist())}
    found: dict[str, Any] = {
        "trials": len(numbers),
        "tolerance": TOLERANCE,
        "largest": 0.0,
        "metric": "",
        "index": numbers[0],
    }
    checked = bench.fly(Cases(ready.study, ready.samples, numbers))
    words = "flying again by the ordinary bench"
    for results in count_results(checked, len(numbers), words, "trials"):
        for result in results:
            row = rows.slice(places[result.number], 1)
            for name in columns:
                far = relative_difference(row[name][0].as_py(), result.metrics.get(name))
                if not far <= found["largest"]:
                    found |= {"largest": far, "metric": name, "index": result.number}
    found["ok"] = bool(found["largest"] <= TOLERANCE)
    note(store, check=found)
    return found
