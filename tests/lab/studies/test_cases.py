"""The trial of a sample is the one that its whole text describes."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from tests.present import present
from tests.representatives import representatives

from flexslew_control.planners import PLANNERS
from flexslew_lab.studies.cases import case_of, case_trial, changes_of, sample_table
from flexslew_lab.studies.run import PreparedStudy
from flexslew_lab.studies.study import Study
from flexslew_lab.trial.overrides import override_values
from flexslew_lab.trial.trial import plan_of_trial, trial_of_values
from flexslew_plant.errors import BadInput


def test_sections_checked_alone_make_the_trial_of_the_whole_text(ready: PreparedStudy) -> None:
    study = ready.study
    for number in range(5):
        case = case_of(study, ready.samples, number)
        trial = case_trial(study, case)
        nominal = study.nominal[0].values
        own = {"seed": case.seed, "name": f"small-{number}", "rate_factor": 0.0}
        whole = override_values(nominal, changes_of(study, case)) | own
        assert trial == trial_of_values(whole, "test", study.trust)
        assert trial.testbed != study.nominal[0].trial.testbed


def test_a_sample_that_is_not_allowed_is_refused_by_its_key(
    study_of: Callable[..., Study],
) -> None:
    study = study_of(vary={"testbed.parameters.length": {"uniform": [-2.0, -1.0]}})
    case = case_of(study, sample_table(study), 0)
    with pytest.raises(BadInput, match=r"testbed\.parameters\.length"):
        case_trial(study, case)


@pytest.mark.slow
@pytest.mark.parametrize("model", [None, {"modes": 2}, {}])
def test_the_plan_of_a_spacecraft_in_a_study_is_that_of_its_trial(
    study_of: Callable[..., Study], model: dict[str, Any] | None
) -> None:
    """A model that is left out counts with one frequency, {} with all; a study changes neither."""
    beam = {"kind": "beam", "length": 6.0, "linear_density": 0.4, "bending_stiffness": 300.0}
    plan = {
        "method": "optimized_feedforward",
        "goal": {"roll": 0.3},
        "duration": 20.0,
        "iterations": "paper",
    }
    wheel = {"axis": [1.0, 0.0, 0.0], "inertia": 0.05, "limit": 20.0}
    trial = {
        "duration": 25.0,
        "period": 0.05,
        "testbed": {
            "kind": "spacecraft",
            "appendages": {
                "boom": {"hinge": {"place": [0.0, 0.5, 0.0]}, "shape": {**beam, "modes": 3}}
            },
            "actuators": {},
            "wheels": {"roll": wheel},
        },
        "plan": plan | ({} if model is None else {"model": model}),
        "controllers": {"pd_feedforward": {"kp": [30.0], "kd": [60.0]}},
    }
    study = study_of(
        flown=trial, vary={"controllers.pd_feedforward.kd": {"relative": {"uniform": [-0.1, 0.1]}}}
    )
    own = plan_of_trial(trial_of_values(study.base, "test", study.trust))
    flown = plan_of_trial(case_trial(study, case_of(study, sample_table(study), 0)))
    assert own is not None
    assert flown is not None
    np.testing.assert_array_equal(flown.effort, own.effort)


@pytest.mark.parametrize(
    "method",
    representatives(
        [name for name, entry in PLANNERS.items() if entry.slews],
        "input_shaping",
        "optimized_feedforward",
    ),
)
def test_a_study_that_varies_no_belief_flies_the_plan_of_its_trial(
    study_of: Callable[..., Study], method: str
) -> None:
    trial = {
        "duration": 30.0,
        "period": 0.05,
        "testbed": {"kind": "floating_oscillator", "effort_limit": [2.0]},
        "plan": {**PLANNERS[method].example, "method": method, "goal": {"mass": 0.5}},
        "controllers": {"pd_feedforward": {"kp": [1.0], "kd": [1.5]}},
    }
    study = study_of(flown=trial, vary={"sensors.joint_position.noise": {"uniform": [0.0, 1e-6]}})
    own = present(plan_of_trial(trial_of_values(study.base, "test", study.trust)))
    flown = present(plan_of_trial(case_trial(study, case_of(study, sample_table(study), 0))))
    np.testing.assert_array_equal(flown.effort, own.effort)
    np.testing.assert_array_equal(flown.position, own.position)
