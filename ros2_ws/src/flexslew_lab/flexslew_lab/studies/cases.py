"""The trials of a study by number: which sample, which variant, which seed, which trial exactly."""

from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from flexslew_control.controllers import CONTROLLERS, require_law
from flexslew_control.planners import is_single_axis, takes_gains_in_charge
from flexslew_control.planners.attitude.one_axis import split_modes
from flexslew_lab.studies.experiment import found_by_flying
from flexslew_lab.studies.sampling.methods import Samples, draw_samples
from flexslew_lab.studies.study import Nominal, Place, Study
from flexslew_lab.studies.study_settings import EXPERIMENT, MANOEUVRE
from flexslew_lab.studies.variants import StudyVariant
from flexslew_lab.trial.overrides import keys_to, override_values, put, value_at
from flexslew_lab.trial.trial import (
    SEPARATE_SECTIONS,
    Trial,
    checked_trial,
    feedback_of,
    law_of,
    plant_of,
    trial_of_values,
    with_sections,
)
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import Trust
from flexslew_plant.settings import plain, validated
from flexslew_plant.testbeds import design_testbed, initial_positions


class Case(NamedTuple):
    """One trial of a study."""

    number: int
    sample: int
    variant: int
    seed: int  # of everything random in it
    sampled_values: tuple[Any, ...]  # one per varied value


def sample_table(study: Study) -> pa.Table:
    """Return the samples: number, replicate, seed, and the draw of every varied value."""
    samples = _samples(study)
    count = len(samples.replicate)
    columns: dict[str, Any] = {
        "sample": np.arange(count, dtype=np.int64),
        "replicate": samples.replicate,
        "seed": np.array([trial_seed(study.settings.seed, k) for k in range(count)]),
    }
    for j, variable in enumerate(study.varied):
        if samples.values:
            columns[variable.name] = samples.values[j]
        else:
            assert variable.distribution is not None
            columns[variable.name] = variable.distribution.at(samples.unit[:, j])
    return pa.table(columns)


def trial_seed(seed: int, sample: int) -> int:
    """Return the seed of a sample's trials, 63 bits: the same for all that is compared."""
    state = np.random.SeedSequence(seed, spawn_key=(sample,)).generate_state(1, np.uint64)
    return int(state[0]) >> 1


def case_of(study: Study, samples: pa.Table, index: int) -> Case:
    """Return the trial with a number; those of one sample follow each other.

    Raises:
        BadInput: the study has no such trial.
    """
    last = samples.num_rows * len(study.variants)
    if not 0 <= index < last:
        raise BadInput(f"trial {index} is not one of 0 to {last - 1}", study.source)
    sample, variant = divmod(index, len(study.variants))
    sampled_values = tuple(samples[variable.name][sample].as_py() for variable in study.varied)
    return Case(index, sample, variant, samples["seed"][sample].as_py(), sampled_values)


class Cases:
    """Trials of a study by their numbers, made as they are taken."""

    def __init__(self, study: Study, samples: pa.Table, numbers: Sequence[int]) -> None:
        self._study, self._samples = study, samples
        self._numbers = iter(numbers)
        self._left = len(numbers)

    def __iter__(self) -> Iterator[Case]:
        """Return itself."""
        return self

    def __next__(self) -> Case:
        """Return the next one."""
        case = case_of(self._study, self._samples, next(self._numbers))
        self._left -= 1
        return case

    def __length_hint__(self) -> int:
        """Return how many are left."""
        return self._left


def typical_case(study: Study, samples: pa.Table, variant: int) -> Case:
    """Return a trial in the middle of the distributions, not one of the study's own."""
    sampled_values = []
    for variable in study.varied:
        if variable.distribution is None:
            sampled_values.append(samples[variable.name][0].as_py())
        else:
            sampled_values.append(variable.distribution.at(np.array([0.5])).tolist()[0])
    return Case(-1, 0, variant, trial_seed(study.settings.seed, 0), tuple(sampled_values))


def changes_of(study: Study, case: Case) -> dict[str, Any]:
    """Return what the sample changes of the trial, by key."""
    places = nominal_of(study, case.variant).places
    return {
        place.key: place.varied.value(place.nominal, case.sampled_values[place.draw])
        for place in places
    }


def require_variant(study: Study, variant: StudyVariant) -> None:
    """Check the trial of a variant with all of its controllers, also those that never fly.

    Raises:
        BadInput: a name or a value of it is not allowed.
    """
    values = override_values(study.base, variant.changes)
    flying = _flying(values, study.source, study.trust)["controllers"]
    whole = values | {"controllers": flying | values["controllers"]}
    checked_trial(trial_of_values(whole, study.source, study.trust), study.source)
    for name, section in whole["controllers"].items():
        law, _ = law_of(name, section or {})
        require_law(law, f"{study.source}: controllers.{name}", study.trust)


def nominal_of(study: Study, variant: int) -> Nominal:
    """Return the trial of a variant without a sample, which is made once.

    Raises:
        BadInput: a value of it is not allowed.
    """
    if variant not in study.nominal:
        local_settings = study.variants[variant]
        requested = override_values(study.base, local_settings.changes)
        whole = _flying(requested, study.source, study.trust)
        known = local_settings.replan is True
        values = whole if known else with_model_sections(whole, study.source, study.trust)
        trial = trial_of_values(values, study.source, study.trust)
        study.nominal[variant] = Nominal(values, trial, *_places(study, variant, values))
    return study.nominal[variant]


def _places(
    study: Study, variant: int, values: dict[str, Any]
) -> tuple[tuple[Place, ...], dict[str, Any]]:
    """Return where samples change the trial of a variant, and the sections in which that is."""
    local_settings, keys = (
        study.variants[variant].nominal,
        [key for v in study.varied for key in v.keys],
    )
    touched = {key: values[key] for key in {path.split(".")[0] for path in keys}}
    changed, places = dict(touched), list[Place]()
    for draw, variable in enumerate(study.varied):
        for key in variable.keys:
            nominal = local_settings[key] if key in local_settings else value_at(study.base, key)
            places.append(Place(key, keys_to(changed, key), nominal, variable, draw))
            put(changed, places[-1].way, nominal)  # a section that is missing is there for others
    return tuple(places), touched


def case_trial(study: Study, case: Case) -> Trial:
    """Return the trial of a case.

    Controllers that never take charge are left out: they change nothing. Without `replan`, what
    planner and controllers believe of the bench is written out, so it stays the nominal one; with
    `replan: experiment` the sampled bench is shaken, with `manoeuvre` it flies the trial once
    before, and they believe what that has found.
    Sections that no sample changes are those of the nominal trial, which was checked already.

    Raises:
        BadInput: the sample's values are not allowed together.
    """
    source = f"{study.source}: trial {case.number}"
    nominal = nominal_of(study, case.variant)
    changes, changed = changes_of(study, case), dict(nominal.touched)
    for place in nominal.places:
        put(changed, place.way, changes[place.key])
    name = f"{study.settings.study}-{max(case.number, 0)}"
    local_settings = {"seed": case.seed, "name": name, "rate_factor": 0.0}
    if changed.keys() <= SEPARATE_SECTIONS:
        trial = with_sections(nominal.trial, changed | local_settings, source)
    else:
        nominal_values = {
            key: value for key, value in vars(nominal.trial).items() if key in nominal.values
        }
        trial = trial_of_values(nominal_values | changed | local_settings, source, study.trust)
    plan_mode = study.variants[case.variant].replan
    if plan_mode not in (EXPERIMENT, MANOEUVRE):
        return trial
    test_input = study.settings.shake if plan_mode == EXPERIMENT else {}
    found = found_by_flying(
        _experiment(study, case, changes, test_input),
        nominal.trial.testbed,
        study.settings.fit,
        require_test_input=plan_mode == EXPERIMENT,
    )
    requested = override_values(study.base, study.variants[case.variant].changes)
    flying = _flying(override_values(requested, changes), source, study.trust)
    values = with_model_sections(flying, source, study.trust, found)
    return trial_of_values(values | local_settings, source, study.trust)


def _experiment(
    study: Study, case: Case, changes: dict[str, Any], test_input: dict[str, Any]
) -> Trial:
    """Return the trial that a sampled bench flies first; its plan believes the nominal one."""
    source = f"{study.source}: shake"
    requested = override_values(study.base, study.variants[case.variant].changes | test_input)
    flying = _flying(requested, source, study.trust)
    nominal = with_model_sections(flying, source, study.trust)
    local_settings = {"seed": trial_seed(case.seed, 0), "name": "shake", "rate_factor": 0.0}
    return trial_of_values(override_values(nominal, changes) | local_settings, source, study.trust)


def _flying(values: dict[str, Any], source: str, trust: Trust) -> dict[str, Any]:
    """Return the trial with only those controllers that may become active, new ones by default.

    Raises:
        BadInput: a value of `values` is of another kind than its key.
    """
    validated(Trial, values, source, trust)
    requested = [values["active"], *values["fallback"]]
    requested += [entry["switch"] for entry in values["schedule"] if entry.get("switch")]
    given = values["controllers"]
    if not all(name in given or name in CONTROLLERS for name in requested):
        return values  # which is refused, with all that there are
    controllers = {}
    for name in dict.fromkeys(requested):
        if name in given:
            controllers[name] = given[name]
        elif name in CONTROLLERS:
            controllers[name] = {}
    return values | {"controllers": controllers}


def with_model_sections(
    values: dict[str, Any], source: str, trust: Trust, found: dict[str, Any] | None = None
) -> dict[str, Any]:
    """Return the trial with all beliefs about the nominal bench written out.

    What planner and controllers would take from the testbed they meet: its model, where its joints
    rest, and, for the planner, the gains of the controller in charge.

    Args:
        values: of the trial.
        source: for messages.
        trust: which classes it may name.
        found: a testbed's section that they believe in; None: the trial's own.
    """
    nominal = trial_of_values(values, source, trust)

    def model(given: Any, place: str) -> dict[str, Any]:
        if found is not None:
            return found | {k: v for k, v in (given or {}).items() if k in found and k != "kind"}
        design_values: dict[str, Any] = plain(
            design_testbed(nominal.testbed, given, f"{source}: {place}", trust)
        )
        return design_values

    controllers = {}
    for name, local_settings in values["controllers"].items():
        law, _ = law_of(name, local_settings or {})
        design_values = {}
        if law in CONTROLLERS and _has(CONTROLLERS[law].settings, "model"):
            design_values["model"] = model(
                (local_settings or {}).get("model"), f"controllers.{name}.model"
            )
        controllers[name] = (local_settings or {}) | design_values
    plan = values["plan"]
    if plan is not None and "method" in plan:  # else a plan from its file
        settings: Any = nominal.plan
        known = type(settings)
        design_values = {}
        if _has(known, "model"):
            count, given = None, plan.get("model")
            if is_single_axis(settings, plant_of(nominal)):  # no key of its testbed
                count, given = split_modes(given, f"{source}: plan.model")
            design_values["model"] = model(given or None, "plan.model")
            if count is not None:
                design_values["model"]["modes"] = count
        if _has(known, "initial"):
            design_values["initial"] = initial_positions(nominal.testbed) | (
                plan.get("initial") or {}
            )
        try:
            feedback = feedback_of(nominal)
        except BadInput as error:
            raise BadInput(str(error), source) from None
        counts = takes_gains_in_charge(settings)
        if counts and plan.get("feedback") is None and feedback is not None:
            design_values["feedback"] = plain(feedback)
        plan = plan | design_values
    return values | {"controllers": controllers, "plan": plan}


def _has(settings: type[Any], key: str) -> bool:
    return is_dataclass(settings) and any(field.name == key for field in fields(settings))


def _samples(study: Study) -> Samples:
    if study.list_columns:
        count = len(study.list_columns[0])
        return Samples(np.empty((count, 0)), study.list_columns, np.zeros(count, dtype=np.int32))
    spread = [v.distribution for v in study.varied if v.distribution is not None]
    return draw_samples(study.settings.sampling, spread, study.settings.seed)
