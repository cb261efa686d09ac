"""One trial from its file to its folder: bag, metrics.json and report.html."""

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from flexslew_control.controllers.controller import Controller
from flexslew_control.law import LawFailed
from flexslew_control.plan import Plan
from flexslew_control.planners.feedforward.optimized_feedforward import OptimizedFeedforward
from flexslew_control.planners.reference import ReferenceOnly
from flexslew_control.planners.slew import software_versions
from flexslew_control.plans.plan_file import save_plan
from flexslew_lab.json_text import json_text
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.files.read_limits import MIB, most
from flexslew_lab.log.recording.bag_observer import BagObserver
from flexslew_lab.log.recording.bag_writer import BagWriter, RecordingStopped
from flexslew_lab.metrics.from_bag import metrics_from
from flexslew_lab.metrics.goal import goal_error_message
from flexslew_lab.metrics.operator_changes import changes_of
from flexslew_lab.metrics.own import load_user_metrics
from flexslew_lab.metrics.platform.keep_out import cone_violations
from flexslew_lab.progress import phase
from flexslew_lab.report.handover_lines import handover_lines
from flexslew_lab.report.report import write_report
from flexslew_lab.run.domain import locked_domain
from flexslew_lab.run.in_process import run_bench
from flexslew_lab.run.outcome import Outcome
from flexslew_lab.run.prediction_gap import prediction_gap
from flexslew_lab.trial.angles import doubtful_angles
from flexslew_lab.trial.assumed_rest import assumed_rest
from flexslew_lab.trial.outputs import WITHOUT, new_folder
from flexslew_lab.trial.own_code import HASH_KEY, user_file_hashes
from flexslew_lab.trial.trial import Trial, plan_of_trial, set_plan, set_up, trial_text
from flexslew_plant.bench.bench import Bench
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.events import message_of
from flexslew_plant.own_code import Trust
from flexslew_plant.testbeds.contract import HasDoubts

Progress = Callable[[int, int], None]  # tick, last tick
# flies a trial in this process into a log, and reports its ticks
Fly = Callable[["PreparedTrial", BagObserver, Callable[[int], None]], None]
CHECK_FAILED = 1  # exit code of a run that is done and has failed one of its checks


class Result(NamedTuple):
    """What a run left behind."""

    folder: Path
    exit_code: int
    message: str
    metrics: dict[str, Any]
    bare_metrics: dict[str, Any]  # of the same trial without feedforward; empty where not flown
    changes: int = 0  # how often an operator changed it
    errors: tuple[LawFailed, ...] = ()  # of laws in this process


_ORIENTATION = 32  # of a tick, in the message alone [B]


class PreparedTrial(NamedTuple):
    """A trial with its bench, its controllers and its plan before tick 0."""

    trial: Trial
    bench: Bench
    controllers: dict[str, Controller]
    plan: Plan | None


class RunFeedback(NamedTuple):
    """What a run reports to its caller while it is prepared and flown."""

    progress: Progress = lambda tick, last: None  # receives the tick and the last tick
    notify: Callable[[str], None] = lambda words: None  # receives a line for the user
    # receives a line on a request that the run will not show; None: it goes to `notify`
    warn: Callable[[str], None] | None = None


SILENT = RunFeedback()


def run_trial(
    requested: Trial | PreparedTrial,
    source: str,
    out: Path | None = None,
    in_process: bool | Fly = False,
    report: bool = True,
    feedback: RunFeedback = SILENT,
    autostart: bool = True,
) -> Result:
    """Fly the trial, write its folder and return what came out.

    Args:
        requested: trial to fly; one that is prepared keeps its plan.
        source: its file, for messages and for the log.
        out: folder of the run; None: a new one below runs/.
        in_process: without ROS; a function flies it there in its own way.
        report: write report.html too.
        feedback: receives progress and messages.
        autostart: over ROS, fly as soon as all nodes are there; else when an operator starts it.

    Raises:
        BadInput, PlanFailed: before anything was written.
    """
    progress, notify = feedback.progress, feedback.notify
    warned = feedback.warn or (lambda words: notify(f"warning: {words}"))
    trial = requested if isinstance(requested, Trial) else requested.trial
    folder = new_folder(trial.name, out)
    if not in_process:
        from flexslew_lab.run.shared_memory import require_shared_memory

        require_shared_memory()
    for words in (*doubtful_angles(trial), *assumed_rest(trial)):  # such a goal may have no plan
        warned(words)
    prepared = prepare_trial(trial, source) if isinstance(requested, Trial) else requested
    load_user_metrics(
        trial.metrics, f"{source}: metrics", trial.trust
    )  # refused before anything is flown
    for words in _warnings(trial, prepared):
        warned(words)
    if prepared.plan is not None and prepared.plan.summary.get("believes"):
        notify(f"the plan assumes, unlike the bench: {prepared.plan.summary['believes']}")
    text = trial_text(trial)  # refused before anything is written
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "trial.yaml").write_text(text)
    metadata = {
        "trial_file": source,
        "versions": json.dumps(software_versions()),
        HASH_KEY: json.dumps(user_file_hashes(trial)),
    }
    bag = folder / "bag"
    if in_process:
        fly = _from_start_to_end if in_process is True else in_process
        outcome = _in_process(prepared, bag, metadata, progress, fly=fly)
    else:
        prepared.bench.close()  # a serial port is for the plant node alone
        outcome = _over_ros(trial, prepared.plan, folder, metadata, progress, notify, autostart)
    result, reader = _finished(folder, bag, outcome, trial.trust)
    errors = tuple(c.error for c in prepared.controllers.values() if c.error is not None)
    result = result._replace(errors=errors)
    words = prediction_gap(trial, prepared.plan, result.metrics)
    if words:
        warned(words)
    goal_error = goal_error_message(
        result.metrics, trial.goal_tolerance, trial.testbed.model().units_by_joint
    )
    failed = (goal_error, cone_violations(result.metrics))
    if any(failed) and not result.exit_code:
        words = "; ".join(filter(None, failed))
        result = result._replace(exit_code=CHECK_FAILED, message=words)
    if report and reader is not None and result.metrics and outcome.exit_code != 130:
        try:
            bare = None if result.changes else _without_feedforward(prepared, source, folder)
            with phase("writing the report"):
                write_report([reader], folder / "report.html", bare)
        except (RecordingStopped, OSError) as error:
            return _write_failure(result, error)
        if bare is not None:
            result = result._replace(bare_metrics=metrics_from(bare))
    return result


def _warnings(trial: Trial, prepared: PreparedTrial) -> Iterator[str]:
    """Yield a line on each request that the run will not show."""
    plan, fast_mode = prepared.plan, prepared.bench.fast_mode
    if plan is not None and plan.end > trial.duration:
        yield (
            f"the plan ends at {plan.end:g} s, the run at {trial.duration:g} s: "
            "the residual after the manoeuvre cannot be measured"
        )
    if isinstance(trial.testbed, HasDoubts):
        yield from trial.testbed.doubts()
    tips = trial.testbed.model().appendages.tip
    if tips.shape[1] and not tips.any():
        yield (
            f"no tip shows any mode, of {tips.shape[1]}: all tip deflections are 0 in the log, "
            "also while modes vibrate; see the modes in the report"
        )
    if fast_mode is not None:
        yield message_of(fast_mode)
    if plan is not None and "warning" in plan.summary:
        yield f"plan: {plan.summary['warning']}"


def finished(folder: Path, trust: Trust, report: bool = True) -> None:
    """Write metrics.json, and report.html too, of a run that others have flown.

    Args:
        folder: of the run, with its bag.
        trust: which classes that its trial names may be loaded.
        report: with the report.
    """
    reader = BagReader(folder / "bag", trust=trust.with_files())
    (folder / "metrics.json").write_text(json_text(metrics_from(reader)) + "\n")
    if report:
        write_report([reader], folder / "report.html")


def prepare_trial(
    trial: Trial, source: str, plan_of: Callable[[Trial], Plan | None] = plan_of_trial
) -> PreparedTrial:
    """Return what the trial flies in process, with the plan adopted.

    Args:
        trial: trial to fly.
        source: its file, for messages.
        plan_of: returns its plan, for example one that was made before.

    Raises:
        BadInput, PlanFailed: with the place in the trial file.
    """
    bench, controllers = set_up(trial, source)
    try:
        plan = plan_of(trial)
    except BadInput as error:  # the error names its key
        raise BadInput(str(error), source) from None
    except PlanFailed as error:
        raise PlanFailed(f"{source}: plan: {error}") from None
    if plan is not None:
        _require_plan_size(plan, source)
    if (reason := set_plan(controllers, trial.active, plan)) is not None:
        raise BadInput(f"{trial.active} is not ready: {reason}", source, "plan")
    return PreparedTrial(trial, bench, controllers, plan)


def _require_plan_size(plan: Plan, source: str) -> None:
    """Refuse a plan that is too large for the log to be read back."""
    arrays = (plan.position, plan.velocity, plan.effort, plan.state, plan.gains)
    size = sum(array.nbytes for array in arrays) + _ORIENTATION * (plan.ticks + 1) + MIB
    if size > most("a chunk"):
        words = (
            f"takes {size / MIB:.0f} MiB of the log, which is read up to {most('a chunk') / MIB:g};"
            " take a longer period, or raise the limit with --largest-chunk"
        )
        raise BadInput(f"{source}: plan: {words}")


def _from_start_to_end(
    prepared: PreparedTrial, observer: BagObserver, progress: Callable[[int], None]
) -> None:
    trial, bench, controllers, plan = prepared
    observer.notify(trial, bench, plan, controllers)
    run_bench(bench, controllers, observer, progress)


def _in_process(
    prepared: PreparedTrial,
    bag: Path,
    metadata: dict[str, str],
    progress: Progress,
    bare: bool = False,
    fly: Fly = _from_start_to_end,
) -> Outcome:
    bench = prepared.bench
    last = bench.last_tick or 0
    with BagWriter(bag, {"trial": trial_text(prepared.trial), **metadata}) as writer:
        observer = BagObserver(writer, bare)
        fly(prepared, observer, lambda tick: progress(tick, last))
        try:
            observer.close()
        except RecordingStopped as error:
            if bare:
                raise
            return Outcome(3, str(error))
    words = bench.failure or "a controller fell silent" * bench.faulted
    return Outcome(3 if bench.faulted else 0, words)


def _without_feedforward(flown: PreparedTrial, source: str, folder: Path) -> BagReader | None:
    """Fly the same reference without feedforward, in process; return its bag, if any."""
    trial = flown.trial
    plan = trial.plan
    if not isinstance(plan, OptimizedFeedforward) or flown.bench.own_clock:
        return None  # a rig moves once, as was requested
    keys = ("model", "initial", "goal", "start", "duration", "reference", "feedback")
    bare = ReferenceOnly(**{key: getattr(plan, key) for key in keys})
    bag = folder / WITHOUT
    other = replace(trial, name=f"{trial.name}-without-feedforward", plan=bare)
    with phase("flying without feedforward", "ticks") as count:
        prepared = prepare_trial(other, source)
        _in_process(prepared, bag, {"trial_file": source}, count, bare=True)
    return BagReader(bag, trust=trial.trust.with_files())


def _over_ros(
    trial: Trial,
    plan: Plan | None,
    folder: Path,
    metadata: dict[str, str],
    progress: Progress,
    notify: Callable[[str], None],
    autostart: bool,
) -> Outcome:
    # what starts nodes is of Linux alone, as ROS is here
    from flexslew_lab.run.processes import node_processes, parameter_file
    from flexslew_lab.run.supervisor import Supervisor

    plan_file = folder / "plan.yaml" if plan is not None else None  # made once, for the node too
    if plan is not None:
        save_plan(plan, folder / "plan.yaml")
    processes = node_processes(trial, folder, True, metadata, plan_file, autostart=autostart)
    parameters = folder / "parameters.yaml"
    parameters.write_text(parameter_file(processes))
    with locked_domain(trial.name, folder) as domain:
        notify(f"ROS_DOMAIN_ID {domain}: {', '.join(p.name for p in processes)}")
        supervisor = Supervisor(processes, parameters, folder / "nodes.log", domain, progress)
        return supervisor.run()


def _finished(
    folder: Path, bag: Path, outcome: Outcome, trust: Trust
) -> tuple[Result, BagReader | None]:
    """Write metrics.json; return what is known of the run, and its bag where there is one."""
    result = Result(folder, outcome.exit_code, outcome.message, {}, {})
    reader = None
    try:
        reader = BagReader(bag, trust=trust.with_files())
        changes = len(changes_of(reader.overview.events))
        result = result._replace(metrics=metrics_from(reader), changes=changes)
        if outcome.exit_code == 3:
            words = handover_lines(reader.overview.events)
            if not words or not result.metrics["log_complete"]:
                words.append(outcome.message)
            result = result._replace(message="; ".join(words))
        (folder / "metrics.json").write_text(json_text(result.metrics) + "\n")
    except (BadInput, OSError) as error:
        if outcome.exit_code != 130:  # an interrupted run may hold no tick at all
            result = _write_failure(result, error)
    return result, reader


def _write_failure(result: Result, error: Exception) -> Result:
    """Return a result with the error of an incomplete write, and exit code 3."""
    words = "; ".join(part for part in (result.message, str(error)) if part)
    return result._replace(exit_code=3, message=words)
