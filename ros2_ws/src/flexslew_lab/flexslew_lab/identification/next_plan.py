"""The gain for the next manoeuvre from a model identified in the log of a manoeuvre."""

from dataclasses import replace
from typing import NamedTuple

from flexslew_control.plan import Plan
from flexslew_lab.identification.modal.modes import ModalModel
from flexslew_lab.identification.model_file import testbed_of
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.logged_controllers import trial_of
from flexslew_lab.run.in_process import run_bench
from flexslew_lab.run.metrics_observer import MetricsObserver
from flexslew_lab.trial.trial import Trial, plan_of_trial, set_plan, set_up, trial_of_values
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import initial_positions
from flexslew_plant.testbeds.identified import IdentifiedTestbed

_METRIC = "residual_tip_deflection"


class NextPlan(NamedTuple):
    """Two plans flown on the bench that was found.

    Args:
        method: of both.
        flown: residual of the plan that the log has [m].
        again: residual of one that believes what was found [m].
    """

    method: str
    flown: float
    again: float


def next_plan(bag: BagReader, found: ModalModel, recorded_plan: Plan) -> NextPlan:
    """Return what the plan of a log leaves at the tips, and one that believes what was found.

    Both are flown in simulation on the bench that was found, under the same controllers, with the
    sensors' noise of the trial; so they can be compared, and neither is a promise.

    Raises:
        BadInput: what was found is no bench to plan with, the trial had no plan that slews, or the
            plan has no residual, because the run ends with it.
    """
    trial = trial_of(bag)
    start = initial_positions(trial.testbed)
    bench = replace(testbed_of(found), initial=start)
    values = plain(trial)
    plan = values.get("plan")
    if not isinstance(plan, dict) or "model" not in plan:
        raise BadInput(f"{bag.path}: its trial has no plan with a design model")
    model_section = plain(replace(bench, initial={}))
    on = _on(trial, bench, {"plan": plan | {"model": model_section}}, str(bag.path))
    new_plan = plan_of_trial(on, predict=False)
    assert new_plan is not None  # a section with a model is a planner's
    return NextPlan(recorded_plan.method, _residual(on, recorded_plan), _residual(on, new_plan))


def _on(trial: Trial, bench: IdentifiedTestbed, changes: dict[str, object], place: str) -> Trial:
    """Return the trial on another bench, without what its own bench alone can suffer."""
    values = plain(trial) | {"testbed": plain(bench), "schedule": []}
    return trial_of_values(values | changes, place, trial.trust)


def _residual(trial: Trial, plan: Plan) -> float:
    bench, controllers = set_up(trial, trial.name)
    if (reason := set_plan(controllers, trial.active, plan)) is not None:
        raise BadInput(f"{trial.name}: {reason}")
    seen = MetricsObserver(bench, plan)
    run_bench(bench, controllers, seen)
    value = seen.result()[_METRIC]
    if value is None:
        raise BadInput(f"{trial.name}: the run ends with its plan: nothing is left to compare")
    return float(value)
