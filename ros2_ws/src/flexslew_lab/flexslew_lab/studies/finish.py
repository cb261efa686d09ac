"""What follows the last trial: worst trials again with a log, the summary and the page."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from flexslew_lab.run.run_trial import Result, run_trial
from flexslew_lab.studies.batch.tolerance import TOLERANCE, relative_difference
from flexslew_lab.studies.cases import case_of, case_trial
from flexslew_lab.studies.disk import checked_folder
from flexslew_lab.studies.findings.columns import column, worst_of
from flexslew_lab.studies.findings.summary import summary
from flexslew_lab.studies.flight import FlightResult, PlanCache, columns_of, simulate_case
from flexslew_lab.studies.run import flight_records
from flexslew_lab.studies.store import Store
from flexslew_lab.studies.study import Study

_WORST = "worst"


def finished(study: Study, store: Store) -> dict[str, Any]:
    """Return the summary of a study after writing its page to its folder."""
    from flexslew_lab.studies.findings.page import study_page

    found = summary(study, store, flight_records(store))
    page = store.write_text("report.html", study_page(study, store, found))
    return found | {"report": str(page)}


def repeat_trial(
    study: Study,
    store: Store | None,
    number: int,
    out: Path | None,
    notify: Callable[[str], None] = lambda words: None,
) -> tuple[Result, str]:
    """Fly one trial with its full log; return it and how it differs from the study's table.

    Args:
        study: its file.
        store: its folder, if there is one.
        number: number of the trial.
        out: folder of the run; None: a new one below runs/.
        notify: called with the messages and the warnings of the flight.

    Raises:
        BadInput: if the study has no such trial, or it cannot be flown.
    """
    from flexslew_lab.studies.cases import sample_table

    samples = store.samples if store is not None else sample_table(study)
    trial = case_trial(study, case_of(study, samples, number))
    source = f"{study.source}: trial {number}"
    result = run_trial(trial, source, out, in_process=True, report=False, notify=notify)
    if store is None or not store.table_path.is_file():
        return result, ""
    return result, _difference(store, number, result.metrics)


def _difference(store: Store, number: int, metrics: dict[str, Any]) -> str:
    """Return how a trial differs from its row: by its hash, or by its metrics if it has none."""
    columns = ["trajectory_hash", "status", *store.identity["columns"]]
    rows = store.table(columns, [number])
    if not rows.num_rows or rows["status"][0].as_py() != "ok":
        return ""
    known = rows["trajectory_hash"][0].as_py()
    if known is not None:
        same = known == metrics.get("trajectory_hash")
        return "" if same else f"its trajectory hash was {known} in the study"
    repeated = columns_of(metrics, store.user_keys)
    for name in store.identity["columns"]:
        before = rows[name][0].as_py()
        if not relative_difference(before, repeated.get(name)) <= TOLERANCE:
            return f"its {name} was {before} in the study, flown in a batch"
    return ""


def keep_worst(study: Study, store: Store, notify: Callable[[str], None]) -> list[Path]:
    """Fly the worst trials again with their logs, as `keep.bags` requires; return their folders.

    Args:
        study: its file.
        store: its folder, with the table.
        notify: called with the reason why a trial has no log.
    """
    words = study.settings.keep.bags.split()
    if words[0] == "none":
        return []
    name = next(iter(study.settings.criteria), "residual_tip_deflection")
    paths = []
    found, _ = column(study, store, name, None)
    requested = found.numbers[worst_of(found, int(words[1]))].tolist()
    place = checked_folder(store.folder / _WORST)
    for path in sorted(place.glob("*")) if place.is_dir() else []:
        if not path.name.isdigit() or int(path.name) not in requested:
            shutil.rmtree(checked_folder(path))
    for number in requested:
        folder = checked_folder(place / str(number))
        if not (folder / "metrics.json").is_file():
            if folder.exists():
                shutil.rmtree(folder)
            repeated = repeat_in_process(study, store, number)
            if repeated.status != "ok":
                notify(f"trial {number}: no log: {repeated.reason}")
                continue
            repeat_trial(study, store, number, folder)
        paths.append(folder)
    return paths


def repeat_in_process(study: Study, store: Store, number: int) -> FlightResult:
    """Return what the ordinary bench makes of a trial of a study."""
    return simulate_case(study, case_of(study, store.samples, number), PlanCache())
