"""Where a tuning comes from: a file, the name of a shipped one, or its keys."""

import os
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import Trial
from flexslew_lab.tuning.problem import TuningProblem
from flexslew_lab.tuning.problem_of_file import tuning_problem
from flexslew_lab.tuning.settings import GainBlock, TuningSettings
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import given_text
from flexslew_plant.near_names import spelling_hint
from flexslew_plant.settings import validated
from flexslew_plant.yaml_data import load_yaml

_FOLDER = Path(str(resources.files("flexslew_lab"))) / "tuning" / "shipped"


def tuning_names() -> list[str]:
    """Return the names of the shipped tunings."""
    return sorted(path.stem for path in _FOLDER.glob("*.yaml"))


def tuning_path(name: str) -> Path:
    """Return the file of a tuning: the file itself, or the shipped one of that name.

    Raises:
        BadInput: if there is neither.
    """
    if os.path.isfile(name):
        return Path(name)
    known = tuning_names()
    if name in known:
        return _FOLDER / f"{name}.yaml"
    hint = spelling_hint(name, known)
    raise BadInput(
        f"is neither a tuning file nor a shipped tuning; {hint}shipped: {', '.join(known)}", name
    )


def read_tuning(what: str | Path | Mapping[str, Any], trial: Trial | None = None) -> TuningProblem:
    """Return the problem of a tuning.

    Args:
        what: a file, the name of a shipped tuning, or its keys.
        trial: that is tuned; None: the one that the key `trial` names, as seen from the working
            directory or the folder of the file.

    Raises:
        BadInput: if there is no such tuning, or one of its values is not allowed.
    """
    folder, source = Path(), "tuning"
    if isinstance(what, Mapping):
        values: Any = dict(what)
    else:
        path = tuning_path(str(what))
        folder, source = path.parent, path.stem if path.parent == _FOLDER else str(path)
        values = load_yaml(given_text(path), source)
    settings: TuningSettings = validated(TuningSettings, values, source)
    if trial is None:
        beside = folder / settings.trial
        name = beside if os.path.isfile(beside) else settings.trial
        try:
            trial, _ = read_trial(name)
        except BadInput as error:
            raise BadInput(f"{source}: trial: {error}") from None
    _require_controller(settings, trial, source)
    return tuning_problem(settings, trial, source)


def _require_controller(settings: TuningSettings, trial: Trial, source: str) -> None:
    if isinstance(settings.structure, GainBlock) and settings.controller not in trial.controllers:
        known = ", ".join(trial.controllers)
        raise BadInput(f"one of {known}", source, "controller", settings.controller)
