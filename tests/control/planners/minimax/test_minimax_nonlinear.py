"""Plants that are not linear: exact derivatives, promises kept, local optima."""

import itertools
import re
from typing import Any

import numpy as np
import pytest
from tests.plants import late, plant
from tests.present import present
from tests.representatives import representatives, seeds

from flexslew_control.planners import PLANNERS, make_plan, plan_settings
from flexslew_control.planners.minimax import shortest
from flexslew_control.planners.minimax.members import members_of
from flexslew_control.planners.minimax.minimax_feedforward import question_of
from flexslew_control.planners.minimax.nonlinear_path import (
    PathProblem,
    affine_path,
    channels,
    deviation,
)
from flexslew_control.planners.minimax.successive import ensemble_problem
from flexslew_control.planners.residual.prediction import predicted
from flexslew_control.planners.slew import Feedback, slew_of
from flexslew_plant.errors import PlanFailed
from flexslew_plant.testbeds import read_testbed

QUICK = PLANNERS["minimax_feedforward"].example
GAINS = {"csa": Feedback(), "hub_with_appendages": Feedback(kp=(10.0,), kd=(20.0,))}


def planned(kind: str = "csa", initial: Any = None, **more: Any) -> Any:
    testbed = read_testbed({"kind": kind, **({"initial": initial} if initial else {})}, "t")
    section = plan_settings({"method": "minimax_feedforward", **QUICK, **more}, "t")
    bench = plant(0.05, testbed.effort_limit, testbed)
    return make_plan(section, bench, GAINS[kind])


def left(kind: str, plan: Any, error: float) -> float:
    """Return what a plan leaves on its model with another stiffness [m]."""
    model = read_testbed(plan.request["model"], "t").scaled(stiffness=1.0 + error)
    slew = slew_of(
        plan_settings({**plan.request, "model": None}, "t"), plant(0.05, model.effort_limit, model)
    )
    return predicted(plan, slew).tip_deflection


@pytest.mark.parametrize(
    ("kind", "lag", "delay"),
    representatives(
        [(kind, *path) for kind in GAINS for path in ((0.0, 0.0), (0.15, 2.3))],
        ("csa", 0.15, 2.3),
        ("hub_with_appendages", 0.0, 0.0),
    ),
)
def test_the_derivatives_of_a_flight_are_exact(kind: str, lag: float, delay: float) -> None:
    testbed = read_testbed({"kind": kind}, "t")
    limit = testbed.effort_limit
    values = {"method": "minimax_feedforward", **QUICK, "duration": 6.0, "pieces": 5}
    settings: Any = plan_settings(values, "t")
    bench = late(plant(0.1, limit, testbed), lag, delay)
    slew = slew_of(settings, bench, GAINS[kind], late_motors=True)
    motors = slew.motors(0.1)
    question = question_of(settings, slew)
    member = members_of(settings.ensemble, slew)[1].model
    nominal, m, motion = slew.model, slew.goal.size, question.motion
    grid = question.grid()
    rng = np.random.default_rng(0)
    weights = 0.3 * rng.standard_normal(grid.size) * np.tile(limit, 5)

    def flown(weights: Any) -> Any:
        first = motion.flight(nominal, grid.tick_efforts(weights), question.gains, None, motors)
        other = motion.flight(
            member, grid.tick_efforts(weights), question.gains, first.states, motors
        )
        return first, other

    first, other = flown(weights)
    every = range(1 + 3 * m)
    problem = PathProblem(motion, question.gains, motors, grid, every)
    about = affine_path(problem, nominal, first, None, weights)
    found = affine_path(problem, member, other, about, weights).path
    np.testing.assert_allclose(found.simulate(weights), channels(motion, member, other), atol=1e-12)
    for k in (0, 2 * m, grid.size - 1):
        step = 1e-3 * np.eye(grid.size)[k]
        (_, ahead), (_, behind) = flown(weights + step), flown(weights - step)
        slopes = (channels(motion, member, ahead) - channels(motion, member, behind)) / 2e-3
        for channel in every:
            np.testing.assert_allclose(found.slopes[channel][:, k], slopes[:, channel], atol=1e-7)
        end = (deviation(motion, member, ahead) - deviation(motion, member, behind)) / 2e-3
        np.testing.assert_allclose(found.end[0][:, k], end, atol=1e-8)


@pytest.mark.parametrize("seed", seeds(3))
def test_random_slews_keep_their_promise_on_members_and_between(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start, goal = rng.uniform(-0.6, 0.6, 2), rng.uniform(-0.6, 0.6, 2)
    plan = planned(
        initial=dict(zip(("base_yaw", "hub_pitch"), start.tolist(), strict=True)),
        goal=dict(zip(("base_yaw", "hub_pitch"), goal.tolist(), strict=True)),
        duration=float(rng.uniform(22.0, 30.0)),
        ensemble={"count": 7},
    )
    promised = plan.summary["worst_residual"]
    worst = max(left("csa", plan, error) for error in np.linspace(-0.2, 0.2, 13))
    assert 0.9 * promised < worst < 1.1 * promised
    assert np.abs(plan.effort).max() <= 150.0


def test_a_hub_with_appendages_keeps_its_promise_too() -> None:
    plan = planned("hub_with_appendages", duration=7.0, ensemble={"count": 5})
    promised = plan.summary["worst_residual"]
    worst = max(left("hub_with_appendages", plan, e) for e in np.linspace(-0.2, 0.2, 9))
    assert 0.9 * promised < worst < 1.1 * promised
    assert plan.summary["lower_bound"] is None


@pytest.mark.slow
def test_too_short_a_slew_of_a_hub_names_a_duration_that_all_members_can_do() -> None:
    section = {"pieces": 8, "max_steps": 8, "ensemble": {"draw": "corners"}}
    with pytest.raises(PlanFailed, match="no efforts were found that lead") as caught:
        planned("hub_with_appendages", duration=4.0, **section)
    found = re.search(r"a duration of ([\d.]+) s \(now 4 s\) is enough", str(caught.value))
    enough = float(present(found)[1])
    plan = planned("hub_with_appendages", duration=enough, **section)
    assert plan.duration == pytest.approx(enough, abs=0.05)  # a tick
    with pytest.raises(PlanFailed):
        planned("hub_with_appendages", duration=0.95 * enough, **section)


def test_the_step_is_the_best_one_near_it() -> None:
    """No small random change of the efforts that keeps end and limits leaves less."""
    plan = planned(duration=25.0)
    settings: Any = plan_settings(plan.request, "t")
    slew = slew_of(settings, plant(0.05), GAINS["csa"])
    question, members = question_of(settings, slew), members_of(settings.ensemble, slew)
    edges = [0, *(np.flatnonzero(np.diff(plan.effort, axis=0).any(axis=1)) + 1).tolist()]
    grid = question.grid()._replace(edges=(*edges, plan.ticks))
    problem = ensemble_problem(question, members, grid)
    weights = plan.effort[edges].ravel()
    best = problem.merit(weights)
    assert best.max_violation < 2e-3
    rng = np.random.default_rng(0)
    for size in (1e-3, 1e-2, 5e-2):
        for _ in range(3):
            other = weights + size * 150.0 * rng.standard_normal(weights.size)
            assert problem.merit(other).cost > 0.99 * best.cost


@pytest.mark.slow
def test_more_time_is_never_worse() -> None:
    """From 27.4 s on, twice what a rigid body takes, the same efforts are held at the goal."""
    model = {"modes": 3}
    plans = [planned(duration=duration, model=model) for duration in (25.0, 32.0, 57.3)]
    worst = [plan.summary["worst_residual"] for plan in plans]
    assert worst == sorted(worst, reverse=True)
    assert "then it rests at the goal" in plans[-1].summary["optimality"]
    for plan in plans[-2:]:
        flown = max(left("csa", plan, error) for error in (-0.2, -0.07, 0.0, 0.13, 0.2))
        assert flown <= 1.1 * plan.summary["worst_residual"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "more",
    representatives(
        [
            {"model": {"modes": 3}},
            {"model": {"modes": 2}, "pieces": 8},
            {
                "model": {"modes": 3},
                "pieces": 16,
                "max_steps": 5,
                "goal": {"base_yaw": -0.7, "hub_pitch": 0.4},
            },
        ],
        {"model": {"modes": 3}},
    ),
)
def test_a_little_more_time_is_never_worse(more: Any) -> None:
    """A search that ended unsettled left .154 m in 27 s and .080 m in 26 s; .2 % is its tolerance.

    That it settles is what makes it so: no rule orders two durations that are driven to their ends.
    """
    times = (23.0, 26.1, 27.0, 35.0)
    worst = [planned(duration=t, **more).summary["worst_residual"] for t in times]
    for shorter, longer in itertools.pairwise(worst):
        assert longer <= 1.002 * shorter


@pytest.mark.slow
def test_too_short_a_slew_says_how_long_one_takes() -> None:
    with pytest.raises(PlanFailed, match=r"miss by .* is enough; a rigid body takes 13\.72 s"):
        planned(duration=10.0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(4))
def test_a_mass_on_a_spring_that_varies_is_led_to_its_goal(seed: int) -> None:
    """It has no tip, and no motion that is free: the nominal one ends at rest, in 5 s and after."""
    rng = np.random.default_rng([30, seed])
    begin, gain = float(rng.uniform(-1.0, 1.0)), float(rng.uniform(0.0, 80.0) * (seed > 0))
    values = {"kind": "varying_oscillator", "parameters": {"load": 0.0}, "initial": {"mass": begin}}
    testbed = read_testbed(values, "t")
    section = {"method": "minimax_feedforward", "goal": {"mass": 0.0}, "duration": 5.0, **QUICK}
    gains = Feedback(kp=(gain,), kd=(gain,))
    plan = make_plan(plan_settings(section, "t"), plant(0.02, testbed.effort_limit, testbed), gains)
    assert plan.summary["predicted_residual_attitude_error"]["mass"] < 5e-4 * abs(begin)


@pytest.mark.slow
def test_a_duration_that_is_said_to_be_enough_was_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the limits allow may be more than a search of few steps finds."""
    monkeypatch.setattr(shortest, "least_duration", lambda question: 6.2)
    few = {"max_steps": 3, "pieces": 5, "ensemble": {"draw": "corners"}}
    with pytest.raises(PlanFailed) as caught:
        planned("hub_with_appendages", duration=4.0, **few)
    enough = float(present(re.search(r"a duration of ([\d.]+) s \(now 4", str(caught.value)))[1])
    assert enough > 6.2
    assert planned("hub_with_appendages", duration=enough, **few).duration == pytest.approx(enough)


@pytest.mark.slow
def test_where_no_steps_are_enough_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shortest, "least_duration", lambda question: 4.0)
    with pytest.raises(PlanFailed, match=r"allow a duration of 4 s .* max_steps: 1 are too few"):
        planned("hub_with_appendages", duration=3.0, max_steps=1, pieces=5)
