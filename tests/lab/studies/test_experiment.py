"""A study shakes its sampled benches and plans with what that finds."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from tests.representatives import representatives

from flexslew_lab.studies.cases import case_of, case_trial, sample_table
from flexslew_lab.studies.flight import PlanCache, simulate_case
from flexslew_lab.studies.study import EXAMPLES, Study, load_study
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import read_testbed

SAMPLES = 4  # of 200; `./flexslew study run identify_and_replan` flies all
SHAKE = {"plan": {"method": "excitation"}}


@pytest.fixture(scope="module")
def shipped() -> Study:
    return load_study(EXAMPLES / "identify_and_replan.yaml")


def frequency(section: Any) -> float:
    """Return the free frequency of the oscillator's spring."""
    model = read_testbed(section, "here").model()
    return float(model.linearise(model.rest({})).frequencies[0])


def left_by(study: Study) -> dict[str, float]:
    """Return the median residual at the tip of the first samples, by variant."""
    samples = sample_table(study)
    left: dict[str, list[float]] = {}
    for k in range(len(study.variants) * SAMPLES):
        case = case_of(study, samples, k)
        found = simulate_case(study, case, PlanCache())
        assert found.status == "ok", found.reason
        tip = found.metrics["residual_tip_deflection"]
        assert tip is not None
        left.setdefault(study.variants[case.variant].label, []).append(tip)
    return {label: float(np.median(tips)) for label, tips in left.items()}


@pytest.mark.slow
def test_a_plan_on_the_identified_bench_is_as_good_as_one_on_the_truth(shipped: Study) -> None:
    left = left_by(shipped)
    assert left["identified"] <= 1.5 * left["truth"]
    assert left["nominal"] > 5.0 * left["identified"]


@pytest.mark.slow
def test_a_changed_payload_is_told_by_the_last_manoeuvre() -> None:
    """Of a slew that believes the old payload; the next is as quiet as one that knows the truth."""
    study = load_study(EXAMPLES / "identify_from_manoeuvre.yaml")
    left, samples = left_by(study), sample_table(study)
    assert left["identified"] <= 1.5 * left["truth"]
    assert left["nominal"] > 5.0 * left["identified"]
    believed: Any = case_trial(study, case_of(study, samples, 1)).plan
    true = case_trial(study, case_of(study, samples, 2)).testbed
    assert frequency(believed.model) == pytest.approx(frequency(plain(true)), rel=2e-3)


@pytest.mark.parametrize("sample", representatives([7, 16, 25, 45], 7))
def test_where_the_poles_of_a_short_record_lead_astray_the_search_begins_without_them(
    sample: int,
) -> None:
    """Of the 200 payloads 38 got a mode with a damping ratio of .9, and plans that rang."""
    study = load_study(EXAMPLES / "identify_from_manoeuvre.yaml")
    samples = sample_table(study)
    believed: Any = case_trial(study, case_of(study, samples, 3 * sample + 1)).plan
    true = case_trial(study, case_of(study, samples, 3 * sample + 2)).testbed
    assert frequency(believed.model) == pytest.approx(frequency(plain(true)), rel=2e-3)


@pytest.mark.slow
def test_planner_and_laws_believe_what_was_found_and_the_bench_stays_the_sampled_one(
    shipped: Study,
) -> None:
    samples = sample_table(shipped)
    by_label = {
        shipped.variants[k].label: case_trial(shipped, case_of(shipped, samples, k))
        for k in range(3)
    }
    trial = by_label["identified"]
    assert trial.testbed == by_label["truth"].testbed == by_label["nominal"].testbed
    true = frequency(plain(trial.testbed))
    believed: Any = trial.plan
    assert believed.model["kind"] == "identified"
    assert frequency(believed.model) == pytest.approx(true, rel=2e-3)
    nominal: Any = by_label["nominal"].plan
    assert frequency(nominal.model) == pytest.approx(2.0**0.5, rel=1e-4)
    again: Any = case_trial(shipped, case_of(shipped, samples, 1)).plan
    assert again == believed


@pytest.mark.slow
def test_an_experiment_that_fits_gives_the_bench_its_own_equations_with_the_numbers_found() -> None:
    """Half of M1 on a drawn two-motor testbed: 20 times quieter, and as quiet as with the truth."""
    study = load_study(EXAMPLES / "identify_and_replan_csa.yaml")
    samples, left = sample_table(study), {}
    for k in range(3):
        found = simulate_case(study, case_of(study, samples, k), PlanCache())
        assert found.status == "ok", found.reason
        left[study.variants[k].label] = found.metrics["residual_tip_deflection"] or np.nan
    assert left["identified"] < 1.5 * left["truth"] < 0.1 * left["nominal"]


@pytest.mark.slow
def test_what_a_fit_cannot_find_is_refused(study_of: Callable[..., Study]) -> None:
    study = study_of(replan="experiment", fit=["parameters.mas"], shake=SHAKE | {"duration": 80.0})
    with pytest.raises(BadInput, match=r"parameters.mas is not a number of the testbed"):
        case_trial(study, case_of(study, sample_table(study), 0))


def test_a_manoeuvre_that_believes_no_model_tells_nothing(study_of: Callable[..., Study]) -> None:
    study = study_of(replan="manoeuvre", compare={"plan.method": ["none"]})
    with pytest.raises(BadInput, match="believes no model with modes; give a manoeuvre"):
        case_trial(study, case_of(study, sample_table(study), 0))


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"replan": "experiment"}, "shake: is missing"),
        ({"replan": "guessed"}, "replan"),
        ({"compare": {"replan": [False, "guessed"]}}, "guessed.*false, true, experiment or m"),
    ],
)
def test_what_cannot_be_meant_is_refused_in_one_line(
    study_of: Callable[..., Study], keys: dict[str, Any], words: str
) -> None:
    with pytest.raises(BadInput, match=words) as error:
        study_of(**keys)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("shake", "words"),
    [
        ({"duration": 2.0}, "shakes nothing"),
        (SHAKE | {"duration": 6.0}, "at least|not allowed|hold"),
    ],
)
def test_an_experiment_that_cannot_tell_fails_its_trial_with_the_reason(
    study_of: Callable[..., Study], shake: dict[str, Any], words: str
) -> None:
    study = study_of(replan="experiment", shake=shake)
    with pytest.raises(BadInput, match=words):
        case_trial(study, case_of(study, sample_table(study), 0))
