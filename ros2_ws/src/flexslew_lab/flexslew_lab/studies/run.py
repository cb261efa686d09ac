"""A study from its file to its folder: what is missing is flown, then it is summed up."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from flexslew_lab.metrics.own import load_user_metrics
from flexslew_lab.progress import Count, phase
from flexslew_lab.run.pool import Executor
from flexslew_lab.studies.cases import (
    Case,
    Cases,
    case_of,
    case_trial,
    require_variant,
    sample_table,
    typical_case,
)
from flexslew_lab.studies.execution.worker import Job
from flexslew_lab.studies.findings.stopping import interim_sizes, stop_result
from flexslew_lab.studies.flight import FlightResult, PlanCache, metric_columns, plan_key
from flexslew_lab.studies.identity import extended, identity_of, require_files, require_same
from flexslew_lab.studies.seals import opened_json
from flexslew_lab.studies.store import Store
from flexslew_lab.studies.study import Study, known_metric
from flexslew_lab.trial.outputs import RUNS
from flexslew_lab.trial.trial import Trial, set_up
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import plain
from flexslew_plant.yaml_data import yaml_text

_PART_TIME = 5.0  # between two parts [wall s]
_PART_ROWS = 5_000  # of a part, at most
_RECORDS_FILE = "flights.json"


class Shard(NamedTuple):
    """One of several runs that share the samples of a study."""

    number: int = 1
    of: int = 1


ALL = Shard()


@dataclass
class PreparedStudy:
    """A study that is ready to be flown: checked, its plans made."""

    study: Study
    samples: pa.Table
    columns: list[str]
    plans: PlanCache
    identity: dict[str, Any] = field(init=False)

    def __post_init__(self) -> None:
        """Set the identity of the study."""
        self.identity = identity_of(self.study, self.samples, self.columns, self.plans)

    @property
    def job(self) -> Job:
        """What a process needs to fly its trials."""
        return Job(self.study, self.plans)

    @property
    def trials(self) -> int:
        """How many there are in all."""
        return int(self.samples.num_rows) * len(self.study.variants)


def default_folder(study: Study, shard: Shard = ALL) -> Path:
    """Return the folder of a study without --out."""
    part = f"-shard-{shard.number}-of-{shard.of}" if shard.of > 1 else ""
    return RUNS / f"study-{study.settings.study}{part}"


def prepare(study: Study) -> PreparedStudy:
    """Return the study with its samples drawn, its values checked and its common plans made.

    Raises:
        BadInput: see checked; no plan has been made then.
    """
    with phase("checking the file"):
        samples = sample_table(study)
        columns, typical = checked(study, samples)
    plans = PlanCache()
    for k, trial in enumerate(typical):
        ends = [case_trial(study, case_of(study, samples, k))]
        ends.append(case_trial(study, case_of(study, samples, _last(study, samples, k))))
        if plan_key(ends[0]) == plan_key(ends[1]) == plan_key(trial):
            plans.keep(trial)
    return PreparedStudy(study, samples, columns, plans)


def checked(study: Study, samples: pa.Table) -> tuple[list[str], list[Trial]]:
    """Return the columns of a study's table, and a typical trial of each variant.

    Args:
        study: the study with the variants and the metrics.
        samples: samples of it.

    Raises:
        BadInput: if a variant cannot be flown as the file has it, or a metric is not known.
    """
    columns: dict[str, None] = {}
    trials = []
    for k, variant in enumerate(study.variants):
        require_variant(study, variant)
        typical = case_trial(study, typical_case(study, samples, k))
        bench, _ = set_up(typical, study.source)
        user_metrics = load_user_metrics(typical.metrics, f"{study.source}: metrics", typical.trust)
        columns |= dict.fromkeys(metric_columns(bench, user_metrics))
        bench.close()
        trials.append(typical)
    for sampled in study.varied:
        if sampled.name in columns:
            words = f"{sampled.name} is not allowed: a metric has that name"
            raise BadInput(words, f"{study.source}: vary")
    for name in study.settings.criteria:
        known_metric(name, list(columns), f"{study.source}: criteria")
    if study.settings.stop is not None:
        known_metric(study.settings.stop.metric, list(columns), f"{study.source}: stop.metric")
    return list(columns), trials


def run_study(
    ready: PreparedStudy,
    folder: Path,
    executor: Executor[Case, FlightResult],
    shard: Shard = ALL,
    retry_failed: bool = False,
) -> Store:
    """Fly what is missing of a study and return its folder with the sorted table written.

    Args:
        ready: the study.
        folder: new, empty, or with a part of the same study, or of one with fewer samples.
        executor: executor of the flights.
        shard: which samples are requested here.
        retry_failed: fly failed trials again.

    Raises:
        BadInput: if the folder contains another study, which is not changed; or if the code or the
            files of the trials have changed on the way.
        RunFault: if the disk is full.
        KeyboardInterrupt: after the results until then are written.
    """
    study, store = ready.study, Store(folder)
    if shard.of > 1 and study.settings.stop is not None:
        raise BadInput("stop: is not allowed for a shard, which sees a part only", study.source)
    _is_started(Store(folder), ready)
    with store.locked():
        started = _is_started(store, ready)  # another run may have started one meanwhile
        store.clean()
        if not started:
            store.create(ready.identity, ready.samples)
        _describe(study, store)
        with phase("flying", "trials") as progress:
            _simulate_missing(ready, store, executor, shard, retry_failed, progress)
        store.write_table()
    return store


def _is_started(store: Store, ready: PreparedStudy) -> bool:
    """Return whether a folder holds the study, with all of its samples.

    Raises:
        BadInput: it holds something else.
    """
    if not store.exists:
        if store.unknown_items:
            raise BadInput("is not empty and holds no study; choose another --out", store.folder)
        return False
    if extended(store.identity, ready.identity, ready.samples):
        return False
    require_same(store.identity, ready.identity, store.folder)
    return True


def flight_records(store: Store) -> dict[str, Any]:
    """Return the records of all runs of a study together.

    Raises:
        BadInput: their file is damaged.
    """
    path = store.folder / _RECORDS_FILE
    return opened_json(path) if path.is_file() else {}


def note(store: Store, **facts: Any) -> None:
    """Write facts of the run next to its results."""
    store.write_facts(_RECORDS_FILE, flight_records(store) | facts)


def _last(study: Study, samples: pa.Table, variant: int) -> int:
    return (int(samples.num_rows) - 1) * len(study.variants) + variant


def _describe(study: Study, store: Store) -> None:
    """Keep the files that the folder can be read with, wherever it is taken."""
    settings = plain(study.settings) | {"trial": "trial.yaml"}
    if study.list_columns:
        names = [sampled.name for sampled in study.varied]
        rows = [
            ",".join(map(repr, map(float, row))) for row in zip(*study.list_columns, strict=True)
        ]
        store.write_text("samples.csv", "\n".join([",".join(names), *rows]) + "\n")
        settings["sampling"]["file"] = "samples.csv"
    store.write_text("trial.yaml", yaml_text(study.base))
    store.write_text("study.yaml", yaml_text(settings))


def _simulate_missing(
    ready: PreparedStudy,
    store: Store,
    executor: Executor[Case, FlightResult],
    shard: Shard,
    retry_failed: bool,
    progress: Count,
) -> None:
    variants = len(ready.study.variants)
    status = store.statuses(ready.trials)
    missing = (status == 0) | (retry_failed & (status == 2))
    missing &= (np.arange(ready.trials) // variants) % shard.of == shard.number - 1
    requested = int(np.count_nonzero(missing))
    before = int(np.count_nonzero(status[~missing]))
    progress(before, before + requested)
    started, flight_count, start = monotonic(), 0, 0
    stopped = None
    try:
        for sample_count in interim_sizes(ready.study, ready.samples):
            numbers = np.flatnonzero(missing[start * variants : sample_count * variants])
            cases = Cases(ready.study, ready.samples, (numbers + start * variants).tolist())
            for count in _written(executor.fly(cases), store, ready):
                flight_count += count
                progress(before + flight_count, before + requested)
            start = sample_count
            stopped = stop_result(ready.study, store, ready.samples, sample_count)
            if stopped is not None:
                break
    finally:
        _write_record(store, flight_count, monotonic() - started, stopped)


def _written(
    results: Iterator[list[FlightResult]], store: Store, ready: PreparedStudy
) -> Iterator[int]:
    """Write results as parts and yield how many came; they are written after an error, too.

    Raises:
        BadInput: if their code or files have changed; those since the last part are not written.
    """

    def write() -> None:
        require_files(ready.study, ready.identity)
        store.add(waiting)

    waiting: list[FlightResult] = []
    last = monotonic()
    try:
        for some in results:
            waiting += some
            yield len(some)
            if monotonic() - last > _PART_TIME or len(waiting) > _PART_ROWS:
                write()
                waiting, last = [], monotonic()
    finally:
        if waiting:
            write()


def _write_record(
    store: Store, flight_count: int, seconds: float, stopped: dict[str, Any] | None
) -> None:
    before = flight_records(store)
    total = before.get("flown", 0) + flight_count
    elapsed = before.get("wall_time", 0.0) + (seconds if flight_count else 0.0)
    rate = (
        flight_count / seconds
        if flight_count and seconds > 0.0
        else before.get("trials_per_second")
    )
    note(store, flown=total, wall_time=elapsed, trials_per_second=rate, stopped=stopped)
