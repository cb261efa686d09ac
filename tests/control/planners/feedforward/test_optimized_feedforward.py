from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from tests.plants import plant

from flexslew_control.planners import (
    make_plan,
    plan_settings,
)
from flexslew_control.planners.feedforward.basis import Basis
from flexslew_control.planners.feedforward.manoeuvre import Manoeuvre, TerminalMap, substeps_for
from flexslew_control.planners.feedforward.optimized_feedforward import OptimizedFeedforward
from flexslew_control.planners.reference import NoPlan, ReferenceOnly
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.settings import validated
from flexslew_plant.testbeds.csa import CsaParameters, CsaTestbed, CsaVariant

GAIN_P, GAIN_D = np.array([460.0, 460.0]), np.array([920.0, 920.0])
PRINTED = {"variant": "printed"}
M1, M3, M8 = (1.0, 0.5), (np.pi / 2, np.pi / 4), (1.0, 0.0)
BASES = ("hat", "constant", "cubic", "trigonometric")


def plan(goal: Any = M1, limit: float = 200.0, modes: int = 1, **more: Any) -> Any:
    return found(goal, limit, modes, tuple(more.items()))


@lru_cache(maxsize=64)
def found(goal: Any, limit: Any, modes: Any, more: Any) -> Any:
    values = {
        "model": PRINTED | {"modes": modes},
        "goal": {"base_yaw": goal[0], "hub_pitch": goal[1]},
        "track": "reference",
    }
    asked = validated(OptimizedFeedforward, values | dict(more), "test")
    return make_plan(asked, plant(0.05, [limit, limit]))


def slew(modes: int = 1, variant: CsaVariant = "printed", goal: Any = M1) -> Manoeuvre:
    model = CsaTestbed(variant=variant, modes=modes).model()
    return Manoeuvre(model, GAIN_P, GAIN_D, np.zeros(2), np.array(goal), 25.0, "cubic")


def residual_tip(
    flown: Any, variant: CsaVariant = "printed", stiffness: float = 1.0, until: float = 100.0
) -> float:
    """Return the largest tip deflection after the manoeuvre [m], feedback continuous in time."""
    asked = flown.request
    parameters = CsaParameters(bending_stiffness=1500.0 * stiffness)
    model = CsaTestbed(variant=variant, modes=1, parameters=parameters).model()
    goal = np.array([asked["goal"]["base_yaw"], asked["goal"]["hub_pitch"]])
    bench = Manoeuvre(model, GAIN_P, GAIN_D, np.zeros(2), goal, 25.0, "cubic")
    edges = np.linspace(0.0, until, round(until / flown.period) + 1)
    held = np.zeros((len(edges) - 1, 2))
    held[: flown.ticks] = flown.effort
    path = bench.fly(edges, np.repeat(held, 12, axis=0))
    return float(np.abs(path[edges >= 25.0, 2]).max())


@pytest.mark.parametrize(
    ("goal", "objective", "norm_input"),
    [(M1, 1.120818e-3, 163.3732), (M3, 2.547486e-3, 248.9926), (M8, 1.136050e-3, None)],
)
def test_regularised_optimum_of_the_tables(
    goal: Any, objective: float, norm_input: float | None
) -> None:
    found = plan(goal, reading="regularised").summary
    assert found["objective"] == pytest.approx(objective, rel=1e-6)
    if norm_input:
        assert found["norm_input"] == pytest.approx(norm_input, rel=2e-6)


def test_terminal_error_of_m1() -> None:
    assert plan(reading="regularised").summary["norm_terminal_error"] == pytest.approx(
        0.00729, abs=5e-6
    )


def test_the_linear_manoeuvre_needs_one_update() -> None:
    history = plan(M8, reading="regularised", iterations="paper").summary["history"]
    assert history[0]["objective"] == pytest.approx(history[-1]["objective"], rel=1e-7)


@pytest.mark.parametrize(("goal", "least"), [(M1, 172.6733), (M3, 256.4065)])
def test_minimum_norm_problem(goal: Any, least: float) -> None:
    found = plan(goal, reading="regularised", rho=4e-14).summary
    assert found["norm_input"] == pytest.approx(least, rel=2e-6)
    assert found["norm_terminal_error"] < 2e-8
    levenberg = plan(goal).summary
    assert levenberg["norm_terminal_error"] < 1e-7
    assert least <= levenberg["norm_input"] < 1.0006 * least


def test_two_evaluations_with_three_updates_each() -> None:
    best = plan(reading="regularised").summary["objective"]
    found = plan(reading="regularised", iterations="paper").summary
    assert [u["fresh"] for u in found["history"]] == [True, False, False] * 2
    assert 0.0 <= found["objective"] / best - 1.0 <= 5e-5


def test_six_levenberg_updates_leave_little() -> None:
    found = plan(iterations="paper")
    assert found.summary["norm_terminal_error"] == pytest.approx(2e-5, rel=0.05)
    assert residual_tip(found) <= 0.002


def test_a_smaller_weight_reaches_the_claimed_terminal_error() -> None:
    found = plan(reading="regularised", rho=4e-10)
    assert found.summary["norm_terminal_error"] == pytest.approx(1e-4, rel=0.02)
    assert residual_tip(found) == pytest.approx(0.008, abs=1e-3)


@pytest.mark.parametrize(
    ("stiffness", "planned", "bare"),
    [(0.8, 0.641, 6.76), (0.9, 0.284, 5.80), (1.1, 0.227, 4.51), (1.2, 0.415, 4.06)],
)
def test_robustness_against_stiffness(stiffness: float, planned: float, bare: float) -> None:
    found = plan(reading="regularised", rho=4e-10)
    assert residual_tip(found, stiffness=stiffness) == pytest.approx(planned, abs=2e-3)
    nothing = make_plan(ReferenceOnly(model=PRINTED), plant(0.05, [200.0, 200.0]))
    assert residual_tip(nothing, stiffness=stiffness) == pytest.approx(bare, abs=0.01)


def test_the_other_variant_is_a_realistic_model_error() -> None:
    assert 0.08 < residual_tip(plan(), variant="complete") < 0.27
    assert 0.08 < residual_tip(plan(M3), variant="complete") < 0.27


def test_peak_torque_of_m1() -> None:
    found = plan(reading="regularised").summary["peak_effort"]
    assert found[0] == pytest.approx(64.0, abs=1.0)


@pytest.mark.parametrize("variant", ["printed", "complete"])
@pytest.mark.parametrize("modes", [1, 3])
def test_exact_sensitivities_are_the_limit_of_differences(modes: int, variant: CsaVariant) -> None:
    weights = 30.0 * np.random.default_rng(1).standard_normal(18)
    at = TerminalMap(slew(modes, variant), Basis("hat", 9, 25.0), 4 * modes)
    error = at.terminal_error(weights)
    exact = at.sensitivity()
    above, below = at.secant(weights, error, 1e-2), at.secant(weights, error, -1e-2)
    np.testing.assert_allclose((above + below) / 2.0, exact, atol=1e-10)
    np.testing.assert_allclose(above, exact, atol=1e-4 * np.abs(exact).max())


@pytest.mark.parametrize("modes", [1, 3])
def test_the_chosen_grid_is_accurate(modes: int) -> None:
    basis, bed = Basis("hat", 9, 25.0), slew(modes)
    weights = 40.0 * np.random.default_rng(2).standard_normal(18)
    chosen = substeps_for(bed, basis)
    fine = TerminalMap(bed, basis, 3 * chosen).terminal_error(weights)
    found = TerminalMap(bed, basis, chosen).terminal_error(weights)
    assert np.abs(found - fine).max() < 1e-8


@pytest.mark.parametrize("basis", BASES)
def test_every_basis_ends_at_rest(basis: Any) -> None:
    found = plan(basis=basis)
    assert found.summary["converged"]
    assert found.summary["norm_terminal_error"] < 1e-7
    assert residual_tip(found) < 0.01


def test_differences_lead_to_the_same_plan() -> None:
    exact, secant = plan(), plan(sensitivities="finite_difference")
    np.testing.assert_allclose(secant.effort, exact.effort, atol=1e-3)


def test_three_modes_converge() -> None:
    found = plan(modes=3, limit=500.0).summary
    assert found["converged"]
    assert found["norm_terminal_error"] < 1e-6


def test_nominal_state_ends_at_the_goal() -> None:
    found = plan()
    np.testing.assert_allclose(found.state[-1], [1.0, 0.5, 0, 0, 0, 0], atol=1e-7)
    np.testing.assert_allclose(found.state[0], 0.0)
    assert found.state.shape == (501, 6)


def test_effort_of_a_tick_is_the_mean_of_the_feedforward() -> None:
    found = plan()
    weights = np.array(found.summary["weights"])
    np.testing.assert_allclose(found.effort.mean(axis=0), weights.sum(axis=1) * 2.5 / 25.0)


def test_progress_hears_every_update() -> None:
    heard: list[Any] = []
    found = make_plan(OptimizedFeedforward(), plant(0.05, [200.0, 200.0]), progress=heard.append)
    assert [u.number for u in heard] == list(range(1, found.summary["iterations"] + 1))
    assert heard[-1].norm_input == found.summary["norm_input"]


def test_staying_where_one_is_needs_nothing() -> None:
    still = OptimizedFeedforward(goal={"base_yaw": 0.0, "hub_pitch": 0.0})
    assert np.all(make_plan(still, plant(0.05, [1.0, 1.0])).effort == 0.0)


def test_too_much_torque_is_said_with_numbers() -> None:
    with pytest.raises(PlanFailed, match=r"needs 7\d\.\d+ N m on base_yaw, the limit is 50 N m"):
        plan(limit=50.0)


def test_no_convergence_is_said_with_numbers() -> None:
    with pytest.raises(PlanFailed, match=r"after 2 updates: relative change .* allowed 1\.0e-06"):
        plan(max_iterations=2)


@pytest.mark.parametrize(("period", "limit"), [(0.0, [1, 1]), (np.nan, [1, 1]), (0.1, [1, -1])])
def test_bad_ticks_and_limits_are_refused(period: Any, limit: Any) -> None:
    with pytest.raises(BadInput):
        make_plan(NoPlan(), plant(period, limit))


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"method": "optimized_feedforward", "duration": 0.0}, "duration"),
        ({"method": "optimized_feedforward", "rho": float("nan")}, "rho"),
        ({"method": "optimized_feedforward", "basis": "hats"}, "basis"),
    ],
)
def test_bad_sections_are_refused_by_file_and_key(values: Any, words: str) -> None:
    with pytest.raises(BadInput, match=words) as caught:
        plan_settings(values, "trial.yaml")
    assert str(caught.value).startswith("trial.yaml")
    assert "\n" not in str(caught.value)
