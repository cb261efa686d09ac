"""The trial of a sample is the one that its whole text describes."""

from collections.abc import Callable

import pytest

from flexslew_lab.studies.cases import case_of, case_trial, changes_of, sample_table
from flexslew_lab.studies.run import Preparation
from flexslew_lab.studies.study import Study
from flexslew_lab.trial.overrides import overridden
from flexslew_lab.trial.trial import trial_of_values
from flexslew_plant.errors import BadInput


def test_sections_checked_alone_make_the_trial_of_the_whole_text(ready: Preparation) -> None:
    study = ready.study
    for number in range(5):
        case = case_of(study, ready.samples, number)
        trial = case_trial(study, case)
        nominal = study.nominal[0].values
        own = {"seed": case.seed, "name": f"small-{number}", "rate_factor": 0.0}
        whole = overridden(nominal, changes_of(study, case)) | own
        assert trial == trial_of_values(whole, "test", study.trust)
        assert trial.testbed != study.nominal[0].trial.testbed


def test_a_sample_that_is_not_allowed_is_refused_by_its_key(
    study_of: Callable[..., Study],
) -> None:
    study = study_of(vary={"testbed.parameters.length": {"uniform": [-2.0, -1.0]}})
    case = case_of(study, sample_table(study), 0)
    with pytest.raises(BadInput, match=r"testbed\.parameters\.length"):
        case_trial(study, case)
