"""The commands as functions: those that `import flexslew` offers in addition to flying."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexslew_control.plan import Plan
from flexslew_lab.flight import Flight
from flexslew_lab.given_objects import require_in_files
from flexslew_lab.named import names_in
from flexslew_lab.notebook import What, place, plain_data, trial_from
from flexslew_lab.progress import display_library_progress
from flexslew_lab.trial.outputs import bag_folder
from flexslew_lab.trial.trial import Trial, bench_settings, plan_of_trial
from flexslew_plant.bench.bench import Bench
from flexslew_plant.errors import BadInput
from flexslew_plant.extras import required
from flexslew_plant.near_names import spelling_hint
from flexslew_plant.own_code import ANY_CODE, NO_CODE, Trust
from flexslew_plant.settings import validated

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from flexslew_lab.analysis.analysis import Analysis
    from flexslew_lab.analysis.proof import Proof
    from flexslew_lab.budget.budget import Budget
    from flexslew_lab.budget.prove import ProvedBudget
    from flexslew_lab.comparison.comparison import Comparison
    from flexslew_lab.gains.search import FoundGains
    from flexslew_lab.guarantee.model.parameters import Vary
    from flexslew_lab.guarantee.model.uncertain_model import UncertainModel
    from flexslew_lab.guarantee.worst_case import WorstCase
    from flexslew_lab.identification.identification import Experiment, Identification
    from flexslew_lab.studies.study import Study
    from flexslew_lab.tuning.tuned import TunedController


def bench(what: What = "m1") -> Bench:
    """Return the bench of a trial at tick 0, to be stepped by hand.

    Args:
        what: as from `trial`, or what `trial` takes.

    Raises:
        BadInput: no such trial, or one of its values is not allowed.
    """
    return Bench(bench_settings(trial_from(what)))


def plan(what: What = "m1") -> Plan:
    """Return the plan of a trial without flying it; `trial(..., plan=it)` is flown by it.

    Args:
        what: trial from `trial`, or an argument of `trial`.

    Raises:
        BadInput: if there is no such trial, a value is not allowed, or it has no plan.
        PlanFailed: if there is no such plan; the message gives the reason.
    """
    given = trial_from(what)
    with display_library_progress(given.name):
        made = plan_of_trial(given)
    if made is None:
        raise BadInput(f"{given.name} has no plan: is missing", key="plan")
    return made


def analyse(
    what: What = "m1",
    controller: str | None = None,
    at: float | str | None = None,
    **joints: float | str,
) -> Analysis:
    """Return modes, poles, margins and responses of a trial's loop about a rest.

    Args:
        what: as from `trial`, or what `trial` takes.
        controller: of the trial; None: the one that its schedule has put in charge then.
        at: simulated time [s], or with a unit: the rest that the plan passes then; None: the start.
        joints: where joints rest instead, by name [rad or m], or with a unit: `30 deg`.

    Raises:
        BadInput: no such trial, controller or joint, or the law has no linear form.
    """
    from flexslew_lab.analysis.analysis import loop_analysis

    given = trial_from(what)
    with display_library_progress(given.name, words="analysing"):
        return loop_analysis(given, "trial", controller, at, joints)


def budget(
    what: What = "m1",
    require: Mapping[str, float | str] | None = None,
    vary: Vary | None = None,
    **how: Any,
) -> Budget:
    """Return the pointing budget of a trial after its manoeuvre, by error source.

    Args:
        what: as from `trial`, or what `trial` takes.
        require: largest values by metric, or by metric and axis ("RPE.x"), [rad or m] or with a
            unit.
        vary: errors of the model: name to half of the range, relative, or to its ends.
        **how: controller, window [s], drift [s], level [-], interpretation: see BudgetRequest.

    Raises:
        BadInput: if there is no such trial, its loop is not stable or not linear, or a value is
            not allowed.
    """
    from flexslew_lab.budget.budget import BudgetRequest
    from flexslew_lab.budget.pointing_budget import pointing_budget

    given = trial_from(what)
    known = [one.name for one in fields(BudgetRequest) if one.name not in ("require", "vary")]
    for name in how:
        if name not in known:
            hint = spelling_hint(name, known)
            raise BadInput(f"budget: unknown {name}; {hint}allowed: {', '.join(known)}")
    request = BudgetRequest(**how, require=dict(require or {}), vary=dict(vary or {}))
    with display_library_progress(given.name, words="adding up error sources"):
        return pointing_budget(given, given.name, request)


def prove_budget(what: What, found: Budget, members: int = 100) -> ProvedBudget:
    """Return the total of a budget with that of flights of the bench, each of its own seed.

    Args:
        what: trial of the budget.
        found: result of `budget`.
        members: how many flights, at least 2.

    Raises:
        BadInput: if the budget has errors of the model, or a flight fails.
    """
    from flexslew_lab.budget.prove import prove_budget as proved

    given = trial_from(what)
    with display_library_progress(given.name, "members", "flying") as update:
        return proved(given, given.name, found, _count(members, "members"), update)


def prove(what: What, found: Analysis) -> Proof:
    """Return poles and margins of an analysis with those of the bench, flown to their edges.

    Args:
        what: analysed trial.
        found: result of `analyse`.

    Raises:
        BadInput: if the loop is not stable, or its plant varies in time or is not the trial's.
    """
    from flexslew_lab.analysis.proof import verify_margins

    given = trial_from(what)
    with display_library_progress(given.name, words="flying at both sides of the margins"):
        return verify_margins(given, found)


def uncertain_model(what: What, vary: Vary, at: float | str | None = None) -> UncertainModel:
    """Return the sampled plant of a trial as a linear fractional form in uncertain parameters.

    Its `system` is M of python-control, with w = Delta v around it; `save` writes a .mat file.

    Args:
        what: as from `trial`, or what `trial` takes.
        vary: name to half of the range, relative (0.2 or "20 %"), or to its ends ([0.5, 2.0]);
            names: stiffness, payload, gain, gain.JOINT, lag, delay, testbed.KEY.
        at: simulated time [s], or with a unit; None: the start.

    Raises:
        BadInput: if there is no such trial, or a parameter is not understood.
    """
    from flexslew_lab.guarantee.model.uncertain_model import uncertain_model_of

    given = trial_from(what)
    with display_library_progress(given.name, words="fitting"):
        return uncertain_model_of(given, vary, at)


def worst_case(
    what: What = "m1",
    vary: Vary | None = None,
    controller: str | None = None,
    at: float | str | None = None,
    seconds: float = 60.0,
    **joints: float | str,
) -> WorstCase:
    """Return bounds of stability and of S and T over all values of uncertain parameters.

    Args:
        what: as from `trial`, or what `trial` takes.
        vary: as for `uncertain_model`; None: stiffness and payload +-20 %.
        controller: as for `analyse`.
        at: as for `analyse`.
        seconds: of the processor for all of it.
        **joints: as for `analyse`.

    Raises:
        BadInput: as `analyse`, if a parameter is not understood, or the loop is not stable.
    """
    from flexslew_lab.guarantee.bounds import worst_case_of

    given = trial_from(what)
    found = analyse(given, controller, at, **joints)
    with display_library_progress(given.name, words="bounding the worst case"):
        return worst_case_of(given, found, vary, seconds)


def gains(
    what: What = "m1",
    controller: str | None = None,
    keys: Sequence[str] = (),
    margin: float | None = None,
    trials: int = 200,
    octaves: float = 2.0,
    seed: int = 1,
) -> FoundGains:
    """Return the gains with the least worst residual that keep a disk margin.

    Args:
        what: as from `trial`, or what `trial` takes.
        controller: of it; None: the one in charge.
        keys: of its section; none: those that its law names as gains.
        margin: disk margin at the plant's input to be kept; None: that of the trial's own gains.
        trials: how many choices are flown, on benches with errors of stiffness and payload.
        octaves: each gain is multiplied by 2^-octaves to 2^octaves.
        seed: of the search.

    Raises:
        BadInput: no such trial, controller or gains, no manoeuvre, or no choice keeps the margin.
        ModuleNotFoundError: optuna or pyarrow is not installed.
    """
    required("optuna")
    from flexslew_lab.gains.ensemble import GainEnsemble, gains_of
    from flexslew_lab.gains.search import search_gains

    given = trial_from(what)
    selected_gains = gains_of(given, given.name, controller, keys)
    count = _count(trials, "trials")
    with display_library_progress(given.name, "choices", "flying") as update:
        ensemble = GainEnsemble(given, given.name, selected_gains)
        return search_gains(
            ensemble, selected_gains, count, octaves, margin, seed=seed, progress=update
        )


def tune(
    what: str | Path | Mapping[str, Any],
    base: What | None = None,
    state: Path | str | None = None,
) -> TunedController:
    """Return the best controller of a given structure against goals on several models.

    Its `trial` flies it, `goals` are met or not, `analysis` analyses its loop.

    Args:
        what: a tuning file, the name of a shipped one, or its keys.
        base: trial that is tuned, as from `trial`; None: the one that the tuning names.
        state: file that keeps every start as it ends, and from which the tuning goes on; None:
            nothing is kept.

    Raises:
        BadInput: if there is no such tuning, a value is not allowed, or no start leads to a stable
            loop.
        ModuleNotFoundError: if ctrlsys is not installed.
    """
    required("ctrlsys")
    from flexslew_lab.tuning.tuned import tune_structure
    from flexslew_lab.tuning.tuning_file import read_tuning

    keys = plain_data(dict(what)) if isinstance(what, Mapping) else what
    problem = read_tuning(keys, None if base is None else trial_from(base))
    kept = None if state is None else place(state, "state")
    with display_library_progress(problem.settings.tuning, "evaluations", "tuning") as update:
        return tune_structure(problem, kept, update)


def compare(what: What = "m1", laws: bool = False, workers: int = 1) -> Comparison:
    """Return what every planner does with the manoeuvre of a trial, also on other benches.

    Args:
        what: as from `trial`, or what `trial` takes.
        laws: what every law does instead.
        workers: processes that plan and fly, at least 1.

    Raises:
        BadInput: no such trial, or it has no manoeuvre that can be compared.
    """
    from flexslew_lab.comparison.comparison import compare_candidates
    from flexslew_lab.comparison.laws import laws as by_laws
    from flexslew_lab.comparison.planners import planners

    given = trial_from(what)
    if _count(workers, "workers") > 1:
        require_in_files(given)
    with display_library_progress(given.name, "plans and flights") as update:
        return compare_candidates(
            (by_laws if laws else planners)(given, given.name), update, workers
        )


def identify(
    *runs: Path | str,
    band: tuple[float, float] | None = None,
    fit: Sequence[str] = (),
    start: Mapping[str, float] | None = None,
    columns: Mapping[str, Any] | None = None,
    trust: Trust = NO_CODE,
) -> Identification:
    """Return the modes, inertias and parameters of a bench, identified from recorded runs.

    Args:
        runs: run folders or bags, or files of another bench, at least one; the first gives the
            model, the others prove it.
        band: excited band, low and high [rad/s]; None: that of the excitation.
        fit: keys of the testbed to fit, as `parameters.bending_stiffness`.
        start: key to number, the start of a fit.
        columns: of files of another bench, as the command's options: inputs ["u=hub"], outputs
            ["x=position.hub", "a=acc.tip"], period, past, hold, time, time_unit, stamps; None: the
            runs are of this bench.
        trust: testbed class of the user's own that may be loaded.

    Raises:
        BadInput: if there is no such run, or it is not sufficient; the message gives the numbers.
    """
    from flexslew_lab.identification.identification import experiment_of
    from flexslew_lab.identification.identification import identify as identified

    if not runs:
        raise BadInput("give the folder of a run")
    if any(isinstance(run, Flight) for run in runs):
        raise BadInput(
            "a flight keeps no log; fly it into one, fs.fly(trial, 'runs/shaken'), and give that",
            "runs",
        )
    if columns is None:
        experiments = [experiment_of(place(run, "runs"), trust) for run in runs]
    else:
        experiments = _from_files([place(run, "runs") for run in runs], columns)
    with display_library_progress("identification"):
        return identified(experiments, band, tuple(fit), dict(start or {}))


def _from_files(files: Sequence[Path], columns: Mapping[str, Any]) -> list[Experiment]:
    """Return experiments in files of another bench; their notes are warnings at the call."""
    from flexslew_lab.identification.records.file_experiment import FileColumns, experiment_of_file

    chosen: FileColumns = validated(FileColumns, dict(columns), "columns")
    found = []
    for path in files:
        experiment, notes = experiment_of_file(bag_folder(path), chosen)
        found.append(experiment)
        for words in notes:
            warnings.warn(f"{path}: {words}", stacklevel=3)
    return found


def study(
    what: str | Path | Mapping[str, Any],
    folder: Path | str | None = None,
    workers: int = 1,
) -> dict[str, Any]:
    """Return what a study shows, after flying what is missing of it; what --json prints.

    As the command does, it flies some trials of the batches again by the ordinary bench, and the
    worst ones again with their logs where the file has `keep`.

    Args:
        what: a study file, the name of a shipped one, or the keys of one, of which `trial` may be
            a Trial, or its keys.
        folder: of the study; None: runs/study-NAME.
        workers: processes, at least 1.

    Raises:
        BadInput: no such study, or one of its values is not allowed.
        ModuleNotFoundError: pyarrow is not installed.
    """
    required("pyarrow")
    from flexslew_lab.run.pool import Pool
    from flexslew_lab.studies.batch.check import bench_job, check_batch
    from flexslew_lab.studies.finish import finished, keep_worst
    from flexslew_lab.studies.run import default_folder, prepare, run_study
    from flexslew_lab.trial.outputs import check_output_folder

    _count(workers, "workers")
    request = _study_from(what)
    kept = check_output_folder(place(folder or default_folder(request), "folder"), "folder")
    with display_library_progress(request.settings.study):
        ready = prepare(request)
        with closing(Pool(ready.job, workers)) as executor:
            store = run_study(ready, kept, executor)
        if request.settings.batch:
            with closing(Pool(bench_job(ready), workers)) as executor:
                check_batch(ready, store, executor)
        found = finished(request, store)
        keep_worst(ready, store, lambda words: None)  # its row gives the reason for a missing log
    return found


def plot(
    *runs: Flight | Path | str,
    show: str | Sequence[str] = (),
    to: Path | str | None = None,
    style: str = "ieee",
    width: str | float | None = None,
    labels: Sequence[str] = (),
    latex: bool = False,
) -> Figure:
    """Return a figure of runs for a paper, by Matplotlib; its legend names what differs.

    Args:
        runs: flights, or folders of runs.
        show: channels, such as "tip,effort"; none: position, tip and effort.
        to: file, PDF, SVG or PNG; None: it is not saved.
        style: medium: ieee, ieee_wide, elsevier, thesis or slides.
        width: width with its unit, such as "88 mm", or [m]; None: that of the medium.
        labels: names of the runs; none: the keys of their trials that differ.
        latex: whether LaTeX sets the text.

    Raises:
        BadInput: if there is no such run, channel or style, or the file cannot be written.
        ModuleNotFoundError: if Matplotlib is not installed.
    """
    from flexslew_lab.publication.channels import labelled_runs
    from flexslew_lab.publication.figure import draw_runs

    target = None if to is None else place(to, "to")
    return draw_runs(labelled_runs(runs, labels), names_in(show), target, style, width, latex)


def _count(given: Any, key: str) -> int:
    if not isinstance(given, int | np.integer) or given < 1:
        raise BadInput("a whole number, at least 1", key=key, value=given)
    return int(given)


def _study_from(what: str | Path | Mapping[str, Any]) -> Study:
    """Return a study, checked.

    Raises:
        BadInput: see study.
    """
    from flexslew_lab.studies.study import load_study, study_of_values, study_path

    if not isinstance(what, Mapping):
        return load_study(study_path(str(what)), ANY_CODE)
    given, keys = what.get("trial"), dict(what)
    study_trial = trial_from(given) if isinstance(given, Trial | Mapping) else None
    if study_trial is not None:
        require_in_files(study_trial)
        keys["trial"] = study_trial.name
    return study_of_values(plain_data(keys), "study", Path(), ANY_CODE, study_trial)
