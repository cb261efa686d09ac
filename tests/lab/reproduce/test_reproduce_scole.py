"""SCOLE-S flown on the bench gives the numbers of its table."""

from collections.abc import Callable

import numpy as np
import pytest
from tests.representatives import representatives

from flexslew_control.controllers.sampled_loop import LinearPlant, collocated_loop, radius
from flexslew_control.plan import Plan
from flexslew_lab.reproduce import scole_flights
from flexslew_lab.reproduce.scole import TABLE, _full_model_rows, numbers
from flexslew_lab.reproduce.scole_flights import CASES, example_trial, simulate
from flexslew_lab.trial.trial import build_controllers
from flexslew_plant.errors import BadInput

RESIDUAL, EFFORT = 0.1, 0.01


@pytest.mark.slow
@pytest.mark.parametrize(
    "case",
    representatives(
        ["tracking (a)", "tracking (b)", "rigid hold", "open loop"], "rigid hold", "open loop"
    ),
)
def test_the_four_cases_give_the_table(
    case: str, shipped_plan: Callable[[str], Plan | None], monkeypatch: pytest.MonkeyPatch
) -> None:
    name, changes = CASES[case]
    assert not changes
    monkeypatch.setattr(scole_flights, "plan_of_trial", lambda _: shipped_plan(name))
    found, expected = numbers(simulate(case)), TABLE[case]
    tolerances = (EFFORT, *[RESIDUAL] * 4, EFFORT, EFFORT, EFFORT)
    for ours, reference, tolerance in zip(found, expected, tolerances, strict=True):
        if isinstance(reference, str):
            assert ours == reference
        else:
            assert ours == pytest.approx(reference, rel=tolerance, abs=1e-12)


def test_the_printed_weights_are_refused_with_the_spectral_radius() -> None:
    feedback = {"appendage": {"weight_exponents": [6.6, 2.0]}}
    trial = example_trial("scole_s_a", {"controllers": {"output_feedback": feedback}})
    with pytest.raises(BadInput, match=r"spectral radius .* longest period .* unusable") as error:
        build_controllers(trial, "here")
    assert "\n" not in str(error.value)


def test_a_sampled_loop_is_judged_as_it_flies() -> None:
    trial = example_trial("scole_s_a")
    model = trial.testbed.model()
    plant = LinearPlant(model, model.rest({}))
    stiff, damped = np.full(9, 1e3), np.full(9, 1e3)
    stiff[6:] = damped[6:] = 0.0
    assert radius(collocated_loop(plant, stiff, damped, 1e-3)) < 1.0
    assert radius(collocated_loop(plant, stiff, damped, 1.0)) > 1.0


def test_the_undamped_eight_modes_are_shown_and_say_why_they_are_not_flown() -> None:
    rows = _full_model_rows()
    assert [row["reference"] for row in rows] == [
        *TABLE["no damping (a), six modes"],
        *TABLE["no damping (b), six modes"],
    ]
    for row in rows:
        assert row["ok"] is None
        assert "eight modes" in row["item"]
        assert "spectral radius of one tick is 1.0" in row["because"]
