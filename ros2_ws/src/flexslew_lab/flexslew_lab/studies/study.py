"""A study file: which trial, what varies and how, what is compared, what has to hold."""

import difflib
import os
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from flexslew_lab.studies.sampling.distributions import Distribution, distribution_of
from flexslew_lab.studies.sampling.methods import METHODS, Sampling, check_sampling, list_of
from flexslew_lab.trial.overrides import overridden, value_at
from flexslew_lab.trial.sources import trial_path
from flexslew_lab.trial.trial import Trial, load_trial, trial_of_values
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import NO_CODE, Trust
from flexslew_plant.settings import Positive, plain, section, validated
from flexslew_plant.yaml_data import load_yaml

SHIPPED = Path(str(resources.files("flexslew_lab"))) / "studies" / "shipped"

_OWN = ("name", "seed", "rate_factor")  # keys of which every trial of a study has its own
_TAKEN = ("index", "sample", "variant", "replicate", "seed", "status", "reason", "way")

Knowledge: TypeAlias = Literal["experiment", "manoeuvre"] | bool
REPLAN, EXPERIMENT, MANOEUVRE = "replan", "experiment", "manoeuvre"

Confidence = Annotated[float, Field(gt=0.5, lt=1.0)]
Share = Annotated[float, Field(gt=0.0, lt=1.0)]


@section
class Criterion:
    """What a metric must satisfy; without a probability, in every trial."""

    below: float | None = None  # in the metric's unit
    above: float | None = None  # in the metric's unit
    probability: Share | None = None  # of keeping to it
    confidence: Confidence = 0.9  # with which that is to be shown


@section
class Stop:
    """When a quantile is known well enough to stop."""

    metric: str  # whose quantile
    quantile: Share = 0.99  # that is to be known
    half_width: Positive  # of its bounds, in the metric's unit
    confidence: Confidence = 0.9  # of its bounds


@section
class Keep:
    """What stays besides the table."""

    # worst N flies the worst trials again with their logs; none
    bags: Annotated[str, Field(pattern=r"^(none|worst [1-9][0-9]*)$")] = "worst 5"


@section
class StudySettings:
    """The keys of a study file; docs/studies.md documents them one by one."""

    # its name, and that of its folder, runs/study-NAME
    study: Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]+$")]
    trial: str  # a shipped trial or a file
    seed: Annotated[int, Field(ge=0)] = 1  # of the samples and of every trial
    # `method`: random, lhs, sobol, grid, list, saltelli; `n`; `replicates` of lhs and sobol; `file`
    # of a list
    sampling: Sampling = Sampling()
    # by key of the trial: a distribution, or `relative` or `offset` and a distribution; `keys`
    # names several that follow one draw
    vary: dict[str, dict[str, Any]] = Field(default_factory=dict)
    # whether planner and controllers know the sampled bench; false: they believe in the nominal
    # one; `experiment`: what an experiment on the sampled bench finds; `manoeuvre`: what the log of
    # the manoeuvre finds that was planned for the nominal one. `compare: {replan: {nominal: false,
    # identified: experiment, truth: true}}` flies all three
    replan: Knowledge = False
    # keys that make the trial that experiment, with a `plan` of method excitation; its plan
    # believes the nominal bench
    shake: dict[str, Any] = Field(default_factory=dict)
    # numbers of the `testbed` section that the experiment fits, as `--fit` of `identify` does:
    # planner and controllers believe the bench's own equations with them; empty: they believe its
    # modes and inertias
    fit: tuple[str, ...] = ()
    # by key of the trial: a list of values, or values by name; every combination flies the same
    # samples
    compare: dict[str, list[Any] | dict[str, Any]] = Field(default_factory=dict)
    # by metric: `below` or `above`, and with `probability` and `confidence` what is to be shown;
    # without them, every trial must meet it
    criteria: dict[str, Criterion] = Field(default_factory=dict)
    # stop when the `quantile` of the `metric` is known to ± `half_width` at `confidence` (0.9)
    stop: Stop | None = None
    keep: Keep = Keep()  # `bags: worst N` flies the worst trials again with their logs; `none`
    limit: Positive = 600.0  # a trial that takes longer is ended and counts as failed [wall s]
    lanes: bool = True  # whether one kernel may fly many trials at once


class Varied(NamedTuple):
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


class StudyVariant(NamedTuple):
    """One of what is compared: the same samples with these changes of the trial."""

    label: str  # empty where nothing is compared
    changes: dict[str, Any]
    replan: Knowledge = False  # see StudySettings
    nominal: Mapping[str, Any] = {}  # what draws are of, by key, where its changes have a say in it


class Nominal(NamedTuple):
    """A trial without a sample."""

    values: dict[str, Any]  # plain data
    trial: Trial


class Study(NamedTuple):
    """A study file with everything that it refers to."""

    settings: StudySettings
    source: str  # the file
    trial_source: str  # its trial's file
    base: dict[str, Any]  # the trial as plain data, every default written out
    varied: tuple[Varied, ...]
    variants: tuple[StudyVariant, ...]
    listed: tuple[NDArray[np.float64], ...]  # columns of a list, by varied value
    nominal: dict[int, Nominal]  # trials by variant, without a sample; filled on first use
    trust: Trust = NO_CODE  # which classes of the user's own its trials may name


def study_path(name: str) -> Path:
    """Return the file of a study: the file itself, or the shipped one of that name.

    Raises:
        BadInput: there is neither.
    """
    path = Path(name)
    if os.path.isfile(path):  # also of a name that is too long for one
        return path
    shipped = SHIPPED / f"{name}.yaml"
    if os.path.isfile(shipped):
        return shipped
    known = ", ".join(shipped_names())
    raise BadInput(f"is neither a study file nor a shipped study; shipped: {known}", name)


def shipped_names() -> list[str]:
    """Return the names of the shipped studies."""
    return sorted(path.stem for path in SHIPPED.glob("*.yaml"))


def load_study(path: Path, trust: Trust = NO_CODE) -> Study:
    """Return the study of a file.

    Args:
        path: of it.
        trust: which classes of the user's own its trial may name.

    Raises:
        BadInput: the file cannot be read, or one of its values is not allowed.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"cannot be read: {error}", path) from None
    return parse_study(text, str(path), path.parent, trust)


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
    varied, listed = _varied(settings, base, folder, source)
    check_sampling(settings.sampling, len(varied), f"{source}: sampling")
    _require_apart(varied, f"{source}: vary")
    variants = tuple(
        _with_nominal(variant, varied, base, source, trust)
        for variant in _variants(settings, base, source)
    )
    _require_effect(settings, varied, variants, base, source)
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
    return Study(settings, source, trial_source, base, varied, variants, listed, {}, trust)


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


def _varied(
    settings: StudySettings, base: dict[str, Any], folder: Path, source: str
) -> tuple[tuple[Varied, ...], tuple[NDArray[np.float64], ...]]:
    if settings.sampling.method == "list" and settings.sampling.file is not None:
        if settings.vary:
            raise BadInput("vary: is not allowed with a list, whose first row names all", source)
        place = f"{source}: sampling.file"
        keys, columns = list_of(folder / settings.sampling.file, place)
        varied = tuple(Varied(key, (key,), "absolute", None) for key in keys)
        for key in keys:
            nominal_value(base, key, place)
        return varied, columns
    if not settings.vary:
        raise BadInput("vary: is missing; name at least one value of the trial", source)
    return tuple(_one(name, v, base, source) for name, v in settings.vary.items()), ()


def _require_apart(varied: Iterable[Varied], place: str) -> None:
    """Refuse keys that a later draw would overwrite, and those that the study itself sets."""
    seen: list[str] = []
    for key in (key for one in varied for key in one.keys):
        if key in _OWN:
            raise BadInput(f"{key} is not allowed: every trial of a study has its own", place)
        twice = next((other for other in seen if _overlap(key, other)), None)
        if twice is not None:
            raise BadInput(f"{key} is not allowed beside {twice}: both set the same value", place)
        seen.append(key)


def _require_effect(
    settings: StudySettings,
    varied: Iterable[Varied],
    variants: Sequence[StudyVariant],
    base: dict[str, Any],
    source: str,
) -> None:
    """Refuse a draw that is a share of zero everywhere, and what only experiments make use of."""
    for one in varied:
        if one.reference != "relative":
            continue
        of = [v.nominal.get(key, value_at(base, key)) for v in variants for key in one.keys]
        if not any(map(np.any, of)):
            words = "is a share of 0 in every trial; use offset, or the values themselves"
            raise BadInput(words, f"{source}: vary.{one.name}.relative")
    found = {variant.replan for variant in variants} & {EXPERIMENT, MANOEUVRE}
    if settings.shake and EXPERIMENT not in found:
        raise BadInput(f"shake: is not allowed without replan: {EXPERIMENT}", source)
    if settings.fit and not found:
        words = f"fit: is not allowed without replan: {EXPERIMENT} or {MANOEUVRE}"
        raise BadInput(words, source)


def _overlap(one: str, other: str) -> bool:
    """Return whether a path is another one, or leads through it."""
    return one == other or one.startswith(f"{other}.") or other.startswith(f"{one}.")


def _one(name: str, values: dict[str, Any], base: dict[str, Any], source: str) -> Varied:
    place = f"{source}: vary.{name}"
    own = dict(values)
    keys = own.pop("keys", [name])
    if not isinstance(keys, list) or not keys or not all(isinstance(k, str) for k in keys):
        raise BadInput("a list of keys of the trial", key=f"{place}.keys", value=keys)
    reference = "absolute"
    if len(own) == 1 and next(iter(own)) in ("relative", "offset"):
        reference, inner = next(iter(own.items()))
        place, own = f"{place}.{reference}", inner
    if name in _TAKEN:
        raise BadInput("is not allowed: the tables have a column of that name already", place)
    varied = Varied(name, tuple(keys), reference, distribution_of(own, place))
    for key in keys:
        nominal = nominal_value(base, key, f"{source}: vary")
        if reference != "absolute" and not _numeric(nominal):
            raise BadInput(f"{key} is {nominal!r} in the trial; {reference} needs numbers", place)
    return varied


def nominal_value(base: dict[str, Any], key: str, place: str) -> Any:
    """Return what the trial has at a key.

    Raises:
        BadInput: the trial has no such key; names the nearest.
    """
    try:
        return value_at(base, key)
    except BadInput:
        pass
    known = sorted(_paths(base))
    close = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    hint = f"; did you mean {close[0]}?" if close else ""
    if key.startswith("controllers."):
        hint += "; of a controller the trial's file must give it"  # its defaults are its law's
    raise BadInput(f"{key} is not a key of the trial{hint}", place)


def _paths(values: Any, prefix: str = "") -> list[str]:
    if not isinstance(values, dict):
        return [prefix]
    inside = [_paths(v, f"{prefix}.{k}" if prefix else str(k)) for k, v in values.items()]
    return [path for paths in inside for path in paths]


def _numeric(value: Any) -> bool:
    if isinstance(value, list):
        return bool(value) and all(_numeric(entry) for entry in value)
    return isinstance(value, int | float) and not isinstance(value, bool)


def _variants(
    settings: StudySettings, base: dict[str, Any], source: str
) -> tuple[StudyVariant, ...]:
    axes = []
    for key, given in settings.compare.items():
        if key in _OWN:
            words = f"compare.{key}: is not allowed: every trial of a study has its own"
            raise BadInput(words, source)
        if key == REPLAN:
            _require_knowledge(given, source)
        elif key.split(".")[0] not in base:
            nominal_value(base, key, f"{source}: compare")
        named = given if isinstance(given, dict) else {_label(v): v for v in given}
        if len(named) != len(given):
            raise BadInput(f"compare.{key}: two entries read the same; give them names", source)
        if not named:
            raise BadInput(f"compare.{key}: is empty; name what is to be compared", source)
        shown = len(named) > 1  # one choice tells nothing apart
        axes.append([(label if shown else "", {key: v}) for label, v in named.items()])
    variants = []
    for choice in product(*axes):
        changes: dict[str, Any] = {}
        for _, change in choice:
            changes |= change
        changes = dict(sorted(changes.items(), key=lambda item: item[0].count(".")))
        label = ", ".join(label for label, _ in choice if label)
        knows = changes.pop(REPLAN, settings.replan)
        if knows == EXPERIMENT and not settings.shake:
            raise BadInput(
                "shake: is missing; name the keys that make the trial an experiment, such as "
                "plan: {method: excitation}",
                source,
            )
        variants.append(StudyVariant(label, changes, knows))
    return tuple(variants)


def _with_nominal(
    variant: StudyVariant, varied: Iterable[Varied], base: dict[str, Any], source: str, trust: Trust
) -> StudyVariant:
    """Return a variant with what draws are of where it says so itself.

    Raises:
        BadInput: a draw would replace what is compared.
    """
    place, found = f"{source}: vary", dict[str, Any]()
    keys = [(key, one.reference) for one in varied for key in one.keys]
    said = {p: v for p, v in variant.changes.items() if any(_overlap(p, key) for key, _ in keys)}
    values = plain(trial_of_values(overridden(base, said), source, trust)) if said else {}
    for key, reference in keys:
        changed = [path for path in said if _overlap(path, key)]
        if changed and reference != "absolute":
            found[key] = nominal_value(values, key, place)
            if not _numeric(found[key]):
                words = f"{key} is {found[key]!r} with {variant.label}"
                raise BadInput(f"{words}; {reference} needs numbers", place)
        elif any(path.startswith(key) for path in changed):
            words = "the draw would replace what is compared; use relative or offset"
            raise BadInput(f"{key} is not allowed beside compare.{changed[0]}: {words}", place)
    return variant._replace(nominal=found)


def _require_knowledge(given: list[Any] | dict[str, Any], source: str) -> None:
    for value in given.values() if isinstance(given, dict) else given:
        if value not in (False, True, EXPERIMENT, MANOEUVRE):
            allowed = f"false, true, {EXPERIMENT} or {MANOEUVRE}"
            raise BadInput(allowed, f"{source}: compare", REPLAN, value)


def _label(value: Any) -> str:
    if isinstance(value, dict):
        return str(value.get("method") or value.get("name") or value)
    return str(value)
