"""Bench, analysis and study as functions: what `import flexslew` offers beside flying."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexslew_lab.notebook import What, trial_from
from flexslew_lab.trial.trial import bench_settings
from flexslew_plant.bench.bench import Bench

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

    Args:
        file: a study file, or the name of a shipped one.
        folder: of the study; None: runs/study-NAME.
        workers: processes.

    Raises:
        BadInput: no such study, or one of its values is not allowed.
        ModuleNotFoundError: pyarrow is not installed.
    """
    from flexslew_lab.run.pool import Pool
    from flexslew_lab.studies.finish import finished
    from flexslew_lab.studies.run import default_folder, prepare, run_study
    from flexslew_lab.studies.study import load_study, study_path
    from flexslew_plant.own_code import ANY_CODE

    asked = load_study(study_path(str(file)), ANY_CODE)
    ready = prepare(asked)
    executor = Pool(ready.job, workers)
    try:
        store = run_study(ready, Path(folder or default_folder(asked)), executor)
    finally:
        executor.close()
    return finished(asked, store)
