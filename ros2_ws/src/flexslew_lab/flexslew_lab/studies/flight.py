"""One trial of a study flown in process: its metrics, or why there are none."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, NamedTuple

from flexslew_control.controllers import CONTROLLERS
from flexslew_control.plan import Plan
from flexslew_control.planners.attitude.one_axis import RELEVANT
from flexslew_lab.metrics import Key, Metric
from flexslew_lab.metrics.own import keys_of, load_user_metrics
from flexslew_lab.metrics.rows import AXES, NO_KEYS, flat, key_of
from flexslew_lab.run.in_process import run_bench
from flexslew_lab.run.metrics_observer import MetricsObserver
from flexslew_lab.studies.cases import Case, case_trial, nominal_of
from flexslew_lab.studies.study import Study
from flexslew_lab.studies.ways import Way
from flexslew_lab.trial.trial import (
    Trial,
    feedback_of,
    law_in_charge,
    law_of,
    plan_of_trial,
    set_plan,
    set_up,
)
from flexslew_plant.bench.bench import Bench
from flexslew_plant.bench.retarget import with_schedule
from flexslew_plant.bench.schedule import command_delay_ticks
from flexslew_plant.errors import BadInput, FlexslewError, PlanFailed
from flexslew_plant.events import (
    BrakeActivated,
    ControllerNotReady,
    ControllerReady,
    Fact,
    message_of,
)
from flexslew_plant.own_code import one_line
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import Testbed, initial_positions

_LEFT_OUT = ("wall_time", "trajectory_hash", "missing_ticks", "log_complete", "warnings")


class FlightResult(NamedTuple):
    """What became of one trial."""

    number: int
    metrics: dict[str, float | None]  # by column; empty if it failed
    trajectory_hash: str | None
    status: str  # ok or failed
    reason: str  # why it failed
    way: Way


@dataclass
class PlanCache:
    """Plans of a study: the same request gets the same plan, or the same refusal, once made."""

    made: dict[str, Plan | FlexslewError] = field(default_factory=dict)

    def of(self, trial: Trial, key: str | None = None) -> Plan | None:
        """Return the trial's plan.

        Args:
            trial: that flies it.
            key: its plan_key, if that is known already.

        Raises:
            BadInput, PlanFailed: see make_plan.
        """
        if trial.plan is None:
            return None
        found = self.made.get(key or plan_key(trial)) or _made(trial)
        if isinstance(found, FlexslewError):
            raise found
        return found

    def keep(self, trial: Trial) -> None:
        """Make the trial's plan now, for all that ask for the same one."""
        if trial.plan is not None and plan_key(trial) not in self.made:
            self.made[plan_key(trial)] = _made(trial)


def _made(trial: Trial) -> Plan | FlexslewError:
    try:
        plan = plan_of_trial(trial, predict=False)  # the study flies it
    except BadInput as error:  # its message names the key
        return error
    except PlanFailed as error:
        return PlanFailed(f"plan: {error}")
    assert plan is not None
    return plan


def plan_key(trial: Trial) -> str:
    """Return what a trial's plan depends on, as text: less where its beliefs are written out."""
    plan = plain(trial.plan) or {}
    late = command_delay_ticks(trial.schedule, trial.testbed.model().joint_names, 0.0)
    motors = [plain(trial.actuator), late.tolist()]
    inputs = [plan, trial.period, list(trial.testbed.effort_limit), motors]
    if uses_testbed(plan, trial.testbed):
        inputs.append(plain(with_schedule(trial.testbed, trial.schedule)))
    elif "model" not in plan:
        inputs.append(initial_positions(trial.testbed))
    if not plan.get("feedback"):
        inputs.append(plain(feedback_of(trial)))
    if (plan.get("model") or {}).get("modes") == RELEVANT:  # chosen as the law flies them
        inputs.append(law_in_charge(trial))
    return json.dumps(inputs, sort_keys=True)


def uses_testbed(plan: Mapping[str, Any], testbed: Testbed) -> bool:
    """Return whether a `plan` section takes more from the testbed than its limits and its start."""
    if "model" not in plan:  # method none, or a plan from its file
        return False
    initial = plan.get("initial") or {}
    has_initial = all(name in initial for name in testbed.model().joint_names)
    return not (has_initial and has_every_key(plan["model"], testbed))


def has_every_key(model_section: Any, testbed: Any) -> bool:
    """Return whether a `model` section has every key of a testbed."""
    if not isinstance(model_section, dict):
        return False
    for field_ in fields(testbed):
        value = getattr(testbed, field_.name)
        if field_.name not in model_section:
            return False
        if is_dataclass(value) and not has_every_key(model_section[field_.name], value):
            return False
    return True


def simulate_case(study: Study, case: Case, plan_cache: PlanCache) -> FlightResult:
    """Return the result of a trial; a failure of any kind is a result, too."""
    try:
        trial = case_trial(study, case)
        design = _design_trial(study, case, trial)
        metrics, digest, reason = _simulate(trial, design, study.source, plan_cache)
    except FlexslewError as error:
        return failed(case.number, str(error))
    except Exception as error:  # a class of the user's own may do anything
        return failed(case.number, one_line(error))
    if reason:
        return failed(case.number, reason)
    return FlightResult(case.number, metrics, digest, "ok", "", Way.BENCH)


def failed(number: int, reason: str) -> FlightResult:
    """Return the result of a trial that has no metrics."""
    return FlightResult(number, {}, None, "failed", reason, Way.BENCH)


def _design_trial(study: Study, case: Case, trial: Trial) -> Trial:
    """Return the trial that the controllers are built for.

    Built-in laws have the model that they are designed for written out. A class of the user's own
    receives the sampled bench, or the nominal one where the study conceals it.
    """
    laws = {law_of(name, values or {})[0] for name, values in trial.controllers.items()}
    if not study.conceals_bench or laws <= CONTROLLERS.keys():
        return trial
    return replace(trial, testbed=nominal_of(study, case.variant).trial.testbed)


def _simulate(
    trial: Trial, design: Trial, source: str, plan_cache: PlanCache
) -> tuple[dict[str, float | None], str | None, str]:
    bench, controllers = set_up(design, source, trial.testbed)
    plan = plan_cache.of(trial)
    if (reason := set_plan(controllers, trial.active, plan)) is not None:
        return {}, None, str(reason)
    user_metrics = load_user_metrics(trial.metrics, f"{source}: metrics", trial.trust)
    observer = MetricsObserver(bench, plan, user_metrics)
    run_bench(bench, controllers, observer)
    if bench.drive.active == "":  # whether or not it failed under the brake
        return {}, None, brake_reason(event.what for event in observer.events)
    if bench.failure:
        return {}, None, bench.failure
    metrics = observer.result()
    return columns_of(metrics, keys_of(user_metrics)), str(metrics["trajectory_hash"]), ""


def brake_reason(facts: Iterable[Fact]) -> str:
    """Return why a trial has failed that ends in the brake, and who was not ready; else empty."""
    not_ready, found = dict[str, str](), ""
    for fact in facts:
        match fact:
            case ControllerNotReady():
                not_ready[fact.controller] = fact.reason
            case ControllerReady():
                del not_ready[fact.controller]
            case BrakeActivated():
                words = (f"{name}: {reason}" for name, reason in sorted(not_ready.items()))
                found = "; ".join((message_of(fact), *words))
    return found


def columns_of(
    metrics: dict[str, Any], user_metrics: Mapping[str, Key] = NO_KEYS
) -> dict[str, float | None]:
    """Return the metrics by column: those with parts by `name.part`, and their largest by name.

    Metrics by axis have the columns of all axes from the start; spectra have none.

    Args:
        metrics: content of metrics.json.
        user_metrics: keys of the trial's own metrics.
    """
    found: dict[str, float | None] = {}
    for name, value in metrics.items():
        key = key_of(name, user_metrics)
        if name in _LEFT_OUT or key.spectrum:
            continue
        if isinstance(value, float) or (value is None and not key.axes):  # most of them
            found[name] = value
            continue
        parts = _parts(name, value)
        if key.axes:
            parts = {k: v for part, entry in parts.items() for k, v in _by_axis(part, entry)}
        if name not in parts:
            entries = [e for e in parts.values() if e is not None or not key.some]
            found[name] = None if None in entries else max(map(abs, entries), default=None)
        for part, entry in parts.items():
            found[part] = None if entry is None else float(entry)
    return found


def _parts(name: str, value: Any) -> dict[str, Any]:
    """Return what `flat` does; at once where the parts are single numbers, as most of them."""
    if type(value) is dict:
        found = {f"{name}.{part}": entry for part, entry in value.items()}
        if all(entry is None or type(entry) is float for entry in found.values()):
            return found
    return flat({name: value})


def _by_axis(name: str, value: float | None) -> list[tuple[str, float | None]]:
    """Return a part with its value; one of three axes that has none yet, axis by axis."""
    return [(f"{name}.{axis}", None) for axis in AXES] if value is None else [(name, value)]


def metric_columns(bench: Bench, user_metrics: Sequence[type[Metric]]) -> list[str]:
    """Return the columns of columns_of for a bench at tick 0 and metrics of the trial's own."""
    observer = MetricsObserver(bench, None, user_metrics)
    observer.truth(bench.truth())
    return list(columns_of(observer.result(), keys_of(user_metrics)))
