"""Bench, analysis and study as functions: what `import flexslew` offers beside flying."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexslew_lab.notebook import What, trial_from
from flexslew_lab.trial.trial import bench_settings
from flexslew_plant.bench.bench import Bench
from flexslew_plant.errors import BadInput
from flexslew_plant.extras import required

if TYPE_CHECKING:
    from flexslew_lab.analysis.analysis import Analysis


def bench(what: What = "m1") -> Bench:
    """Return the bench of a trial at tick 0, to be stepped by hand.

    Args:
        what: as from `trial`, or what `trial` takes.

    Raises:
        BadInput: no such trial, or one of its values is not allowed.
    """
    return Bench(bench_settings(trial_from(what)))


def analyse(what: What = "m1", controller: str | None = None, at: float | None = None) -> Analysis:
    """Return modes, poles, margins and responses of a trial's loop about a rest.

    Args:
        what: as from `trial`, or what `trial` takes.
        controller: of the trial; None: the one that its schedule has put in charge then.
        at: simulated time [s]: the rest that the plan passes then; None: the start.

    Raises:
        BadInput: no such trial or controller, or the law has no linear form.
    """
    from flexslew_lab.analysis.analysis import analysed

    return analysed(trial_from(what), "trial", controller, at, {})


def study(file: str | Path, folder: Path | str | None = None, workers: int = 1) -> dict[str, Any]:
    """Return what a study shows, after flying what is missing of it; what --json prints.

    As the command does, it flies some trials of the lanes again by the ordinary bench, and the
    worst ones again with their logs where the file says `keep`.

    Args:
        file: a study file, or the name of a shipped one.
        folder: of the study; None: runs/study-NAME.
        workers: processes, at least 1.

    Raises:
        BadInput: no such study, or one of its values is not allowed.
        ModuleNotFoundError: pyarrow is not installed.
    """
    required("pyarrow")
    from flexslew_lab.run.pool import Pool
    from flexslew_lab.studies.finish import finished, keep_worst
    from flexslew_lab.studies.lanes.check import bench_job, check_lanes
    from flexslew_lab.studies.run import default_folder, prepare, run_study
    from flexslew_lab.studies.study import load_study, study_path
    from flexslew_plant.own_code import ANY_CODE

    if workers < 1:
        raise BadInput("at least 1", key="workers", value=workers)
    asked = load_study(study_path(str(file)), ANY_CODE)
    ready = prepare(asked)
    with closing(Pool(ready.job, workers)) as executor:
        store = run_study(ready, Path(folder or default_folder(asked)), executor)
    if asked.settings.lanes:
        with closing(Pool(bench_job(ready), workers)) as executor:
            check_lanes(ready, store, executor)
    found = finished(asked, store)
    keep_worst(asked, store, lambda words: None)  # why a trial has no log, its row says
    return found
