"""The floating oscillator, whose optima were computed independently."""

import itertools
import json
import re
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from tests.plants import plant
from tests.present import present
from tests.representatives import representatives

from flexslew_control.planners import make_plan, plan_settings
from flexslew_control.planners.minimax.linear_path import is_linear
from flexslew_control.planners.minimax.members import members_of
from flexslew_control.planners.minimax.minimax_feedforward import MinimaxFeedforward, question_of
from flexslew_control.planners.minimax.question import convex_program
from flexslew_control.planners.minimax.rounds import solved
from flexslew_control.planners.residual.prediction import predicted
from flexslew_control.planners.slew import slew_of
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.testbeds import WITH_EQUATIONS, read_testbed
from flexslew_plant.testbeds.oscillators.floating_oscillator import FloatingOscillatorTestbed

OPEN = {"kp": [0.0], "kd": [0.0]}
PD = {"kp": [0.5], "kd": [1.0]}


def plan(period: float = 0.01, testbed: Any = None, **more: Any) -> Any:
    return made(json.dumps({"goal": {"mass": 1.0}, "feedback": OPEN, **more}), period, testbed)


@lru_cache
def made(section: Any, period: Any, testbed: Any) -> Any:
    values = {"method": "minimax_feedforward", **json.loads(section)}
    bench = plant(period, (1.0,), testbed or FloatingOscillatorTestbed())
    return make_plan(plan_settings(values, "trial.yaml"), bench)


def left(flown: Any, error: float) -> float:
    """Return what a plan leaves on a plant whose stiffness has an error [m]."""
    values = {**flown.request, "model": {"parameters": {"stiffness": 1.0 + error}}}
    slew = slew_of(plan_settings(values, "t"), plant(flown.period, (1.0,), oscillator()))
    return predicted(flown, slew).tip_deflection


def oscillator() -> FloatingOscillatorTestbed:
    return FloatingOscillatorTestbed()


@pytest.mark.parametrize(
    ("duration", "feedback", "exact"), [(5.866, OPEN, True), (10.0, OPEN, False), (7.0, PD, True)]
)
def test_the_bound_is_as_near_as_the_optimum_is_exact(
    duration: float, feedback: Any, exact: bool
) -> None:
    """What the optimum is: `reproduce optimum`, test_independent."""
    found = plan(duration=duration, feedback=feedback, exact_nominal=exact).summary
    assert found["lower_bound"] <= found["worst_residual"] < 1.002 * found["lower_bound"]


@pytest.mark.parametrize("feedback", [OPEN, PD])
def test_what_is_promised_is_flown_on_members_and_between_them(feedback: Any) -> None:
    flown = plan(duration=8.0, feedback=feedback)
    promised = flown.summary["worst_residual"]
    errors = np.linspace(-0.2, 0.2, 23)
    worst = max(left(flown, error) for error in errors)
    assert 0.9 * promised < worst < 1.1 * promised
    for member in flown.summary["members"]:
        by_tick = left(flown, member["errors"]["stiffness"])
        assert by_tick <= 1.001 * member["residual"] + 1e-9
        assert by_tick > 0.99 * member["residual"] - 1e-9


@pytest.mark.parametrize("seed", representatives([0, 3, 5, 8], 3))
def test_random_ensembles_keep_their_promise_between_their_levels(seed: int) -> None:
    """Few levels: members between them join where they are left with more (seeds 0, 3, 8)."""
    rng = np.random.default_rng([30, seed])
    low, high = float(-rng.uniform(0.1, 0.3)), float(rng.uniform(0.1, 0.3))
    ensemble = {"vary": {"stiffness": [low, high]}, "count": int(rng.integers(5, 9))}
    duration = round(float(rng.uniform(6.0, 11.0)), 2)
    flown = plan(duration=duration, feedback=(OPEN, PD)[seed % 2], ensemble=ensemble)
    worst = max(left(flown, error) for error in rng.uniform(low, high, 25))
    assert worst < 1.1 * flown.summary["worst_residual"]


@pytest.mark.slow
@pytest.mark.parametrize("feedback", representatives([OPEN, PD], OPEN))
def test_more_time_is_never_worse(feedback: Any) -> None:
    """The solver's tolerance is 0.1 %, and what rounding leaves 1e-8 m."""
    rng = np.random.default_rng(30)
    times = np.sort(np.append(rng.uniform(4.0, 60.0, 4), 10.0)).round(2).tolist()
    worst = [plan(duration=t, feedback=feedback).summary["worst_residual"] for t in times]
    for shorter, longer in itertools.pairwise(worst):
        assert longer <= 1.001 * shorter + 1e-8
    assert worst[-1] < 1e-6 < worst[0]


def test_a_slew_far_below_what_can_be_seen_is_a_smooth_turn() -> None:
    found = plan(duration=8.0, goal={"mass": 1e-9}, feedback=PD)
    assert found.summary["iterations"] == 0
    assert max(left(found, error) for error in (-0.2, 0.0, 0.2)) < 1e-9
    assert found.position[-1] == pytest.approx(1e-9, rel=1e-12)


@pytest.mark.slow
def test_no_shorter_slew_meets_the_bound_of_the_shortest() -> None:
    shortest = plan(residual_bound=0.0507, duration=9.0, exact_nominal=True)
    assert shortest.summary["worst_residual"] <= 0.0507
    shorter = plan(duration=shortest.duration - 0.02, exact_nominal=True).summary
    assert shorter["lower_bound"] > 0.0507


def test_every_limit_is_kept_by_every_member_at_every_tick() -> None:
    limits = {
        "joint_range": {"mass": [-0.02, 1.03]},
        "rate_limit": {"mass": 0.25},
        "tip_limit": 0.3,
        "reserve": 0.1,
    }
    section: dict[str, Any] = {"duration": 12.0, "feedback": PD, **limits}
    bound, free = plan(**section), plan(duration=12.0, feedback=PD)
    assert free.summary["worst_residual"] < bound.summary["worst_residual"] < 1e-3
    settings = plan_settings({**bound.request, **section}, "t")
    assert isinstance(settings, MinimaxFeedforward)
    slew = slew_of(settings, plant(0.01, (1.0,), oscillator()))
    for member in members_of(settings.ensemble, slew):
        model, x, ticks = member.model, np.zeros(4), []
        for k in range(bound.ticks):
            r = bound.reference(k)
            effort = r.effort + 0.5 * (r.position - x[:1]) + 1.0 * (r.velocity - x[2:3])
            ticks.append([*np.abs(effort), x[0], abs(x[2]), abs(x[1])])
            x = model.advance(x, effort, 0.01)
        effort_peak, high, rate, tip = np.max(ticks, axis=0)
        assert effort_peak <= 0.9 * (1.0 + 1e-5)
        assert np.min(ticks, axis=0)[1] >= -0.02 - 1e-5
        assert high <= 1.03 + 1e-5
        assert rate <= 0.25 * (1.0 + 1e-4)
        assert tip <= 0.3 * (1.0 + 1e-4)


def test_effort_has_its_price() -> None:
    dear, cheap = plan(duration=10.0, rho=1e-2), plan(duration=10.0)
    assert np.sum(dear.effort**2) < 0.8 * np.sum(cheap.effort**2)
    assert dear.summary["worst_residual"] > cheap.summary["worst_residual"]


@pytest.mark.parametrize(
    ("ensemble", "members"),
    [
        ({"vary": {}}, 1),
        ({"draw": "corners"}, 3),
        ({"vary": {"parameters.free_mass": [-0.1, 0.1], "stiffness": [-0.1, 0.1]}, "count": 3}, 9),
        ({"vary": {"testbed.parameters.free_mass": [-0.1, 0.1]}, "draw": "corners"}, 3),
        ({"draw": "sampled", "count": 6}, 7),
    ],
)
def test_members_are_drawn_from_any_keys(ensemble: Any, members: int) -> None:
    found = plan(duration=10.0, ensemble=ensemble, pieces=20).summary
    assert len(found["members"]) >= members  # those between that are left with more join them
    assert not any(found["members"][0]["errors"].values())


def test_the_answer_of_a_linear_member_is_affine_and_that_of_its_flight() -> None:
    values = {"method": "minimax_feedforward", "duration": 3.1, "feedback": PD, "pieces": 7}
    settings: Any = plan_settings({**values, "goal": {"mass": 1.0}}, "t")
    slew = slew_of(settings, plant(0.05, (1.0,), oscillator()))
    question = question_of(settings, slew)
    members = members_of(settings.ensemble, slew)
    program = convex_program(question, members)
    weights = np.random.default_rng(0).standard_normal(program.grid.size)
    efforts, nominal = program.grid.tick_efforts(weights), [np.zeros(4)]
    for u in efforts:
        nominal.append(slew.model.advance(nominal[-1], u, 0.05))
    for member, response in zip(members[:3], program.responses, strict=False):
        x, rows = np.zeros(4), []
        for k in range(len(efforts) + 30):
            y, over = nominal[k] if k < len(efforts) else np.array([1.0, 0.0, 0.0, 0.0]), k >= 62
            u = (0.0 if over else efforts[k]) + 0.5 * (y[:1] - x[:1]) + 1.0 * (y[2:3] - x[2:3])
            rows.append([x[1], u[0], x[0], x[2]])
            x = member.model.advance(x, u, 0.05)
        flown = response.simulate(weights)[: len(rows)]
        np.testing.assert_allclose(flown, rows, atol=1e-11)
        for channel in range(4):
            slopes, offsets = response.rows([0, 8, 9, 61, 62, 70], channel)
            expected = flown[[0, 8, 9, 61, 62, 70], channel]
            np.testing.assert_allclose(slopes @ weights + offsets, expected, atol=1e-11)


def test_the_bound_is_one() -> None:
    """No random change of the optimal efforts that keeps the end leaves less than the bound."""
    settings: Any = plan_settings(plan(duration=5.0, pieces=12).request, "t")
    slew = slew_of(settings, plant(0.01, (1.0,), oscillator()))
    program = convex_program(question_of(settings, slew), members_of(settings.ensemble, slew))
    best = solved(program)
    rows = program.end_rows @ program.responses[0].path.end[0]
    free = np.linalg.svd(rows)[2][len(rows) :]
    rng = np.random.default_rng(1)
    for size in (1e-3, 1e-2, 0.1):
        change = size * rng.standard_normal(len(free)) @ free
        other = np.clip(best.weights + change, -1.0, 1.0)
        amplitudes = [
            np.hypot(*(r.rest.modes @ (r.path.end[0] @ other + r.path.end[1])))
            * r.rest.tip_of_modes
            for r in program.responses
        ]
        assert np.max(amplitudes) > best.bound


def test_which_plants_are_linear() -> None:
    found = {name: is_linear(read_testbed({"kind": name}, "t").model()) for name in WITH_EQUATIONS}
    assert found["floating_oscillator"]
    assert not any(found[n] for n in ("csa", "hub_with_appendages", "varying_oscillator"))


def test_too_short_a_slew_names_the_shortest_that_is_feasible() -> None:
    with pytest.raises(PlanFailed, match="no efforts within the limits lead") as caught:
        plan(duration=2.0)
    enough = float(
        present(re.search(r"a duration of ([\d.]+) s \(now 2 s\)", str(caught.value)))[1]
    )
    assert 2.828 < enough < 2.86  # a rigid body of 2 kg: 2 sqrt(2) s
    assert plan(duration=enough).duration == enough


@pytest.mark.slow
def test_too_low_a_bound_names_the_shortest_slew_that_meets_it_or_what_can_be_met() -> None:
    with pytest.raises(PlanFailed, match=r"no slew of 5 s leaves 0\.001 m") as caught:
        plan(duration=5.0, residual_bound=0.001)
    found = re.search(r"; the shortest that does takes ([\d.]+) s", str(caught.value))
    least = float(present(found)[1])
    assert plan(duration=least).summary["worst_residual"] <= 1e-3
    assert plan(duration=0.995 * least).summary["worst_residual"] > 1e-3
    with pytest.raises(PlanFailed, match=r", nor one of 10\.12 s, which leaves") as caught:
        plan(duration=3.0, residual_bound=1e-9)
    left = float(present(re.search(r"leaves (\S+) m at least", str(caught.value)))[1])
    assert plan(duration=10.12).summary["worst_residual"] <= left


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"ensemble": {"vary": {"stiffness": [0.1, 0.2]}}}, "about 0"),
        ({"ensemble": {"vary": {"parameters.colour": [-0.1, 0.1]}}}, "no number of the testbed"),
        ({"ensemble": {"vary": {"payload": [-0.1, 0.1]}}}, "payload"),
        ({"ensemble": {"draw": "all"}}, "draw"),
        ({"joint_range": {"hub": [0.0, 1.0]}}, "joint_range: hub is not a joint"),
        ({"joint_range": {"mass": [0.1, 1.0]}}, "must lie inside"),
        ({"rate_limit": {"hub": 1.0}}, "rate_limit: hub is not a joint"),
        ({"tip_limit": 0.0}, "tip_limit"),
        ({"pieces": 1}, "pieces"),
    ],
)
def test_bad_input_is_refused_in_one_line(wrong: Any, words: str) -> None:
    with pytest.raises(BadInput, match=words) as caught:
        plan(duration=6.0, **wrong)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("gains", "vary", "words"),
    [
        ((460.0, 920.0), {"stiffness": (-0.2, 0.2)}, "is not stable on this testbed"),
        ((1.0, 40.0), {"parameters.driven_mass": (-0.9, 0.2)}, "driven_mass': -0.9} .* diverges"),
    ],
)
def test_feedback_that_holds_not_every_member_is_refused(gains: Any, vary: Any, words: str) -> None:
    feedback = {"kp": [gains[0]], "kd": [gains[1]]}
    with pytest.raises(PlanFailed, match=words):
        plan(0.02, duration=15.0, feedback=feedback, ensemble={"vary": vary, "draw": "corners"})
