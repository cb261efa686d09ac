"""A study file: which trial, what varies and how, what is compared, what has to hold."""

import difflib
import os
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexslew_lab.studies.sampling.methods import METHODS, check_sampling
from flexslew_lab.studies.study_settings import StudySettings
from flexslew_lab.studies.variants import (
    StudyVariant,
    require_nonzero_spread,
    variants_of,
    with_nominal,
)
from flexslew_lab.studies.varied import SampledParameter, require_distinct, sampled_parameters
from flexslew_lab.trial.sources import trial_path
from flexslew_lab.trial.trial import Trial, load_trial
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import given_text
from flexslew_plant.own_code import NO_CODE, Trust
from flexslew_plant.settings import plain, validated
from flexslew_plant.yaml_data import load_yaml

EXAMPLES = Path(str(resources.files("flexslew_lab"))) / "studies" / "shipped"


class Place(NamedTuple):
    """A key of the trial that follows a draw."""

    key: str
    way: tuple[Any, ...]  # to it in the values of the trial, see overrides.put
    nominal: Any  # what the draw is of
    varied: SampledParameter
    draw: int  # which of a sample's


class Nominal(NamedTuple):
    """A trial without a sample."""

    values: dict[str, Any]  # plain data
    trial: Trial
    places: tuple[Place, ...]  # that samples change
    touched: dict[str, Any]  # the sections of `values` in which they stand


class Study(NamedTuple):
    """A study file with everything that it refers to."""

    settings: StudySettings
    source: str  # the file
    trial_source: str  # its trial's file
    base: dict[str, Any]  # the trial as plain data, every default written out
    varied: tuple[SampledParameter, ...]
    variants: tuple[StudyVariant, ...]
    list_columns: tuple[NDArray[np.float64], ...]  # columns of a list, by varied value
    nominal: dict[int, Nominal]  # trials by variant, without a sample; filled on first use
    trust: Trust = NO_CODE  # which classes of the user's own its trials may name
    conceals_bench: bool = False  # from classes of the user's own, which receive the nominal one


def study_path(name: str) -> Path:
    """Return the file of a study: the file itself, or the shipped one of that name.

    Raises:
        BadInput: there is neither.
    """
    path = Path(name)
    if os.path.isfile(path):  # also of a name that is too long for one
        return path
    example = EXAMPLES / f"{name}.yaml"
    if os.path.isfile(example):
        return example
    known = ", ".join(example_names())
    raise BadInput(f"is neither a study file nor a shipped study; shipped: {known}", name)


def example_names() -> list[str]:
    """Return the names of the shipped studies."""
    return sorted(path.stem for path in EXAMPLES.glob("*.yaml"))


def load_study(path: Path, trust: Trust = NO_CODE) -> Study:
    """Return the study of a file.

    Args:
        path: of it.
        trust: which classes of the user's own its trial may name.

    Raises:
        BadInput: the file cannot be read, or one of its values is not allowed.
    """
    return parse_study(given_text(path), str(path), path.parent, trust)


def parse_study(text: str, source: str, folder: Path, trust: Trust = NO_CODE) -> Study:
    """Return the study of a YAML text.

    Args:
        text: the file's content.
        source: its name, for messages.
        folder: from which trial and list are seen.
        trust: which classes of the user's own its trial may name.

    Raises:
        BadInput: see load_study.
    """
    values = load_yaml(text, source)
    if not isinstance(values, dict):
        raise BadInput("holds no keys; it needs at least study, trial and vary", source)
    return study_of_values(values, source, folder, trust)


def study_of_values(
    values: dict[str, Any],
    source: str,
    folder: Path,
    trust: Trust = NO_CODE,
    trial: Trial | None = None,
) -> Study:
    """Return the study that plain data describe.

    Args:
        values: keys of a study file.
        source: its name, for messages.
        folder: from which trial and list are seen.
        trust: which classes of the user's own its trial may name.
        trial: that it flies; None: the one that the key `trial` names.

    Raises:
        BadInput: see load_study.
    """
    settings: StudySettings = validated(StudySettings, values, source)
    if trial is None:
        trial_path = _trial_path(settings.trial, folder, source)
        trial, trial_source = load_trial(trial_path, trust), str(trial_path)
    else:
        trial_source = trial.name
    base = plain(trial)
    sampled, list_columns = sampled_parameters(settings, trial, base, folder, source)
    check_sampling(settings.sampling, len(sampled), f"{source}: sampling")
    require_distinct(sampled, f"{source}: vary")
    variants = tuple(
        with_nominal(variant, sampled, base, source, trust)
        for variant in variants_of(settings, base, source)
    )
    require_nonzero_spread(settings, sampled, variants, base, source)
    for name, criterion in settings.criteria.items():
        if (criterion.below is None) == (criterion.above is None):
            raise BadInput(f"criteria.{name}: give either below or above", source)
    if settings.stop is not None and not (
        METHODS[settings.sampling.method].independent
        or METHODS[settings.sampling.method].replicated
    ):
        raise BadInput(
            f"stop: is not allowed with method {settings.sampling.method}, whose samples "
            "give no bounds; use random, lhs or sobol",
            source,
        )
    return Study(settings, source, trial_source, base, sampled, variants, list_columns, {}, trust)


def known_metric(name: str, known: list[str], place: str) -> str:
    """Return the metric's name after checking that trials have it.

    Raises:
        BadInput: names the nearest known ones.
    """
    if name in known:
        return name
    close = difflib.get_close_matches(name, known, n=1)
    hint = f"did you mean {close[0]}? " if close else ""
    raise BadInput(f"{name} is not a metric; {hint}allowed: {', '.join(known)}", place)


def _trial_path(name: str, folder: Path, source: str) -> Path:
    """Return a trial's file as seen from the study's folder, else as the command line takes it."""
    if os.path.isfile(folder / name):
        return folder / name
    try:
        return trial_path(name)
    except BadInput as error:
        raise BadInput(f"trial: {error}", source) from None
