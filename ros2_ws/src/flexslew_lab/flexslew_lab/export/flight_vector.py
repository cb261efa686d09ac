"""What goes into a module and comes out of it in a flight of the bench, tick by tick."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from flexslew_control.controllers.controller import Answer
from flexslew_control.plan import Plan
from flexslew_lab.export.c_module import CModule
from flexslew_lab.export.compiled import inputs_of
from flexslew_lab.export.plant_module import noise_free
from flexslew_lab.run.in_process import Observer, run_bench
from flexslew_lab.trial.trial import Trial, set_plan, set_up
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.bench.bench import Truth
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement

_TICKS = 2000  # of a vector, from the first answer on


class FlightVector(NamedTuple):
    """Inputs and outputs of a module."""

    inputs: Matrix  # (ticks, inputs)
    outputs: Matrix  # (ticks, outputs)
    counted: Vector  # whether the outputs of a tick count: 1 or 0, (ticks,)
    sizes: tuple[int, ...]  # of the members of the outputs

    def error(self, outputs: Matrix) -> float:
        """Return by how much a member of the outputs differs at most, over its peak [-]."""
        off = np.abs(outputs - self.outputs) * self.counted[:, None]
        worst, ends = 0.0, np.cumsum(self.sizes)[:-1]
        members = (np.split(table, ends, axis=1) for table in (off, self.outputs))
        for wrong, right in zip(*members, strict=True):
            peak = float(np.abs(right).max(initial=0.0)) or 1.0
            worst = max(worst, float(np.nan_to_num(wrong, nan=np.inf).max(initial=0.0)) / peak)
        return worst


class _Answers(Observer):
    """Keeps the questions of a flight, and what one controller answers; no name: each."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.questions: dict[int, Measurement] = {}
        self.efforts: dict[int, Vector] = {}
        self.disturbances: dict[int, Vector] = {}  # of the tick before

    def truth(self, truth: Truth) -> None:
        """Take the state at a tick."""
        self.disturbances[truth.tick] = truth.disturbance

    def question(self, question: Measurement) -> None:
        """Take a measurement."""
        self.questions[question.tick] = question

    def answer(self, answer: Answer) -> None:
        """Take an answer."""
        if self.name in ("", answer.command.controller):
            self.efforts[answer.command.tick] = answer.command.effort


def plant_vector(trial: Trial, module: CModule, plan: Plan | None, source: str) -> FlightVector:
    """Return the efforts of a trial's flight in process, and the measurements after them.

    Its sensors are without noise, as those of the module.

    Args:
        trial: the trial.
        module: of its testbed.
        plan: its plan; None: there is none.
        source: the trial's file, for messages.
    """
    seen = _flight(noise_free(trial), "", plan, source)
    questions = [one for tick, one in sorted(seen.questions.items()) if tick <= _TICKS]
    pairs = list(pairwise(questions))
    # the brake gives no answer, and demands what it applies
    demand = {a.tick: seen.efforts.get(a.tick, b.applied_effort) for a, b in pairs}
    names = [one.name for one in module.outputs]
    return FlightVector(
        np.array(
            [
                np.hstack((before.time, demand[before.tick], seen.disturbances[after.tick]))
                for before, after in pairs
            ]
        ),
        np.array([np.hstack([getattr(after, name) for name in names]) for _, after in pairs]),
        np.ones(len(pairs)),
        tuple(one.size for one in module.outputs),
    )


def _flight(trial: Trial, name: str, plan: Plan | None, source: str) -> _Answers:
    """Return what a controller was asked and answered in a flight in process."""
    bench, controllers = set_up(trial, source)
    set_plan(controllers, trial.active, plan)
    seen = _Answers(name)
    run_bench(bench, controllers, seen)
    return seen


def controller_vector(
    trial: Trial, name: str, plan: Plan | None, source: str, ticks: int = _TICKS
) -> FlightVector:
    """Return the measurements of a trial's flight in process, and a controller's answers.

    Args:
        trial: the trial.
        name: of the controller.
        plan: its plan; None: there is none.
        source: the trial's file, for messages.
        ticks: how many are kept from the first answer on.

    Raises:
        BadInput: the controller is never active in this trial.
    """
    seen = _flight(trial, name, plan, source)
    if not seen.efforts:
        words = "is never active in this trial, so no answer of it is known; switch to it"
        raise BadInput(words, source, f"controllers.{name}")
    last = min(seen.efforts) + ticks
    questions = [one for tick, one in sorted(seen.questions.items()) if tick < last]
    idle = np.zeros(len(next(iter(seen.efforts.values()))))
    return FlightVector(
        np.array([inputs_of(one, name) for one in questions]),
        np.array([seen.efforts.get(one.tick, idle) for one in questions]),
        np.array([float(one.tick in seen.efforts) for one in questions]),
        (idle.size,),
    )


def csv_of(module: CModule, vector: FlightVector) -> str:
    """Return a test vector as a table: whether it counts, inputs, outputs."""
    names = ["counted"] + [
        f"{signal.name}_{k}" if signal.size > 1 else signal.name
        for signal in (*module.inputs, *module.outputs)
        for k in range(signal.size)
    ]
    rows = np.column_stack((vector.counted, vector.inputs, vector.outputs))
    lines = (",".join(f"{value:.17g}" for value in row) for row in rows.tolist())
    return "\n".join((",".join(names), *lines, ""))
