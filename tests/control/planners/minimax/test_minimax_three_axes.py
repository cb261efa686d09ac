"""A flexible craft turned in three axes by all drives: promises kept, exact ends, refusals."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.control.planners.time_optimal.three_axes.test_three_axes_flexible import with_booms
from tests.plants import AXES
from tests.present import present
from tests.representatives import seeds

from flexslew_control.law import ActiveLaw, PlantDescription
from flexslew_control.plan import Plan
from flexslew_control.planners import make_plan, plan_settings
from flexslew_control.planners.minimax.members import members_of
from flexslew_control.planners.minimax.minimax_feedforward import question_of
from flexslew_control.planners.minimax.nonlinear_path import (
    PathProblem,
    affine_path,
    channels,
    deviation,
)
from flexslew_control.planners.minimax.question import Question
from flexslew_control.planners.minimax.search import smooth
from flexslew_control.planners.minimax.successive import EnsembleProblem, ensemble_problem
from flexslew_control.planners.minimax.turning_motion import platform_of
from flexslew_control.planners.residual.whole_bench import ignored_settings, simulate_on_bench
from flexslew_control.planners.slew import Feedback, slew_of
from flexslew_plant.errors import BadInput, PlanFailed

LIMIT, PERIOD = 1.5, 0.1
GAINS = Feedback(kp=(20.0,), kd=(60.0,))
LAW = ActiveLaw("pd_feedforward", {"kp": [20.0], "kd": [60.0]})
QUICK = {
    "method": "minimax_feedforward",
    "drives": "all",
    "pieces": 10,
    "max_steps": 5,
    "ensemble": {"count": 3},
}


def bench_with(**more: Any) -> PlantDescription:
    """Return a bench with a craft with booms."""
    return PlantDescription(with_booms(**more), PERIOD, np.full(3, LIMIT))


@lru_cache
def bench() -> PlantDescription:
    return bench_with()


def planned(goal: Any, duration: float, **more: Any) -> Plan:
    section = plan_settings({**QUICK, "goal": goal, "duration": duration, **more}, "here")
    return make_plan(section, bench(), GAINS, law=LAW)


def question(goal: Any, duration: float, **more: Any) -> Question:
    values = {**QUICK, "goal": goal, "duration": duration, **more}
    settings: Any = plan_settings(values, "here")
    return question_of(settings, slew_of(settings, bench(), GAINS))


def flown_members(asked: Question) -> EnsembleProblem:
    """Return all members as they are flown, on the ticks of the bench."""
    return ensemble_problem(asked, members_of(asked.ensemble, asked.slew), asked.grid())


def turn(rng: np.random.Generator) -> tuple[dict[str, float], dict[str, Any], float]:
    """Return a random turn by joint and as an attitude, and 1.2 times what a rigid craft takes."""
    axis, angle = rng.standard_normal(3), float(rng.uniform(0.2, 0.5))
    by_joint = dict(zip(AXES, (angle * axis / np.linalg.norm(axis)).tolist(), strict=True))
    rigid = question(by_joint, 1.0).rigid
    return by_joint, {"axis": axis.tolist(), "angle": angle}, 1.2 * rigid


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(2))
def test_random_turns_keep_their_promise_on_members_and_between(seed: int) -> None:
    """Flown by the law's own controller on the bench; 1e-5 m is what counts as none."""
    by_joint, goal, duration = turn(np.random.default_rng([33, seed]))
    plan = planned(goal, duration)
    promised = plan.summary["worst_residual"]
    found = []
    for error in (-0.2, -0.1, 0.0, 0.03, 0.1, 0.2):
        other = replace(bench(), testbed=bench().testbed.scaled(stiffness=1.0 + error))
        found.append(present(simulate_on_bench(plan, other, LAW)))
    worst = max(one.tip_deflection for one in found)
    assert worst < 1.1 * promised + 1e-5
    assert abs(found[2].tip_deflection - plan.summary["predicted_residual_tip_deflection"]) < 1e-9
    asked = question(by_joint, duration)
    rigid = flown_members(asked).merit(smooth(asked, asked.grid())).residuals.max()
    assert promised < 0.2 * rigid
    assert np.abs(plan.effort).max() <= LIMIT


def test_the_nominal_craft_ends_at_rest_at_the_goal() -> None:
    goal = {"to": [0.3, -0.2, 0.9]}
    plan = planned(goal, 8.0, exact_nominal=True, ensemble={"vary": {}})
    model = bench().testbed.model()
    x = np.concatenate((model.rest({}), np.zeros(model.coordinates)))
    position, rate = model.joint_state(model.path(x, plan.effort, PERIOD)[-1])
    assert np.abs(model.joint_error(position, plan.position[-1])).max() < 1e-5
    assert np.abs(rate).max() < 1e-5
    assert plan.summary["predicted_residual_tip_deflection"] < 1e-5


def derivatives_and_flights(
    asked: Question, member: Any, limited: range
) -> tuple[Any, Callable[[int, float], tuple[Any, Any]]]:
    """Return a member's path under random weights, with the derivatives of these channels.

    Also what flies it with one weight so much larger, and smaller.
    """
    motion, slew, gains, grid = asked.motion, asked.slew, asked.gains, asked.grid()
    motors = slew.motors(PERIOD)
    weights = 0.5 * LIMIT * np.random.default_rng(0).standard_normal(grid.size)

    def flown(weights: Any) -> Any:
        first = motion.flight(slew.model, grid.tick_efforts(weights), gains, None, motors)
        return first, motion.flight(member, grid.tick_efforts(weights), gains, first.states, motors)

    def beside(k: int, by: float) -> tuple[Any, Any]:
        step = by * np.eye(grid.size)[k]
        return flown(weights + step)[1], flown(weights - step)[1]

    first, other = flown(weights)
    problem = PathProblem(motion, gains, motors, grid, limited)
    about = affine_path(problem, slew.model, first, None, weights)
    return affine_path(problem, member, other, about, weights).path, beside


def test_the_derivatives_of_a_turn_are_those_of_its_flight() -> None:
    asked = question({"roll": 1.3, "pitch": 0.5, "yaw": -1.0}, 12.0, pieces=8)
    motion, member = asked.motion, members_of(asked.ensemble, asked.slew)[1].model
    tips = len(member.appendages.names)
    limited = range(tips, tips + 3)
    found, beside = derivatives_and_flights(asked, member, limited)
    for k in (0, 10, asked.grid().size - 1):
        ahead, behind = beside(k, 1e-3)
        by = (channels(motion, member, ahead) - channels(motion, member, behind)) / 2e-3
        for channel in limited:
            np.testing.assert_allclose(found.slopes[channel][:, k], by[:, channel], atol=1e-6)
        end = (deviation(motion, member, ahead) - deviation(motion, member, behind)) / 2e-3
        np.testing.assert_allclose(found.end[0][:, k], end, atol=1e-6)


@pytest.mark.parametrize("angle", [0.0, 1e-7, 1e-3, 0.4, 3.0])
def test_the_slopes_of_the_rotation_are_those_of_its_differences(angle: float) -> None:
    """About any axis, either sign of the quaternions, and not quite normalised."""
    rng = np.random.default_rng([34, int(1e3 * angle)])
    motion = question({"roll": 0.3}, 12.0).motion
    gains = rng.standard_normal((3, 6))
    size = bench().testbed.model().positions + bench().testbed.model().coordinates
    states, path = rng.standard_normal((2, 6, size))
    at, rate = platform_of(bench().testbed)
    turns = rng.standard_normal((6, 3))
    turns *= angle / np.linalg.norm(turns, axis=1)[:, None]
    path[:, at] = Rotation.random(6, random_state=3).as_quat()
    measured = (Rotation.from_quat(path[:, at]) * Rotation.from_rotvec(-turns)).as_quat()
    signs = rng.choice([-1.0, 1.0], (6, 1))
    states[:, at] = signs * measured * (1.0 + 1e-3 * rng.standard_normal((6, 1)))
    own, nominal = motion.feedback_derivatives(gains, states, path)

    def fed_back(x: Any, r: Any) -> Any:
        between = Rotation.from_quat(x[:, at]).inv() * Rotation.from_quat(r[:, at])
        return np.hstack((between.as_rotvec(), r[:, rate] - x[:, rate])) @ gains.T

    by, step = rng.standard_normal((6, size)), 1e-5
    for found, ahead, behind in (
        (own, fed_back(states + step * by, path), fed_back(states - step * by, path)),
        (nominal, fed_back(states, path + step * by), fed_back(states, path - step * by)),
    ):
        expected = (ahead - behind) / (2.0 * step)
        np.testing.assert_allclose(np.einsum("kjs,ks->kj", found, by), expected, atol=1e-8)


@pytest.mark.slow
def test_too_short_a_turn_names_a_duration_that_can_be_planned() -> None:
    goal = {"roll": 0.1, "pitch": 0.3, "yaw": 0.05}
    more = {"pieces": 8, "max_steps": 5, "ensemble": {"vary": {}}}
    rigid = question(goal, 1.0).rigid
    with pytest.raises(PlanFailed, match="no efforts were found that lead") as caught:
        planned(goal, 0.9 * rigid, **more)
    named = re.search(r"a duration of ([\d.]+) s", str(caught.value))
    enough = float(present(named)[1])
    assert rigid < enough < 1.2 * rigid
    assert planned(goal, enough, **more).duration == pytest.approx(enough, abs=PERIOD)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"joint_range": {"roll": [-1.0, 1.0]}}, "a turn by all drives has no range"),
        ({"goal": {"roll": 0.0}}, "the craft is there already"),
    ],
)
def test_what_makes_no_sense_in_three_axes_is_refused(more: Any, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        planned(**{"goal": {"roll": 0.5}, "duration": 12.0, **more})


@pytest.mark.parametrize(
    ("law", "settings", "words"),
    [
        ("pd_feedforward", {"kp": [20.0], "kd": [60.0], "gyroscopic": False}, ""),
        (
            "pd_feedforward",
            {"kp": [20.0], "gyroscopic": True, "attitude": {}},
            "pd_feedforward without attitude, gyroscopic",
        ),
        (
            "collocated_pid",
            {"ki": [1.0]},
            "kp and kd of the joints alone instead of collocated_pid",
        ),
        ("lqr", {}, "kp and kd of the joints alone instead of lqr"),
    ],
)
def test_what_a_law_does_beyond_the_gains_that_a_plan_counts_with_is_named(
    law: str, settings: dict[str, Any], words: str
) -> None:
    assert ignored_settings(ActiveLaw(law, settings)) == words


@pytest.mark.slow
def test_an_attitude_is_turned_to_about_the_eigenaxis_by_default() -> None:
    plan = planned(
        {"euler": [0.3, 0.2, 0.1], "order": "zyx"}, 12.0, drives="moving", ensemble={"vary": {}}
    )
    assert plan.summary["predicted_residual_tip_deflection"] < 1e-4
    assert "eigenaxis" in plan.summary["believes"]
