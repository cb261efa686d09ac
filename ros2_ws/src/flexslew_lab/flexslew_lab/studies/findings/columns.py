"""One metric of the trials of one variant, with its failures, as samples with bounds."""

from math import inf
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from flexslew_lab.metrics.rows import key_of
from flexslew_lab.studies.findings.population import Population
from flexslew_lab.studies.sampling.methods import METHODS
from flexslew_lab.studies.store import Store
from flexslew_lab.studies.study import Study
from flexslew_plant.arrays import Vector

CONFIDENCE = 0.9  # of bounds that no criterion names


class Column(NamedTuple):
    """One metric of the trials of one variant."""

    numbers: NDArray[np.int64]  # of the trials
    values: Vector  # inf: failed or never; NaN: the trial has no such number
    lost: NDArray[np.bool_]  # failed, (trials,)
    missing: int  # NaN

    @property
    def failed(self) -> int:
        """How many have."""
        return int(np.count_nonzero(self.lost))


def column(study: Study, store: Store, name: str, variant: int | None) -> tuple[Column, pa.Table]:
    """Return a metric of one variant (None: of all) with the rows that it comes from."""
    known = _parts(store, key_of(name, store.user_keys).never)
    rows = store.table(["index", "replicate", "status", name, *known])
    if variant is not None:
        count = len(study.variants)
        rows = rows.filter(pa.array(rows["index"].to_numpy() % count == variant))
    values = rows[name].to_numpy(zero_copy_only=False).astype(np.float64)
    lost = pc.not_equal(rows["status"], "ok").to_numpy()
    if known:
        valid = [pc.is_valid(rows[part]).to_numpy() for part in known]
        values = np.where(np.isnan(values) & np.any(valid, axis=0), inf, values)
    values = np.where(lost, inf, values)
    missing = int(np.isnan(values).sum())
    return Column(rows["index"].to_numpy(), values, lost, missing), rows


def _parts(store: Store, key: str) -> list[str]:
    """Return the columns of a key of metrics.json."""
    return [name for name in store.identity["columns"] if name.split(".")[0] == key]


def worst_of(found: Column, most: int) -> list[int]:
    """Return the places of the trials with the largest numbers, failures before all others."""
    order = np.lexsort((-np.nan_to_num(found.values, nan=-inf), ~found.lost))[:most]
    return [k for k in order.tolist() if not np.isnan(found.values[k])]


def population(study: Study, values: Vector, replicate: NDArray[np.int32]) -> Population:
    """Return the samples that have a number, with the kind of bounds that their sampling allows.

    Args:
        study: the study, with the method of the sampling.
        values: NaN where a trial has no such number, shape (n,).
        replicate: replicate of each sample, shape (n,).
    """
    method = METHODS[study.settings.sampling.method]
    valid = ~np.isnan(values)
    parts = replicate[valid] if method.replicated else None
    return Population(values[valid], parts, method.independent or method.replicated)
