"""The total of a budget against members of the non-linear bench."""

from dataclasses import replace

import pytest
from tests.representatives import representatives

from flexslew_lab.budget.budget import Budget, BudgetRequest
from flexslew_lab.budget.pointing_budget import pointing_budget
from flexslew_lab.budget.prove import ProvedBudget, prove_budget
from flexslew_lab.trial.sources import read_trial
from flexslew_plant.errors import BadInput

_NOISE = ("sensors.joint_position.noise=1e-4", "sensors.joint_velocity.noise=1e-4")
_TRIALS = [
    ("m1", (*_NOISE, "duration=60")),
    ("three_axes", (*_NOISE, "sensors.joint_position.bias=2e-5")),
    ("replan_csa", ("actuator.quantisation=0.01",)),
]


def _proved(name: str, sets: tuple[str, ...], members: int) -> tuple[Budget, ProvedBudget]:
    trial, source = read_trial(name, list(sets))
    budget = pointing_budget(trial, source, BudgetRequest(window=5.0))
    return budget, prove_budget(trial, source, budget, members)


@pytest.mark.parametrize(("name", "sets"), representatives(_TRIALS, _TRIALS[0]))
def test_500_members_are_within_the_bounds_of_the_budget(name: str, sets: tuple[str, ...]) -> None:
    budget, proof = _proved(name, sets, 500)
    assert proof.holds, proof.metrics
    for one in proof.metrics:
        assert one.inside > budget.request.level - 0.005, one
        assert one.error < 0.05 * one.flown


def test_a_budget_with_a_noise_too_few_is_refuted() -> None:
    trial, source = read_trial("m1", ["sensors.joint_velocity.noise=1e-3", "duration=60"])
    quiet, _ = read_trial("m1", [*_NOISE, "duration=60"])
    budget = pointing_budget(quiet, source, BudgetRequest(window=5.0))
    assert not prove_budget(trial, source, budget, 32).holds


def test_what_members_do_not_draw_is_refused() -> None:
    trial, source = read_trial("m1", [])
    budget = pointing_budget(trial, source, BudgetRequest())
    varied = replace(budget, request=BudgetRequest(vary={"stiffness": 0.1}))
    with pytest.raises(BadInput, match="--vary"):
        prove_budget(trial, source, varied, 4)
    with pytest.raises(BadInput, match="at least 2"):
        prove_budget(trial, source, budget, 1)
