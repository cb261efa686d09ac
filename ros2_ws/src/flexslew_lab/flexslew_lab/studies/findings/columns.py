"""One metric of the trials of one variant, with its failures, as samples with bounds."""

from math import inf
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from flexslew_lab.studies.findings.population import Population
from flexslew_lab.studies.sampling.methods import METHODS
from flexslew_lab.studies.store import Store
from flexslew_lab.studies.study import Study
from flexslew_plant.arrays import Vector

CONFIDENCE = 0.9  # of bounds that no criterion names
_NEVER = ("settling_time",)  # null means that it never happened, not that there is no such number


class Column(NamedTuple):
    """One metric of the trials of one variant."""

    numbers: NDArray[np.int64]  # of the trials
    values: Vector  # inf: failed or never; NaN: the trial has no such number
    failed: int
    missing: int  # NaN


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


def population(study: Study, values: Vector, replicate: NDArray[np.int32]) -> Population:
    """Return the samples that have a number, with what their sampling says of bounds.

    Args:
        study: says how they were drawn.
        values: NaN where a trial has no such number, shape (n,).
        replicate: of each sample, shape (n,).
    """
    method = METHODS[study.settings.sampling.method]
    there = ~np.isnan(values)
    parts = replicate[there] if method.replicated else None
    return Population(values[there], parts, method.independent or method.replicated)
