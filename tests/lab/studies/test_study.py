from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexslew_lab.studies.cases import case_of, case_trial, sample_table, trial_seed
from flexslew_lab.studies.flight import PlanCache
from flexslew_lab.studies.run import checked, prepare
from flexslew_lab.studies.study import Study, example_names, load_study, study_path
from flexslew_lab.trial.trial import Trial
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.csa import CsaTestbed

STIFFNESS = "testbed.parameters.bending_stiffness"
SPREAD = {"uniform": [0.0, 1.0]}
MANY = {f"v{k}": {"keys": [STIFFNESS], "offset": SPREAD} for k in range(65)}


def csa(trial: Trial) -> CsaTestbed:
    assert isinstance(trial.testbed, CsaTestbed)
    return trial.testbed


@pytest.mark.slow
@pytest.mark.parametrize("name", example_names())
def test_every_shipped_study_can_be_flown(name: str) -> None:
    """Its sampling, its criteria and what it varies are those of its trial."""
    study = load_study(study_path(name))
    samples = sample_table(study)
    columns, typical = checked(study, samples)
    assert set(study.settings.criteria) <= set(columns)
    assert len(typical) == len(study.variants)
    last = len(study.variants) * samples.num_rows - 1
    assert case_of(study, samples, last).sample == samples.num_rows - 1


def test_a_metric_that_there_is_not_is_refused_before_anything_is_planned(
    study_of: Callable[..., Study], monkeypatch: pytest.MonkeyPatch
) -> None:
    def keep(plans: PlanCache, trial: Trial) -> None:
        raise AssertionError("a plan was made")

    monkeypatch.setattr(PlanCache, "keep", keep)
    with pytest.raises(BadInput, match="did you mean residual_tip_deflection"):
        prepare(study_of(criteria={"residual_tip": {"below": 1.0}}))
    with pytest.raises(AssertionError, match="a plan was made"):
        prepare(study_of())


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"sead": 3}, "sead: unknown key; did you mean seed"),
        ({"sampling": {"metod": "random"}}, "metod: unknown key; did you mean method"),
        ({"vary": {STIFFNESS: {"unifrom": [0, 1]}}}, "unifrom: unknown key; did you mean uniform"),
        ({"vary": {STIFFNESS: {"relative": {"uniform": [0.1, 0.1]}}}}, "no spread"),
        ({"vary": {STIFFNESS: {"normal": [1500.0, 0.0]}}}, "no spread"),
        ({"vary": {STIFFNESS: {"choice": [1500.0, 1500.0]}}}, "no spread"),
        ({"vary": {STIFFNESS: {"loguniform": [0.0, 1.0]}}}, "both above 0"),
        ({"vary": {STIFFNESS: {"uniform": [1.0]}}}, r"give \[low, high\]"),
        ({"vary": {STIFFNESS: {"uniform": [1.0, "a"]}}}, r"give \[low, high\]"),
        ({"vary": {STIFFNESS: {"relative": SPREAD, "normal": [0, 1]}}}, "give one of"),
        ({"vary": {"testbed.parameters.bending_stifness": SPREAD}}, f"did you mean {STIFFNESS}"),
        ({"vary": {"active": {"relative": SPREAD}}}, "relative needs numbers"),
        ({"vary": {"controllers.lqr.model": SPREAD}}, "of a controller the trial's file must give"),
        ({"vary": {"seed": SPREAD}}, "a column of that name"),
        ({"vary": {}}, "vary: is missing"),
        ({"sampling": {"method": "sobol", "n": 100}}, "such as 64 and 128"),
        ({"sampling": {"method": "saltelli", "n": 96}}, "such as 64 and 128"),
        ({"sampling": {"method": "saltelli", "n": 64}, "vary": MANY}, "65 varied values: at most"),
        ({"sampling": {"method": "sobol", "n": 64, "replicates": 6}}, "a power of two"),
        (
            {"sampling": {"method": "random", "n": 64, "replicates": 8}},
            "only lhs, sobol and saltelli",
        ),
        ({"sampling": {"method": "lhs", "n": 4, "replicates": 8}}, "at most n, 4"),
        ({"sampling": {"method": "random", "file": "a.csv"}}, "only method list"),
        ({"sampling": {"method": "list"}}, "name the CSV file"),
        ({"criteria": {"residual_tip_deflection": {}}}, "either below or above"),
        ({"stop": {"metric": "peak_effort", "half_width": 0.0}}, "stop.half_width"),
        ({"compare": {"activ": ["lqr"]}}, "activ is not a key of the trial; did you mean active"),
        ({"compare": {"active": []}}, "is empty; name what"),
        ({"trial": "nothing"}, "neither a file nor a shipped trial"),
        ({"keep": {"bags": "best 5"}}, "keep.bags"),
        ({"vary": {"dice": {"keys": ["seed"], **SPREAD}}}, "every trial of a study has its own"),
        ({"vary": {STIFFNESS: SPREAD, "both": {"keys": [STIFFNESS], **SPREAD}}}, "the same value"),
        ({"vary": {"testbed": SPREAD, STIFFNESS: SPREAD}}, "both set the same value"),
        ({"vary": {STIFFNESS: SPREAD}, "compare": {STIFFNESS: [1.0, 2.0]}}, "relative or offset"),
        ({"vary": {"testbed.initial.base_yaw": {"relative": SPREAD}}}, "a share of 0 in every"),
        ({"compare": {"seed": [1, 2]}}, "compare.seed: is not allowed: every trial of a study"),
        ({"shake": {"plan": {"method": "excitation"}}}, "shake: is not allowed without replan"),
        ({"fit": ["damping_ratio"]}, "fit: is not allowed without replan"),
    ],
)
def test_bad_input_is_refused_in_one_line(
    study_of: Callable[..., Study], keys: dict[str, Any], words: str
) -> None:
    with pytest.raises(BadInput, match=words) as error:
        study_of(**keys)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"criteria": {"residual_tip": {"below": 1.0}}}, "did you mean residual_tip_deflection"),
        ({"stop": {"metric": "peak", "half_width": 1.0}}, "peak is not a metric"),
        ({"compare": {"active": ["pd_feedfoward"]}}, "pd_feedfoward .* allowed: pd_feedforward"),
        ({"vary": {"testbed.modes": {"uniform": [1.2, 1.4]}}}, "testbed.modes"),
        ({"vary": {"overshoot": {"keys": [STIFFNESS], **SPREAD}}}, "a metric has that name"),
    ],
)
def test_what_only_the_trial_knows_is_refused_before_the_first_flight(
    study_of: Callable[..., Study], keys: dict[str, Any], words: str
) -> None:
    study = study_of(**keys)
    with pytest.raises(BadInput, match=words) as error:
        prepare(study)
    assert "\n" not in str(error.value)


def test_a_share_of_zero_is_drawn_where_another_variant_has_more(
    study_of: Callable[..., Study],
) -> None:
    damping = {"testbed.damping_ratio": [0.0, 0.01]}
    study = study_of(vary={"testbed.damping_ratio": {"relative": SPREAD}}, compare=damping)
    trials = [case_trial(study, case_of(study, sample_table(study), k)) for k in (0, 1)]
    assert csa(trials[0]).damping_ratio == 0.0
    assert csa(trials[1]).damping_ratio > 0.01


def test_a_list_comes_from_a_file(study_of: Callable[..., Study], tmp_path: Path) -> None:
    (tmp_path / "points.csv").write_text(f"{STIFFNESS},seed\n1400,1\n")
    rows = f"{STIFFNESS},testbed.damping_ratio\n1400,0.01\n1600,0.02\n"
    (tmp_path / "list.csv").write_text(rows)
    study = study_of(sampling={"method": "list", "file": "list.csv"}, vary=None)
    samples = sample_table(study)
    trials = [case_trial(study, case_of(study, samples, k)) for k in (0, 1)]
    assert [csa(t).parameters.bending_stiffness for t in trials] == [1400.0, 1600.0]
    assert [csa(t).damping_ratio for t in trials] == [0.01, 0.02]
    with pytest.raises(BadInput, match="vary: is not allowed with a list"):
        study_of(sampling={"method": "list", "file": "list.csv"})
    (tmp_path / "list.csv").write_text(rows + "1,2,3\n")
    with pytest.raises(BadInput, match="row 4 has 3 of 2 entries"):
        study_of(sampling={"method": "list", "file": "list.csv"}, vary=None)
    (tmp_path / "list.csv").write_text(rows + "1,nan\n")
    with pytest.raises(BadInput, match="'nan' is no number"):
        study_of(sampling={"method": "list", "file": "list.csv"}, vary=None)


def test_draws_change_the_trial_as_they_say(study_of: Callable[..., Study]) -> None:
    study = study_of(
        vary={
            STIFFNESS: {"relative": {"uniform": [-0.2, 0.2]}},
            "payload": {
                "keys": ["testbed.parameters.hub_inertia_1", "testbed.parameters.hub_inertia_2"],
                "relative": {"normal": [0.0, 0.1]},
            },
            "controllers.pd_feedforward.kp": {"relative": {"uniform": [-0.1, 0.1]}},
            "controllers.pd_feedforward.kd.1": {"offset": {"triangular": [-1.0, 0.0, 1.0]}},
            "testbed.modes": {"choice": [1, 2]},
        }
    )
    samples = sample_table(study)
    for k in range(samples.num_rows):
        trial = case_trial(study, case_of(study, samples, k))
        draw = {name: samples[name][k].as_py() for name in samples.column_names}
        p = csa(trial).parameters
        assert p.bending_stiffness == 1500.0 * (1.0 + draw[STIFFNESS])
        assert p.hub_inertia_1 == p.hub_inertia_2 == 2000.0 * (1.0 + draw["payload"])
        scaled = 460.0 * (1.0 + draw["controllers.pd_feedforward.kp"])
        assert trial.controllers["pd_feedforward"]["kp"] == [scaled, scaled]
        shifted = 920.0 + draw["controllers.pd_feedforward.kd.1"]
        assert trial.controllers["pd_feedforward"]["kd"] == [920.0, shifted]
        assert trial.testbed.modes == draw["testbed.modes"]
        assert trial.seed == draw["seed"] == trial_seed(3, k)


def test_what_is_compared_meets_the_same_samples_and_seeds(study_of: Callable[..., Study]) -> None:
    study = study_of(compare={"active": ["pd_feedforward", "collocated_pid"]})
    samples = sample_table(study)
    for k in range(0, 2 * samples.num_rows, 2):
        one, other = (case_trial(study, case_of(study, samples, k + j)) for j in (0, 1))
        assert (one.active, other.active) == ("pd_feedforward", "collocated_pid")
        assert list(one.controllers) == ["pd_feedforward"]
        assert list(other.controllers) == ["collocated_pid"]
        assert (one.seed, one.testbed) == (other.seed, other.testbed)


def test_relative_draws_are_of_what_each_variant_has(study_of: Callable[..., Study]) -> None:
    gains = "controllers.pd_feedforward.kp"
    long = {"kind": "csa", "modes": 1, "parameters": {"length": 40.0}}
    study = study_of(
        compare={  # the later one holds the earlier one
            "testbed.parameters.bending_stiffness": [1000.0, 2000.0],
            "testbed": {"short": {"kind": "csa", "modes": 1}, "long": long},
            gains: {"soft": [100.0, 200.0], "stiff": [400.0, 500.0]},
            "active": ["pd_feedforward", "lqr"],
        },
        vary={
            STIFFNESS: {"relative": {"uniform": [-0.2, 0.2]}},
            "testbed.parameters.length": {"offset": {"uniform": [-1.0, 1.0]}},
            gains: {"relative": {"uniform": [-0.1, 0.1]}},
        },
    )
    samples = sample_table(study)
    seen = set()
    for k in range(2 * len(study.variants)):
        trial = case_trial(study, case := case_of(study, samples, k))
        changes = study.variants[case.variant].changes
        stiffness, length, gain = case.sampled_values
        p = csa(trial).parameters
        assert p.bending_stiffness == changes[STIFFNESS] * (1.0 + stiffness)
        assert p.length == changes["testbed"].get("parameters", {"length": 30.0})["length"] + length
        kp = trial.controllers["pd_feedforward"]["kp"]
        assert kp == [of * (1.0 + gain) for of in changes[gains]]
        seen.add((p.bending_stiffness, p.length, *kp))
    assert len(seen) == len(study.variants)  # two samples; the law in charge changes none of them


def test_seeds_come_from_the_study_s_seed_and_the_number_alone() -> None:
    expected = np.random.SeedSequence(7, spawn_key=(41,)).generate_state(1, np.uint64)[0] >> 1
    assert trial_seed(7, 41) == expected
    assert len({trial_seed(7, k) for k in range(1000)}) == 1000
    assert trial_seed(8, 41) != trial_seed(7, 41)


def test_controllers_keep_believing_in_the_nominal_bench(study_of: Callable[..., Study]) -> None:
    study = study_of(flown={"active": "lqr", "controllers": {"lqr": {}}})
    trial = case_trial(study, case_of(study, sample_table(study), 0))
    assert csa(trial).parameters.bending_stiffness != 1500.0
    assert trial.controllers["lqr"]["model"]["parameters"]["bending_stiffness"] == 1500.0
    assert trial.controllers["lqr"]["model"]["modes"] == 1
