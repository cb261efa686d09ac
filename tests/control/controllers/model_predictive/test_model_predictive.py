"""Model predictive control: the program's optimum, its limits, and M1 with the tips held."""

from dataclasses import replace
from typing import Any

import control
import numpy as np
import pytest
from scipy.optimize import minimize
from tests.plants import plant

from flexslew_control.controllers import build_controller
from flexslew_control.controllers.model_predictive.prediction import Program, costs, horizon
from flexslew_control.planners import plan_settings
from flexslew_control.planners.minimax.minimax_feedforward import MinimaxFeedforward, question_of
from flexslew_control.planners.minimax.optimum import found_optimum
from flexslew_control.planners.progress import ignore
from flexslew_control.planners.slew import slew_of
from flexslew_lab.notebook import fly, trial
from flexslew_lab.trial.trial import plant_of
from flexslew_plant.errors import BadInput, PlanFailed

_FEEDBACK = {"feedback": {"kp": [1.0], "kd": [2.0]}}  # that the planner counts with


def double_integrator(h: float) -> tuple[np.ndarray, np.ndarray]:
    return np.array([[1.0, h], [0.0, 1.0]]), np.array([[0.5 * h * h], [h]])


def undriven(x: np.ndarray, n: int) -> np.ndarray:
    """Return the states of n steps without efforts, shape (n, 2)."""
    f, _ = double_integrator(0.5)
    return np.array([np.linalg.matrix_power(f, k + 1) @ x for k in range(n)])


def program(n: int, hard: np.ndarray, soft: np.ndarray, shares: Any = None) -> Any:
    f, g = double_integrator(0.5)
    q, r = np.diag([2.0, 1.0]), np.array([[0.3]])
    ahead, cost = horizon(f, g, n), costs(f, g, q, r)
    shares = np.ones(n) if shares is None else shares
    return ahead, cost, Program(ahead, cost, shares, np.array([4.0]), hard, soft, 200)


def test_without_limits_it_is_the_regulator() -> None:
    f, g = double_integrator(0.5)
    gain, _, _ = control.dlqr(f, g, np.diag([2.0, 1.0]), np.array([[0.3]]))
    _, _, found = program(8, np.zeros((0, 8)), np.zeros((0, 16)))
    x = np.array([0.7, -0.2])
    wide = np.full(8, 1e6)
    free = undriven(x, 8)
    solved, _ = found.solve(free, np.zeros((8, 1)), -wide, wide, np.zeros(8))
    assert solved.optimal
    np.testing.assert_allclose(solved.efforts[0], -(gain @ x), rtol=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_within_limits_it_is_the_optimum_of_another_solver(seed: int) -> None:
    rng, n = np.random.default_rng(seed), 6
    hard = np.eye(n - 1, n, 1) - np.eye(n - 1, n)
    soft = np.kron(np.eye(n), [[1.0, 0.0]])
    shares = np.where(np.arange(n) < seed % 4, 0.01, 1.0)
    ahead, cost, found = program(n, hard, soft, shares)
    x, requested = rng.normal(0.0, 0.4, 2), rng.normal(0.0, 0.2, (n, 1))
    free = undriven(x, n)
    size = np.concatenate((np.full(n, 1.0), np.full(n - 1, 0.4), np.full(n, 2.0)))
    shift = np.concatenate((np.zeros(2 * n - 1), free[:, 0]))
    solved, active = found.solve(free, requested, -size - shift, size - shift, np.zeros(3 * n - 1))
    assert solved.optimal
    assert not solved.softened
    weights = np.array([s * (cost.state if k < n - 1 else cost.last) for k, s in enumerate(shares)])

    def value(v: np.ndarray) -> float:
        states = free + (ahead @ v).reshape(n, 2)
        efforts = v - requested.ravel()
        return float(np.einsum("ni,nij,nj", states, weights, states) + 0.3 * efforts @ efforts)

    rows = np.vstack((hard, soft @ ahead))
    limits = (size - shift)[n:], (-size - shift)[n:]
    other: Any = minimize(  # type: ignore[call-overload]
        value,
        np.zeros(n),
        bounds=[(-1.0, 1.0)] * n,
        constraints=[
            {"type": "ineq", "fun": lambda v: limits[0] - rows @ v},
            {"type": "ineq", "fun": lambda v: rows @ v - limits[1]},
        ],
        options={"ftol": 1e-12, "maxiter": 500},
    )
    assert other.success
    assert value(solved.efforts.ravel()) == pytest.approx(other.fun, rel=1e-5, abs=1e-7)
    again, _ = found.solve(free, requested, -size - shift, size - shift, active)
    assert again.iterations <= solved.iterations
    np.testing.assert_allclose(again.efforts, solved.efforts, atol=1e-6)


def oscillator(**own: Any) -> Any:
    """Return the flight of the floating oscillator by 1 m under the law, with these settings."""
    keys = {
        "name": "moved",
        "duration": 25.0,
        "testbed": {"kind": "floating_oscillator"},
        "plan": {"method": "reference_only", "goal": {"mass": 1.0}, "duration": 8.0} | _FEEDBACK,
        "controllers": {
            "model_predictive": {"step": 0.1, "weights": {"time": 2.0, "deflection": 1.0}, **own}
        },
        "active": "model_predictive",
    }
    return fly(trial(keys))


def softened(flight: Any) -> list[Any]:
    return [event for event in flight.events if event.kind == "softened"]


@pytest.mark.slow
def test_limits_are_kept_where_they_can_be() -> None:
    free = oscillator()
    assert abs(free["tip"]).max() > 0.08
    held = oscillator(tip_limit=0.05, effort_rate=2.0, joint_range={"mass": [-0.01, 1.004]})
    assert abs(held["tip"]).max() < 0.05 * 1.01
    assert held["position.mass"].max() < 1.004 + 1e-4
    assert abs(np.diff(held["effort"], axis=0)).max() <= 2.0 * 0.01 * (1.0 + 1e-6)
    assert softened(held) == []
    for flight in (free, held):
        assert abs(flight["position.mass"][-1] - 1.0) < 0.01


@pytest.mark.slow
def test_a_limit_that_no_effort_keeps_is_passed_with_an_event_and_the_goal_is_reached() -> None:
    flight = oscillator(joint_range={"mass": [0.2, 2.0]})  # the start is outside
    assert softened(flight)[0].data["limit"] == "mass"
    assert 0.15 < softened(flight)[0].data["excess"] < 0.25
    assert abs(flight["position.mass"][-1] - 1.0) < 0.01
    assert flight.metrics["missed_ticks"] == 0


@pytest.mark.slow
def test_too_few_iterations_repeat_the_last_answer_and_nobody_is_silent() -> None:
    flight = oscillator(tip_limit=0.05, iterations=1)
    assert flight.metrics["missed_ticks"] == 0
    assert np.isfinite(flight["effort"]).all()
    told = [event for event in flight.events if event.kind == "repeated"]
    assert [event.data["iterations"] for event in told] == [1] * len(told)
    assert 0 < len(told) < len(flight.time) / 10  # once for all in a row
    assert [event for event in oscillator(tip_limit=0.05).events if event.kind == "repeated"] == []


@pytest.mark.slow
def test_m1_with_the_tips_held_below_half_of_what_the_planned_feedforward_needs() -> None:
    flight = fly(trial("predictive_m1", {"duration": 30.0}))
    tips = abs(flight["tip"]).max(axis=1)
    assert tips.max() < 0.5 * 5.3
    assert tips[flight.time >= 24.2].max() < 0.02
    assert softened(flight) == []


@pytest.mark.slow
def test_no_plan_within_the_same_limits_is_a_sixth_shorter() -> None:
    """24.2 s are at most 1.2 times the least time of minimax_feedforward: 20.16 s do not do."""
    section = {
        "method": "minimax_feedforward", "goal": {"base_yaw": 1.0, "hub_pitch": 0.5},
        "duration": 24.2 / 1.2, "tip_limit": 0.5 * 5.3, "model": {"modes": 3},
        "ensemble": {"vary": {}}, "feedback": {"kp": [460.0, 460.0], "kd": [920.0, 920.0]},
    }  # fmt: skip
    settings = plan_settings(section, "test")
    assert isinstance(settings, MinimaxFeedforward)
    question = question_of(settings, slew_of(settings, plant_of(trial("predictive_m1"))))
    try:
        worst = found_optimum(question, ignore, 0.02).optimum.worst
    except PlanFailed:  # the limits let no efforts lead there
        worst = np.inf
    assert worst > 0.02
    enough = replace(question, duration=20.4)
    assert found_optimum(enough, ignore, 0.02).optimum.worst < 0.02


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"joint_range": {"elbow": [0.0, 1.0]}}, "joint_range"),
        ({"joint_range": {"base_yaw": [1.0, 0.0]}}, "joint_range.base_yaw"),
        ({"tip_limit": 0.0}, "tip_limit"),
        ({"steps": 0}, "steps"),
        ({"weights": {"mode": -1.0}}, "weights.mode"),
    ],
)
def test_what_cannot_be_is_refused_by_its_key(settings: dict[str, Any], named: str) -> None:
    with pytest.raises(BadInput, match=named):
        build_controller("mpc", "model_predictive", settings, plant(), "here")
