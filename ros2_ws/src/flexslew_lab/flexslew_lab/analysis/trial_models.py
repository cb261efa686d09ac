"""The linear models of a trial: its rest at a time, and the path to its motors then."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexslew_control.analysis.linear_plant import PlantPath, continuous_plant, sampled_plant
from flexslew_control.analysis.lti import Lti
from flexslew_control.analysis.rest import Rest, rest_of
from flexslew_control.controllers import build_controller
from flexslew_control.controllers.probing.running_law import RunningLaw, running_law
from flexslew_control.plan import Plan
from flexslew_lab.trial.trial import Trial, law_of, plan_of_trial, plant_of
from flexslew_plant.arrays import Vector
from flexslew_plant.bench.divergence import integration_of
from flexslew_plant.bench.schedule import command_delay_ticks
from flexslew_plant.errors import BadInput
from flexslew_plant.events import message_of
from flexslew_plant.faults.actuators import ActuatorGain, CommandDelay
from flexslew_plant.hardware.sensors import Readings
from flexslew_plant.keys.units import number_in
from flexslew_plant.testbeds.model import Model


@dataclass(frozen=True)
class Point:
    """About what a trial is linear.

    Args:
        rest: where it stands.
        path: from the command to the motors.
        plan: of the trial, where it was needed to find the rest.
        left_out: what acts then and is in neither model: kinds of faults, limits of the motors
            within which they are not linear, forces from outside, how instruments read.
        warnings: on the numbers of the models, each a line.
    """

    rest: Rest
    path: PlantPath
    plan: Plan | None
    left_out: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def moment_of(at: float | str | None) -> float:
    """Return the requested simulated time [s]; None: the start.

    Raises:
        BadInput: if it is no time.
    """
    time = 0.0 if at is None else number_in(at, ("s",), "--at")
    if time < 0.0:
        raise BadInput("simulated seconds, 0 or more", key="--at", value=time)
    return time


def point_of(
    trial: Trial,
    at: float | str | None = None,
    joints: Mapping[str, float | str] | None = None,
    plan: Plan | None = None,
) -> Point:
    """Return the rest of a trial at a time, with the faults of its schedule that act then.

    Args:
        trial: what flies.
        at: simulated time [s], or with a unit: the joints stand at the reference of the plan then;
            None: the start.
        joints: positions by name, instead of the plan's [rad or m], or with a unit.
        plan: plan of the trial; None: made where it is needed.

    Raises:
        BadInput: if the time is none, a name is no joint, or a position is not finite.
        PlanFailed: if there is no plan.
    """
    time = moment_of(at)
    plant = plant_of(trial)
    if at is not None and not joints:
        plan = plan or plan_of_trial(trial, predict=False)
        if plan is not None:
            position = plan.reference(round(time / trial.period)).position
            joints = dict(zip(plant.joint_names, position.tolist(), strict=True))
    names, left_out = plant.joint_names, []
    gain, delay = np.ones(len(names)), command_delay_ticks(trial.schedule, names, time)
    for entry in trial.schedule:
        if entry.fault is None or not entry.at <= time < (entry.until or np.inf):
            continue
        if isinstance(entry.fault, ActuatorGain):
            gain[names.index(entry.fault.joint)] *= entry.fault.gain
        elif not isinstance(entry.fault, CommandDelay):
            left_out.append(str(entry.fault.kind))
    rest = rest_of(plant.testbed, joints, time)
    steps, fast_mode = integration_of(
        rest.model, rest.q, trial.period, trial.duration, trial.integration_steps
    )
    path = PlantPath(trial.period, trial.actuator, gain, delay, steps)
    warnings = () if fast_mode is None else (message_of(fast_mode),)
    return Point(rest, path, plan, (*left_out, *_not_in_models(trial, rest.model)), warnings)


def _not_in_models(trial: Trial, model: Model) -> list[str]:
    """Return, in words, what the bench has and no linear model of it."""
    motors = ("slew_rate", "quantisation", "shortest_pulse")
    words = [f"actuator.{key}" for key in motors if getattr(trial.actuator, key)]
    if trial.actuator.coulomb_friction:
        words.append("actuator.coulomb_friction but for its slope at rest, of motors that stick")
    if model.one_way:
        words.append("that thrusters push one way")
    quanta = [key for key in Readings._fields if getattr(trial.sensors, key).quantisation]
    if (errors := model.appendages.errors) is not None:
        quanta += [n for n, step in zip(model.appendages.names, errors[2], strict=True) if step]
    words += [f"quantisation of sensor {name}" for name in quanta]
    if model.outside is not None:
        words.append("forces from outside")
    words += [f"delay and ticks of sensor {one.name}" for one in model.appendages.instruments]
    return words


def running_law_at(
    trial: Trial, name: str, section: dict[str, Any], point: Point, source: str
) -> RunningLaw:
    """Return the linear form of a controller at a point, with the gains of the plan then.

    Args:
        trial: of the bench.
        name: of the controller.
        section: its keys.
        point: where it rests.
        source: of the keys, for errors.

    Raises:
        BadInput: if the bench refuses the law, or it has no linear form there.
    """
    plant = plant_of(trial)
    built = build_controller(name, *law_of(name, section), plant, source)
    return running_law(
        built, point.rest, plant.effort_limit, plan_gains(point.plan, point.rest.time)
    )


def plan_gains(plan: Plan | None, time: float) -> Vector | None:
    """Return the gains that a plan has for its law at a time [s]; None: it has none."""
    if plan is None or not plan.gains.size:
        return None
    return plan.reference(round(time / plan.period)).gains


def model_of(point: Point, sampled: bool) -> Lti:
    """Return the plant from efforts to sensors: continuous, or as the bench ticks."""
    if sampled:
        return sampled_plant(point.rest, point.path)
    return continuous_plant(point.rest, point.path.actuator)
