"""What varies from trial to trial of a study."""

import difflib
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexslew_lab.studies.quantities import with_numbers
from flexslew_lab.studies.sampling.distributions import Distribution, distribution_of
from flexslew_lab.studies.sampling.methods import list_of
from flexslew_lab.studies.study_settings import StudySettings
from flexslew_lab.trial.overrides import value_at
from flexslew_lab.trial.trial import Trial
from flexslew_plant.errors import BadInput

PER_TRIAL_KEYS = ("name", "seed", "rate_factor")  # keys of which every trial of a study has its own
_REFERENCES = ("relative", "offset")  # what a draw may be added to
_TAKEN = ("index", "sample", "variant", "replicate", "seed", "status", "reason", "way")


class SampledParameter(NamedTuple):
    """One varied value."""

    name: str
    keys: tuple[str, ...]  # of the trial; all follow the same draw
    reference: str  # relative, offset or absolute: what a draw is added to
    distribution: Distribution | None  # None: from a list

    def value(self, nominal: Any, draw: Any) -> Any:
        """Return what a key becomes; each entry of a list in the same way."""
        if isinstance(nominal, list) and self.reference != "absolute":
            return [self.value(entry, draw) for entry in nominal]
        if self.reference == "relative":
            return nominal * (1.0 + draw)
        return nominal + draw if self.reference == "offset" else draw


def sampled_parameters(
    settings: StudySettings, trial: Trial, base: dict[str, Any], folder: Path, source: str
) -> tuple[tuple[SampledParameter, ...], tuple[NDArray[np.float64], ...]]:
    """Return what varies, and of a list the columns of its file.

    Args:
        settings: of the study.
        trial: the trial.
        base: the same as plain data.
        folder: from which the list's file is seen.
        source: the study's file, for messages.

    Raises:
        BadInput: nothing varies, or a value is not allowed.
    """
    if settings.sampling.method == "list" and settings.sampling.file is not None:
        if settings.vary:
            raise BadInput("vary: is not allowed with a list, whose first row names all", source)
        place = f"{source}: sampling.file"
        keys, columns = list_of(folder / settings.sampling.file, place)
        sampled = tuple(SampledParameter(key, (key,), "absolute", None) for key in keys)
        for key in keys:
            nominal_value(base, key, place)
        return sampled, columns
    if not settings.vary:
        raise BadInput("vary: is missing; name at least one value of the trial", source)
    return tuple(_one(name, v, trial, base, source) for name, v in settings.vary.items()), ()


def require_distinct(sampled: Iterable[SampledParameter], place: str) -> None:
    """Refuse keys that a later draw would overwrite, and those that the study itself sets."""
    seen: list[str] = []
    for key in (key for one in sampled for key in one.keys):
        if key in PER_TRIAL_KEYS:
            raise BadInput(f"{key} is not allowed: every trial of a study has its own", place)
        duplicate = next((other for other in seen if overlap(key, other)), None)
        if duplicate is not None:
            raise BadInput(
                f"{key} is not allowed beside {duplicate}: both set the same value", place
            )
        seen.append(key)


def overlap(one: str, other: str) -> bool:
    """Return whether a path is another one, or leads through it."""
    return one == other or one.startswith(f"{other}.") or other.startswith(f"{one}.")


def _one(
    name: str, values: dict[str, Any], trial: Trial, base: dict[str, Any], source: str
) -> SampledParameter:
    place = f"{source}: vary.{name}"
    settings = dict(values)
    keys = settings.pop("keys", [name])
    if not isinstance(keys, list) or not keys or not all(isinstance(k, str) for k in keys):
        raise BadInput("a list of keys of the trial", key=f"{place}.keys", value=keys)
    reference = "absolute"
    others: tuple[str, ...] = ("keys", *_REFERENCES)
    if len(settings) == 1 and next(iter(settings)) in _REFERENCES:
        reference, inner = next(iter(settings.items()))
        place, settings, others = f"{place}.{reference}", inner, ()
    elif len(settings) != 1:
        distribution_of(settings, place, others)  # refuses them by name
    if name in _TAKEN:
        raise BadInput("is not allowed: the tables have a column of that name already", place)
    for key in keys:
        nominal = nominal_value(base, key, f"{source}: vary")
        if reference != "absolute" and not numeric(nominal):
            raise BadInput(f"{key} is {nominal!r} in the trial; {reference} needs numbers", place)
    in_units_of = [] if reference == "relative" else keys
    settings = with_numbers(settings, in_units_of, trial, base, place)
    distribution = distribution_of(settings, place, others)
    return SampledParameter(name, tuple(keys), reference, distribution)


def nominal_value(base: dict[str, Any], key: str, place: str, others: tuple[str, ...] = ()) -> Any:
    """Return what the trial has at a key.

    Args:
        base: the trial as plain data.
        key: of it.
        place: file and key, for messages.
        others: keys that are allowed here and are none of the trial's.

    Raises:
        BadInput: the trial has no such key; names the nearest.
    """
    try:
        return value_at(base, key)
    except BadInput:
        pass
    known = sorted([*_paths(base), *others])
    close = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    hint = f"; did you mean {close[0]}?" if close else ""
    if key.startswith("controllers."):
        hint += "; of a controller the trial's file must give it"  # its defaults are its law's
    raise BadInput(f"{key} is not a key of the trial{hint}", place)


def _paths(values: Any, prefix: str = "") -> list[str]:
    if not isinstance(values, dict):
        return [prefix]
    nested = [_paths(v, f"{prefix}.{k}" if prefix else str(k)) for k, v in values.items()]
    return [path for paths in nested for path in paths]


def numeric(value: Any) -> bool:
    """Return whether a value is a number, or a list of them."""
    if isinstance(value, list):
        return bool(value) and all(numeric(entry) for entry in value)
    return isinstance(value, int | float) and not isinstance(value, bool)
