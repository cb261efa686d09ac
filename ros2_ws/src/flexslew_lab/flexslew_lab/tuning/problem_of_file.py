"""The problem of a tuning file: its plants, its structure and its goals, with names checked."""

from typing import Any

from flexslew_control.analysis.lti import Lti
from flexslew_lab.analysis.trial_models import Point, point_of, running_law_at
from flexslew_lab.gains.ensemble import gains_of
from flexslew_lab.guarantee.model.parameters import uncertain_parameters
from flexslew_lab.guarantee.model.situation import situation_at
from flexslew_lab.trial.trial import Trial
from flexslew_lab.tuning.body_axis_signals import body_axis_signals
from flexslew_lab.tuning.channels import PlantChannels
from flexslew_lab.tuning.goals import LoopPlaces, all_channels, stated_goals
from flexslew_lab.tuning.kept_keys import kept_section
from flexslew_lab.tuning.law_gains import LawGains, law_gains
from flexslew_lab.tuning.parallel_system import ParallelSystem
from flexslew_lab.tuning.pid_system import PidSystem
from flexslew_lab.tuning.problem import TuningProblem, prepared_plant
from flexslew_lab.tuning.settings import (
    GainBlock,
    ParallelBlock,
    PidBlock,
    StateSpaceBlock,
    TuningSettings,
)
from flexslew_lab.tuning.structures import ControllerStructure, TridiagonalSystem
from flexslew_plant.errors import BadInput


def tuning_problem(settings: TuningSettings, trial: Trial, source: str) -> TuningProblem:
    """Return the problem of a tuning file.

    Args:
        settings: of the file.
        trial: that it names.
        source: of the file, for messages.

    Raises:
        BadInput: if a name is unknown or a structure does not fit the bench; names file and key.
    """
    try:
        point = point_of(trial, settings.at)
        models = _models(settings, trial, point)
        structure = structure_of(settings, trial, point, source)
        first = next(iter(models.values()))
        # the signals of the structure exist
        first.between((), (), structure.signals, structure.efforts)
        places = LoopPlaces(first.commanded(structure.efforts), first.sensors_of(structure.signals))
        goals = stated_goals(settings.goals, places, first)
        sources, targets = all_channels(goals)
        stable, parts = [], []
        for channels in models.values():
            whole = channels.between(sources, targets, structure.signals, structure.efforts)
            stable.append(structure.prepared(whole))
            parts.append([[(p, prepared_plant(structure, channels, p)) for p in goal.parts]
                          for goal in goals])  # fmt: skip
    except BadInput as error:
        raise BadInput(str(error), source) from None
    return TuningProblem(settings, trial, point, structure, goals, models, stable, parts, {})


def structure_of(
    settings: TuningSettings, trial: Trial, point: Point, source: str
) -> ControllerStructure:
    """Return the structure of a file for a trial.

    Raises:
        BadInput: if the law has no such numbers, or is not affine in them.
    """
    block = settings.structure
    if isinstance(block, StateSpaceBlock | PidBlock):
        return _system(block, trial.period)
    if isinstance(block, ParallelBlock):
        systems = tuple(_system(one, trial.period) for one in block.systems)
        return ParallelSystem(systems, trial.period)
    return gains_structure(trial, settings.controller, block, point, source)


def _system(block: StateSpaceBlock | PidBlock, period: float) -> TridiagonalSystem | PidSystem:
    if isinstance(block, StateSpaceBlock):
        return TridiagonalSystem(block, period)
    return PidSystem(block, period)


def gains_structure(
    trial: Trial, name: str, block: GainBlock, point: Point, source: str
) -> LawGains:
    """Return the numbers of a trial's controller as a structure."""
    keys = gains_of(trial, source, name, block.keys).shipped
    section = trial.controllers[name] or {}

    def form_of(other: dict[str, Any]) -> Lti:
        return running_law_at(trial, name, {**section, **other}, point, source).form

    return law_gains(form_of, keys)


def _models(settings: TuningSettings, trial: Trial, point: Point) -> dict[str, PlantChannels]:
    situation, axes, found = situation_at(trial, point), None, {}
    if not isinstance(settings.structure, GainBlock):
        name = settings.controller
        given = kept_section(name, trial.controllers.get(name))
        axes = body_axis_signals(trial, name, given, point)
    for k, changes in enumerate(settings.models):
        if changes:  # refuses a name that is none
            uncertain_parameters(situation, {name: (0.0, 1.0) for name in changes})
        label = ", ".join(f"{name} {value:g}" for name, value in changes.items()) or "nominal"
        if label in found:
            raise BadInput("is there twice", key=f"models.{k + 1}", value=label)
        found[label] = PlantChannels(situation.changed(changes).plant, axes)
    return found
