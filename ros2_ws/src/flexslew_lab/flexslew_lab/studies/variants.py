"""What a study compares: the same samples with changes of the trial."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from flexslew_lab.studies.study_settings import (
    EXPERIMENT,
    MANOEUVRE,
    REPLAN,
    ModelSource,
    StudySettings,
)
from flexslew_lab.studies.varied import (
    PER_TRIAL_KEYS,
    SampledParameter,
    nominal_value,
    numeric,
    overlap,
)
from flexslew_lab.trial.overrides import override_values, value_at
from flexslew_lab.trial.trial import trial_of_values
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import Trust
from flexslew_plant.settings import plain


class StudyVariant(NamedTuple):
    """One of what is compared: the same samples with these changes of the trial."""

    label: str  # empty where nothing is compared
    changes: dict[str, Any]
    replan: ModelSource = False  # see StudySettings
    nominal: Mapping[str, Any] = {}  # nominal values of draws by key, where its changes set them


def variants_of(
    settings: StudySettings, base: dict[str, Any], source: str
) -> tuple[StudyVariant, ...]:
    """Return every combination of what a study compares; one without changes if it does not.

    Args:
        settings: of the study.
        base: the trial as plain data.
        source: the study's file, for messages.

    Raises:
        BadInput: a key may not be compared, or two entries are one.
    """
    axes = []
    for key, given in settings.compare.items():
        if key in PER_TRIAL_KEYS:
            words = f"compare.{key}: is not allowed: every trial of a study has its own"
            raise BadInput(words, source)
        if key == REPLAN:
            _require_model_source(given, source)
        elif key.split(".")[0] not in base:
            nominal_value(base, key, f"{source}: compare", (REPLAN,))
        named = given if isinstance(given, dict) else {_label(v): v for v in given}
        if len(named) != len(given):
            raise BadInput(f"compare.{key}: two entries read the same; give them names", source)
        if not named:
            raise BadInput(f"compare.{key}: is empty; name what is to be compared", source)
        has_label = len(named) > 1  # one choice needs no label
        axes.append([(label if has_label else "", {key: v}) for label, v in named.items()])
    variants = []
    for choice in product(*axes):
        changes: dict[str, Any] = {}
        for _, change in choice:
            changes |= change
        changes = dict(sorted(changes.items(), key=lambda item: item[0].count(".")))
        label = ", ".join(label for label, _ in choice if label)
        model_source = changes.pop(REPLAN, settings.replan)
        if model_source == EXPERIMENT and not settings.shake:
            raise BadInput(
                "shake: is missing; name the keys that make the trial an experiment, such as "
                "plan: {method: excitation}",
                source,
            )
        variants.append(StudyVariant(label, changes, model_source))
    return tuple(variants)


def require_nonzero_spread(
    settings: StudySettings,
    sampled: Iterable[SampledParameter],
    variants: Sequence[StudyVariant],
    base: dict[str, Any],
    source: str,
) -> None:
    """Refuse a draw that is a share of zero everywhere, and what only experiments make use of."""
    for one in sampled:
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


def with_nominal(
    variant: StudyVariant,
    sampled: Iterable[SampledParameter],
    base: dict[str, Any],
    source: str,
    trust: Trust,
) -> StudyVariant:
    """Return a variant with the nominal values of draws, by key, that its changes set.

    Raises:
        BadInput: if a draw would replace what is compared.
    """
    place, found = f"{source}: vary", dict[str, Any]()
    keys = [(key, one.reference) for one in sampled for key in one.keys]
    relevant_changes = {
        p: v for p, v in variant.changes.items() if any(overlap(p, key) for key, _ in keys)
    }
    values = (
        plain(trial_of_values(override_values(base, relevant_changes), source, trust))
        if relevant_changes
        else {}
    )
    for key, reference in keys:
        changed = [path for path in relevant_changes if overlap(path, key)]
        if changed and reference != "absolute":
            found[key] = nominal_value(values, key, place)
            if not numeric(found[key]):
                words = f"{key} is {found[key]!r} with {variant.label}"
                raise BadInput(f"{words}; {reference} needs numbers", place)
        elif any(path.startswith(key) for path in changed):
            words = "the draw would replace what is compared; use relative or offset"
            raise BadInput(f"{key} is not allowed beside compare.{changed[0]}: {words}", place)
    return variant._replace(nominal=found)


def _require_model_source(given: list[Any] | dict[str, Any], source: str) -> None:
    named = given.items() if isinstance(given, dict) else enumerate(given)
    for label, value in named:
        if value not in (False, True, EXPERIMENT, MANOEUVRE):
            allowed = f"false, true, {EXPERIMENT} or {MANOEUVRE}"
            raise BadInput(allowed, f"{source}: compare", f"{REPLAN}.{label}", value)


def _label(value: Any) -> str:
    if isinstance(value, dict):
        return str(value.get("method") or value.get("name") or value)
    return str(value)
