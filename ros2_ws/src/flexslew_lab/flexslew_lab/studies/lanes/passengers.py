"""Which trials may fly beside each other in lanes."""

import json
from typing import Any, NamedTuple

from flexslew_control.controllers import CONTROLLERS, build_controller
from flexslew_control.controllers.controller import Controller
from flexslew_lab.studies.cases import Case, case_trial
from flexslew_lab.studies.flight import leaves_nothing, plan_key
from flexslew_lab.studies.study import Study
from flexslew_lab.trial.trial import Trial, law_of, plant_of
from flexslew_plant.bench.hardware.actuator import ActuatorSettings
from flexslew_plant.errors import FlexslewError
from flexslew_plant.settings import plain
from flexslew_plant.testbeds.lanes import LaneKernel, lane_kernel
from flexslew_plant.testbeds.model import Model

PER_LANE = ("kp", "ki", "kd")  # gains that each lane may have for itself
COLLOCATED = ("pd_feedforward", "collocated_pid")  # the laws whose gains may


class Passenger(NamedTuple):
    """A trial that may fly in a lane."""

    case: Case
    trial: Trial
    asked: str  # its plan_key: a plan itself is large, and some have one of their own
    model: Model
    kernel: LaneKernel
    steps: int  # of the kernel per tick
    alike: str  # trials with the same text may fly at once


def passenger_of(study: Study, case: Case) -> Passenger | None:
    """Return a case ready for a lane; None where only the bench can fly it."""
    try:
        trial = case_trial(study, case)
        if not _simple(trial):
            return None
        kernel = lane_kernel(trial.testbed)
        if kernel is None or trial.plan is None or not _linear(trial):
            return None
        asked = plan_key(trial)
    except FlexslewError:
        return None  # the bench says why
    model = trial.testbed.model()
    steps = kernel.steps(model.packed, trial.period)
    alike = _alike(trial, model, steps, asked)
    return Passenger(case, trial, asked, model, kernel, steps, alike)


def _simple(trial: Trial) -> bool:
    """Return whether motors, sensors, schedule and metrics are such as lanes know."""
    if trial.metrics:
        return False
    s = trial.sensors
    channels = (s.joint_position, s.joint_velocity, s.tip_deflection, s.root_curvature)
    pushed = all(entry.disturbance is not None for entry in trial.schedule)
    exact = all(channel.quantisation == 0.0 for channel in channels)
    return trial.actuator == ActuatorSettings() and exact and pushed and not trial.allow_faults


def _linear(trial: Trial) -> bool:
    """Return whether the law may be linear; linear_form has the last word."""
    law, own = law_of(trial.active, trial.controllers[trial.active] or {})
    if law == "output_feedback":
        return own.get("mode") == "tracking_b"
    return law in CONTROLLERS


def _alike(trial: Trial, model: Model, steps: int, plan: str) -> str:
    """Return everything that trials in lanes beside each other must share, as text."""
    law, own = law_of(trial.active, trial.controllers[trial.active] or {})
    if law in COLLOCATED:
        own = {key: value for key, value in own.items() if key not in PER_LANE}
    shared = [
        law,
        own,
        plan,
        trial.period,
        trial.duration,
        list(trial.testbed.effort_limit),
        plain(trial.schedule),
        [trial.testbed.kind, model.modes, steps],
        model.appendages.tip.tolist(),
        [bool(channel.noise or channel.bias) for channel in _read_channels(trial)],
    ]
    if law not in COLLOCATED and not leaves_nothing(own.get("model"), trial.testbed):
        shared.append(plain(trial.testbed))  # in which the law believes
    return json.dumps(shared, sort_keys=True)


def controller_of(trial: Trial) -> Controller:
    """Return the controller in charge of a trial, without a plan."""
    law, own = law_of(trial.active, trial.controllers[trial.active] or {})
    return build_controller(trial.active, law, own, plant_of(trial), trial.name)


def _read_channels(trial: Trial) -> tuple[Any, Any, Any]:
    s = trial.sensors
    return s.joint_position, s.joint_velocity, s.tip_deflection
