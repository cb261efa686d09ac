"""A tuning: a structure, goals and models, and the worst goal as a function of the parameters."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from hashlib import sha256
from typing import NamedTuple

import numpy as np

from flexslew_control.analysis.loop_margins import best_scaling
from flexslew_lab.analysis.trial_models import Point
from flexslew_lab.trial.trial import Trial
from flexslew_lab.tuning.channels import PlantChannels
from flexslew_lab.tuning.closed_loop import ClosedLoop, PerformancePlant
from flexslew_lab.tuning.goals import (
    GoalChannels,
    StatedGoal,
)
from flexslew_lab.tuning.norms import Measure, stability
from flexslew_lab.tuning.settings import (
    MarginGoal,
    TuningSettings,
)
from flexslew_lab.tuning.structures import (
    ControllerStructure,
    matrix_and_slopes,
)
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import plain

_MOST_STATES = 200  # of a loop with all its weights
_HARD = 0.999  # number of a hard goal that is just met


class GoalNumber(NamedTuple):
    """What a goal is on a model: at most one where it is met.

    Args:
        value: of its worst part; inf: not stable.
        frequency: where it is determined [rad/s]; nan: no one frequency.
        gradient: in the parameters.
    """

    value: float
    frequency: float
    gradient: Vector


@dataclass
class TuningProblem:
    """Goals over models with a structure; the scalings of margins change as it is solved.

    Args:
        settings: of the file.
        trial: that is tuned.
        point: about which the loop is linear.
        structure: of the controller.
        goals: of the file.
        models: the plant with its channels, by label.
        stable: prepared plant of each model with the channels of all goals.
        parts: per model and goal, what is measured on which prepared plant.
    """

    settings: TuningSettings
    trial: Trial
    point: Point
    structure: ControllerStructure
    goals: tuple[StatedGoal, ...]
    models: dict[str, PlantChannels]
    stable: list[PerformancePlant]
    parts: list[list[list[tuple[GoalChannels, PerformancePlant]]]]
    scalings: dict[tuple[int, int], Vector]

    @property
    def identity(self) -> str:
        """Hash of everything on which a result depends."""
        whole = {"settings": plain(self.settings), "trial": plain(self.trial)}
        return sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()

    def growth(self, x: Vector) -> tuple[float, Vector]:
        """Return the largest growth rate of all models [1/s] and its gradient."""
        k, slopes = matrix_and_slopes(self.structure, x)
        if not np.isfinite(slopes).all():  # a step so far that an exponential overflows
            return np.inf, np.zeros_like(x)
        found = [self._of(stability, plant, k, slopes) for plant in self.stable]
        worst = max(found, key=lambda one: one.value)
        return worst.value, worst.gradient

    def numbers(self, x: Vector) -> list[list[GoalNumber]]:
        """Return what every goal is on every model, by model and goal."""
        k, slopes = matrix_and_slopes(self.structure, x)
        if not np.isfinite(slopes).all():
            return [[GoalNumber(np.inf, np.nan, np.zeros_like(x))] * len(self.goals)]
        out = []
        for plant, goals in zip(self.stable, self.parts, strict=True):
            growing = self._of(stability, plant, k, slopes)
            if growing.value >= 0.0:
                none = GoalNumber(np.inf, growing.frequency, np.zeros_like(x))
                out.append([none] * len(goals))
                continue
            out.append(
                [
                    max((self._of(part.measure, p, k, slopes) for part, p in parts),
                        key=lambda one: one.value)
                    for parts in goals
                ]
            )  # fmt: skip
        return out

    def worst(self, x: Vector, hard: bool) -> tuple[float, Vector]:
        """Return the largest number of the hard or soft goals and its gradient; 0: none."""
        worst = GoalNumber(0.0, np.nan, np.zeros_like(x))
        for of_model in self.numbers(x):
            for number, goal in zip(of_model, self.goals, strict=True):
                if goal.settings.hard is hard and number.value > worst.value:
                    worst = number
        return worst.value, worst.gradient

    def penalised(self, x: Vector, weight: float) -> tuple[float, Vector]:
        """Return the worst soft goal with what the worst hard goal exceeds one, weighted."""
        value, gradient = 0.0, np.zeros_like(x)
        excess, of_excess = 0.0, np.zeros_like(x)
        for of_model in self.numbers(x):
            for number, goal in zip(of_model, self.goals, strict=True):
                if goal.settings.hard:
                    if number.value - _HARD > excess:
                        excess, of_excess = number.value - _HARD, number.gradient
                elif number.value > value:
                    value, gradient = number.value, number.gradient
        return value + weight * excess, gradient + weight * of_excess

    def unscaled(self) -> None:
        """Leave out all scalings of disk margins."""
        for m, g in self.scalings:
            part, _ = self.parts[m][g][0]
            channels = list(self.models.values())[m]
            self.parts[m][g][0] = part, prepared_plant(self.structure, channels, part)
        self.scalings.clear()

    def rescaled(self, x: Vector) -> bool:
        """Choose the scalings of disk margins for the loop at hand; return whether any changed."""
        k = np.real(self.structure.matrix(x))
        changed = False
        for m, goals in enumerate(self.parts):
            for g, goal in enumerate(self.goals):
                if not isinstance(goal.settings, MarginGoal) or len(goal.parts[0].targets) < 2:
                    continue
                part, plant = goals[g][0]
                loop = plant.closed(k)
                found = part.norm(loop)
                if not np.isfinite(found.value):
                    continue
                d = best_scaling(loop.at(np.array([found.frequency]))[0])
                scaling = self.scalings.get((m, g), np.ones(len(part.targets))) * d
                scaling = scaling / np.exp(np.log(scaling).mean())
                self.scalings[m, g] = scaling
                channels = list(self.models.values())[m]
                goals[g][0] = part, prepared_plant(self.structure, channels, part, scaling)
                changed = True
        return changed

    def _of(
        self, norm: Callable[[ClosedLoop], Measure], plant: PerformancePlant, k: Matrix,
        slopes: Matrix,
    ) -> GoalNumber:  # fmt: skip
        loop = plant.closed(k)
        found = norm(loop)
        gradient = np.tensordot(slopes, loop.gradient(found.gradient), 2)
        return GoalNumber(found.value, found.frequency, np.asarray(gradient))


def prepared_plant(
    structure: ControllerStructure, channels: PlantChannels, part: GoalChannels,
    scaling: Vector | None = None,
) -> PerformancePlant:  # fmt: skip
    """Return the plant of a part of a goal around which the structure's gain is.

    Raises:
        BadInput: if it has too many states.
    """
    plant = part.plant(channels, structure.signals, structure.efforts, scaling)
    found = part.weighted(structure.prepared(plant))
    if len(found.a) > _MOST_STATES:
        words = f"the loop has {len(found.a)} states with its weights; at most {_MOST_STATES}"
        raise BadInput(f"{words}: take fewer modes or a smaller order", "structure")
    return found
