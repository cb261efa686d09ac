"""What follows the last trial: worst trials again with a log, the summary and the page."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from flexslew_control.plan import Plan
from flexslew_lab.progress import phase
from flexslew_lab.run.run_trial import Result, RunFeedback, prepare_trial, run_trial
from flexslew_lab.studies.batch.tolerance import TOLERANCE, relative_difference
from flexslew_lab.studies.cases import case_of, case_trial
from flexslew_lab.studies.disk import checked_folder
from flexslew_lab.studies.findings.columns import column, worst_of
from flexslew_lab.studies.findings.summary import summary
from flexslew_lab.studies.flight import columns_of
from flexslew_lab.studies.run import PreparedStudy, flight_records
from flexslew_lab.studies.store import Store
from flexslew_lab.studies.study import Study
from flexslew_lab.trial.trial import Trial
from flexslew_plant.errors import FlexslewError, RunFault

_WORST = "worst"


def finished(study: Study, store: Store) -> dict[str, Any]:
    """Return the summary of a study after writing its page to its folder."""
    from flexslew_lab.studies.findings.page import study_page

    with phase("writing the report"):
        found = summary(study, store, flight_records(store))
        page = store.write_text("report.html", study_page(study, store, found))
    return found | {"report": str(page)}


def repeat_trial(
    study: Study,
    store: Store | None,
    number: int,
    out: Path | None,
    notify: Callable[[str], None] = lambda words: None,
    plan_of: Callable[[Trial], Plan | None] | None = None,
) -> tuple[Result, str]:
    """Fly one trial with its full log; return it and how it differs from the study's table.

    Args:
        study: its file.
        store: its folder, if there is one.
        number: number of the trial.
        out: folder of the run; None: a new one below runs/.
        notify: called with the messages and the warnings of the flight.
        plan_of: returns the plan of a trial that was made before; None: it is planned again.

    Raises:
        BadInput: if the study has no such trial, or it cannot be flown.
    """
    from flexslew_lab.studies.cases import sample_table

    samples = store.samples if store is not None else sample_table(study)
    trial = case_trial(study, case_of(study, samples, number))
    source = f"{study.source}: trial {number}"
    requested = prepare_trial(trial, source, plan_of) if plan_of else trial
    result = run_trial(
        requested, source, out, in_process=True, report=False, feedback=RunFeedback(notify=notify)
    )
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


def keep_worst(ready: PreparedStudy, store: Store, notify: Callable[[str], None]) -> list[Path]:
    """Fly the worst trials again with their logs, as `keep.bags` requires; return their folders.

    Args:
        ready: the study, with the plans that its trials share; they are not made again.
        store: its folder, with the table.
        notify: called with the reason why a trial has no log.
    """
    study = ready.study
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
    with phase(f"flying the worst {len(requested)} again, with their logs", "trials") as count:
        for done, number in enumerate(requested):
            count(done, len(requested))
            folder = checked_folder(place / str(number))
            if (folder / "metrics.json").is_file() or (
                _logged(ready, store, number, folder, notify)
            ):
                paths.append(folder)
    return paths


def _logged(
    ready: PreparedStudy, store: Store, number: int, folder: Path, notify: Callable[[str], None]
) -> bool:
    """Fly a trial of the table again into its folder; return whether that has its log."""
    if folder.exists():
        shutil.rmtree(folder)
    row = store.table(["status", "reason"], [number])
    try:
        if row["status"][0].as_py() != "ok":
            raise RunFault(row["reason"][0].as_py())
        repeat_trial(ready.study, store, number, folder, plan_of=ready.plans.of)
    except FlexslewError as error:
        notify(f"trial {number}: no log: {error}")
        return False
    return True
