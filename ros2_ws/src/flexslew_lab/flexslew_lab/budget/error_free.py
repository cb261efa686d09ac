"""Flights of the non-linear bench without error sources, or with a single one."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.controllers.controller import Answer
from flexslew_control.plan import Plan
from flexslew_lab.budget.closed_loop import ErrorLoop
from flexslew_lab.run.in_process import Observer, run_bench
from flexslew_lab.trial.trial import Trial, bench_settings, build_controllers, set_plan
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.bench.bench import Bench
from flexslew_plant.bench.records import Truth
from flexslew_plant.errors import BadInput
from flexslew_plant.hardware.sensors import SensorSettings
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import Testbed, with_changes
from flexslew_plant.testbeds.model import Model

_BALANCED = {"static_imbalance": 0.0, "dynamic_imbalance": 0.0, "harmonics": []}
_ERRORS = {  # keys of a testbed's sensors that are errors, with what they are without
    "noise": 0.0,
    "bias": 0.0,
    "quantisation": 0.0,
    "angle_random_walk": 0.0,
    "rate_random_walk": 0.0,
    "bias_spread": 0.0,
    "across": 0.0,
    "about": 0.0,
    "rate_noise": 0.0,
}


class ErrorFlight(NamedTuple):
    """A flight of the bench.

    Args:
        error: position less goal, and estimate less position where there are estimates, at all
            ticks, shape (ticks, outputs) [rad or m].
        states: [q, v], shape (ticks, size of a state).
    """

    error: Matrix
    states: Matrix


@dataclass
class _StateObserver(Observer):
    """Keeps the state at every tick, and the answers of a controller by tick."""

    controller: str
    states: list[Vector]
    answers: dict[int, Answer]

    def truth(self, truth: Truth) -> None:
        """Take the state at a tick."""
        self.states.append(np.concatenate((truth.position, truth.velocity)))

    def answer(self, answer: Answer) -> None:
        """Take an answer."""
        if answer.command.controller == self.controller:
            self.answers[answer.command.tick] = answer


def error_free(trial: Trial) -> Trial:
    """Return the trial on a bench without error sources and faults, for laws of the first.

    Lags, limits, viscous friction and delays of the motors stay, as parts of the loop.
    """
    motors = replace(trial.actuator, quantisation=0.0, coulomb_friction=0.0)
    schedule = tuple(e for e in trial.schedule if e.disturbance is None and e.fault is None)
    return replace(
        trial,
        sensors=SensorSettings(),
        actuator=motors,
        schedule=schedule,
        testbed=without_errors(trial.testbed),
    )


def without_errors(testbed: Testbed) -> Testbed:
    """Return a testbed whose sensors have no errors and whose platform feels no outside force."""
    changes: dict[str, Any] = {}
    sensors = plain(testbed).get("sensors")
    if isinstance(sensors, dict) and sensors:
        changes["sensors"] = {
            name: {
                key: [0.0] * len(values[key]) if isinstance(values[key], list) else none
                for key, none in _ERRORS.items()
                if key in values
            }
            for name, values in sensors.items()
        }
    quiet = with_changes(testbed, changes, "budget") if changes else testbed
    return without_imbalance(without_orbit(quiet))


def without_orbit(testbed: Testbed) -> Testbed:
    """Return a testbed that is on no orbit."""
    given: Any = testbed
    return replace(given, orbit=None) if getattr(testbed, "orbit", None) is not None else testbed


def without_imbalance(testbed: Testbed) -> Testbed:
    """Return a testbed with balanced wheels."""
    wheels = getattr(testbed, "wheels", {})
    unbalanced = [
        name for name, wheel in wheels.items() if plain(wheel) | _BALANCED != plain(wheel)
    ]
    if not unbalanced:
        return testbed
    return with_changes(testbed, {"wheels": dict.fromkeys(unbalanced, _BALANCED)}, "budget")


def simulate(
    design: Trial, bench_trial: Trial, source: str, plan: Plan | None, loop: ErrorLoop
) -> ErrorFlight:
    """Return a flight of a bench under laws that are designed for a trial.

    Args:
        design: for which the laws are built.
        bench_trial: bench that flies.
        source: file of the trial, for an error.
        plan: that is flown; None: where the joints stand at the start is the goal.
        loop: with the axes of the errors, and whether there are those of knowledge.

    Raises:
        BadInput: if the plan is refused or the bench fails.
    """
    bench = Bench(bench_settings(bench_trial))
    controllers = build_controllers(design, source)
    if (reason := set_plan(controllers, design.active, plan)) is not None:
        raise BadInput(f"{source}: {reason}")
    seen = _StateObserver(loop.controller, [], {})
    run_bench(bench, controllers, seen)
    if bench.failure or bench.drive.active == "":
        raise BadInput(f"{source}: the flight fails: {bench.failure or 'it ends in the brake'}")
    states, model = np.array(seen.states), bench.model
    position, _ = model.joint_states(states)
    goal = position[0] if plan is None else plan.position[-1]
    to_axes = loop.axes.from_joints.T
    error = -model.joint_error(position, goal) @ to_axes
    if not loop.no_estimate:
        error = np.hstack((error, _knowledge(model, position, seen.answers) @ to_axes))
    return ErrorFlight(error, states)


def _knowledge(model: Model, position: Matrix, answers: Mapping[int, Answer]) -> Matrix:
    """Return estimate less position of joints by tick, zero before the controller is active.

    Both are taken from the reference, from which an estimate of an attitude is a turn.

    Args:
        model: of the bench.
        position: of the joints, shape (ticks, joints).
        answers: by tick; a tick without one, as the last, has the error of the tick before.
    """
    found = np.zeros_like(position)
    for tick in range(len(position)):
        if (answer := answers.get(tick)) is not None:
            reference = answer.reference.position
            estimated = answer.estimate.position[: model.joints] - reference
            found[tick] = estimated + model.joint_error(position[tick], reference)
        elif tick:
            found[tick] = found[tick - 1]
    return found
