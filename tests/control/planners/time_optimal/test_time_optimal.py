from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.plants import plant
from tests.present import present
from tests.representatives import seeds

from flexslew_control.planners import make_plan
from flexslew_control.planners.time_optimal.bang_bang import BangBang
from flexslew_control.planners.time_optimal.linear.linear_time_optimal import linear_optimum
from flexslew_control.planners.time_optimal.optimal_switching import (
    extremal_durations,
    minimum_durations,
)
from flexslew_control.planners.time_optimal.pontryagin import switching_function
from flexslew_control.planners.time_optimal.structures import found_durations
from flexslew_control.planners.time_optimal.switching import continued_durations, linear_durations
from flexslew_control.planners.time_optimal.time_optimal import TimeOptimal
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.settings import validated
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.csa import CsaTestbed
from flexslew_plant.testbeds.hub_with_appendages import FOOT_POUND, HubTestbed
from flexslew_plant.testbeds.oscillators.floating_oscillator import FloatingOscillatorTestbed

OSCILLATOR = {"kind": "floating_oscillator"}
HUB = {"kind": "hub_with_appendages"}
CSA = {"kind": "csa", "modes": 1}
PUBLISHED = [
    (OSCILLATOR, "mass", 1.0, False, (1.00267843, 2.10893326, 3.21518808, 4.21786651)),
    (
        OSCILLATOR,
        "mass",
        1.0,
        True,
        (0.71239863, 1.65634513, 2.93297922, 4.20961331, 5.15355981, 5.86595844),
    ),
    (HUB, "hub", 2.0 * FOOT_POUND, False, (2.93665982, 3.00993354, 3.08320725, 6.01986708)),
    (
        HUB,
        "hub",
        2.0 * FOOT_POUND,
        True,
        (2.02038900, 2.29428977, 3.19079123, 4.08729269, 4.36119346, 6.38158246),
    ),
    (CSA, "base_yaw", 100.0, False, (7.110356, 9.595312, 12.080268, 19.190624)),
    (
        CSA,
        "base_yaw",
        100.0,
        True,
        (4.172536, 6.103632, 11.274883, 16.446134, 18.377230, 22.549766),
    ),
]


def planned(
    model: Any, joint: Any, amplitude: Any, robust: Any, goal: Any = 1.0, **more: Any
) -> Any:
    settings = validated(
        TimeOptimal,
        {"model": model, "goal": {joint: goal}, "amplitude": amplitude, "robust": robust, **more},
        "trial.yaml",
    )
    testbed = read_testbed(model, "trial.yaml")
    return make_plan(settings, plant(0.01, (150.0,) * len(testbed.effort_limit), testbed))


def slew(testbed: Any, amplitude: Any, robust: Any, distance: Any = 1.0) -> Any:
    model = testbed.model()
    return BangBang(model, 0, np.zeros(2 * model.coordinates), distance, amplitude, robust)


@pytest.mark.parametrize(("model", "joint", "amplitude", "robust", "times"), PUBLISHED)
def test_switch_times_are_the_published_ones(
    model: Any, joint: Any, amplitude: Any, robust: Any, times: Any
) -> None:
    plan = planned(model, joint, amplitude, robust)
    assert plan.summary["switch_times"] == pytest.approx(times[:-1], abs=1e-6)
    assert plan.duration == pytest.approx(times[-1], abs=1e-6)
    assert np.abs(plan.summary["terminal_error"]).max() < 1e-8


@pytest.mark.parametrize(
    ("robust", "factor", "amplitude"),
    [
        (False, 0.9, 0.138505),
        (True, 0.9, 0.0119410),
        (False, 1.1, 0.127333),
        (True, 1.1, 0.0106025),
    ],
)
def test_the_oscillator_keeps_the_published_residual(
    robust: Any, factor: Any, amplitude: Any
) -> None:
    of = slew(FloatingOscillatorTestbed(), 1.0, robust)
    x = of.final(continued_durations(of), factor)
    assert np.hypot(x[1], x[3] / np.sqrt(2.0 * factor)) == pytest.approx(amplitude, abs=6e-7)


def test_the_hub_needs_five_switches_for_two_radians_at_ten_foot_pounds() -> None:
    plan = planned(HUB, "hub", 10.0 * FOOT_POUND, False, goal=2.0)
    assert plan.summary["switches"] == 5
    assert plan.duration == pytest.approx(3.80453683, abs=1e-6)
    assert plan.summary["optimal"]


def test_five_switches_leave_the_published_sensitivity_of_the_hub_angle() -> None:
    plan = planned(HUB, "hub", 2.0 * FOOT_POUND, True)
    assert plan.summary["joint_sensitivity"] / 170.310339 == pytest.approx(-3.1e-7, abs=5e-9)


def test_the_robust_hub_slew_says_that_it_is_not_the_optimum() -> None:
    robust = planned(HUB, "hub", 2.0 * FOOT_POUND, True).summary
    assert not robust["optimal"]
    assert "best of the 5-switch family" in robust["optimality"]
    assert planned(HUB, "hub", 2.0 * FOOT_POUND, False).summary["optimal"]


def test_the_robust_hub_slew_is_better_over_the_published_range() -> Any:
    def residual(of: Any, durations: Any, factor: Any) -> Any:
        model = of.model.with_stiffness(factor)
        x = of.final(durations, factor)
        return np.hypot(x[1], x[3] / model.linearise(np.zeros(2)).frequencies[0])

    plain, robust = (slew(HubTestbed(), 2.0 * FOOT_POUND, r) for r in (False, True))
    arcs = [continued_durations(of) for of in (plain, robust)]
    for factor, better in ((0.882, False), (0.892, True), (1.243, True), (1.253, False)):
        pair = [residual(of, d, factor) for of, d in zip((plain, robust), arcs, strict=True)]
        assert (pair[1] < pair[0]) == better


def test_the_sensitivities_to_the_durations_are_exact() -> None:
    of = slew(HubTestbed(), 2.0 * FOOT_POUND, True)
    d, h = linear_durations(of), 1e-5
    for i, unit in enumerate(np.eye(d.size)):
        slope = (of.residual(d + h * unit) - of.residual(d - h * unit)) / (2 * h)
        assert of.residual_jacobian(d)[1][:, i] == pytest.approx(slope, abs=1e-5)


def test_pontryagins_condition_fails_on_arcs_that_are_not_extremal() -> None:
    of = slew(CsaTestbed(modes=1), 100.0, False)
    assert switching_function(of, present(continued_durations(of))).holds
    detour = np.array([6.0, 1.5, 1.5, 2.0, 2.0, 6.0])
    assert not switching_function(of, detour).holds


def test_the_reference_is_the_trajectory_and_the_effort_its_mean() -> None:
    plan = planned(CSA, "base_yaw", 100.0, False)
    model = CsaTestbed(modes=1).model()
    x = plan.state[0]
    for effort in plan.effort:
        x = model.advance(x, effort, 0.01)
    assert plan.effort[:, 0].sum() * 0.01 == pytest.approx(0.0, abs=1e-9)
    assert x == pytest.approx(plan.state[-1], abs=5e-4)
    assert plan.state[-1] == pytest.approx([1, 0, 0, 0, 0, 0], abs=1e-9)
    assert np.abs(plan.effort).max() <= 100.0 + 1e-9


PD = {"kp": [460.0, 460.0], "kd": [920.0, 920.0]}


def residual_tip(plan: Any, factor: Any, kp: Any, kd: Any) -> Any:
    """Return the largest tip deflection in 75 s after the end [m], under PD on base yaw."""
    model = CsaTestbed(modes=1).model().with_stiffness(factor)
    x, tips = plan.state[0], []
    for k in range(plan.ticks + 7500):
        r = plan.reference(k)
        feedback = kp * (r.position[0] - x[0]) + kd * (r.velocity[0] - x[3])
        x = model.advance(x, r.effort + np.array([feedback, 0.0]), 0.01, 1)
        if k >= plan.ticks:
            tips.append(abs(x[2]))
    return max(tips)


def test_a_robust_slew_that_counts_with_the_feedback_is_better_under_it() -> None:
    open_loop = planned(CSA, "base_yaw", 100.0, True)
    # the published warning: the feedback spoils what is insensitive without it
    assert residual_tip(open_loop, 1.1, 0.0, 0.0) == pytest.approx(0.250, abs=2e-3)
    assert residual_tip(open_loop, 1.1, 460.0, 920.0) == pytest.approx(0.535, abs=0.015)
    modes = planned(CSA, "base_yaw", 100.0, True, feedback=PD)
    whole = planned(CSA, "base_yaw", 100.0, True, feedback=PD, insensitive="state")
    left = [
        max(residual_tip(plan, factor, 460.0, 920.0) for factor in (0.9, 1.1))
        for plan in (open_loop, modes, whole)
    ]
    assert left[1] < 0.5 * left[0]
    assert left[2] < 0.2 * left[0]
    assert modes.duration < open_loop.duration < whole.duration
    assert modes.summary["optimal"] and whole.summary["optimal"]  # noqa: PT018
    assert abs(modes.summary["joint_sensitivity"]) > 0.1
    assert abs(whole.summary["joint_sensitivity"]) < 1e-9


def test_a_feedback_is_left_some_of_the_torque() -> None:
    plans = [
        planned(CSA, "base_yaw", None, False, **more)
        for more in ({}, {"feedback": PD}, {"feedback": PD, "reserve": 0.5})
    ]
    assert [plan.summary["amplitude"] for plan in plans] == [150.0, 120.0, 75.0]


def test_the_optimum_of_the_robust_hub_slew_has_fifteen_switches() -> None:
    of = slew(HubTestbed(), 2.0 * FOOT_POUND, True)
    arcs = present(extremal_durations(of))
    assert (arcs.size - 1, arcs.sum()) == (15, pytest.approx(6.319994, abs=1e-6))
    assert switching_function(of, arcs).holds
    with_hub = replace(of, insensitive="state")
    arcs = present(minimum_durations(with_hub, arcs))
    assert (arcs.size - 1, arcs.sum()) == (15, pytest.approx(6.328065, abs=1e-6))
    assert switching_function(with_hub, arcs).holds


def test_more_modes_need_more_switches_and_end_at_rest() -> None:
    three = planned({"kind": "csa", "modes": 3}, "base_yaw", 100.0, False)
    assert three.summary["switches"] == 7
    assert three.summary["optimal"]
    assert np.abs(three.summary["terminal_error"]).max() < 1e-9
    assert three.duration > 19.190624


def test_an_optimal_structure_is_the_closed_form_where_that_is_extremal() -> None:
    optimal = planned(OSCILLATOR, "mass", 1.0, True, structure="optimal")
    assert optimal.summary["switch_times"] == pytest.approx(PUBLISHED[1][4][:-1], abs=1e-6)


def test_a_slew_backwards_is_the_mirror_image() -> None:
    ahead, back = (planned(HUB, "hub", 2.0 * FOOT_POUND, False, goal=g) for g in (0.7, -0.7))
    assert back.summary["switch_times"] == pytest.approx(ahead.summary["switch_times"], abs=1e-9)
    assert back.position == pytest.approx(-ahead.position, abs=1e-9)


def test_what_cannot_be_done_is_said_in_one_line() -> None:
    with pytest.raises(BadInput, match="elbow is not a joint of the testbed; allowed: hub"):
        planned(HUB, "elbow", 2.0, False)
    with pytest.raises(BadInput, match="above the drive's limit"):
        planned(HUB, "hub", 200.0, False)
    with pytest.raises(BadInput, match=r"kd: .* give 1 or 2 numbers \(base_yaw, hub"):
        planned(CSA, "base_yaw", 100.0, True, feedback={"kp": [460.0], "kd": [920.0, 920.0, 1.0]})
    with pytest.raises(PlanFailed, match=r"takes 19\.1906 s .* N m are needed"):
        planned(CSA, "base_yaw", 100.0, False, longest=15.0)


@pytest.mark.parametrize(
    ("model", "joint", "amplitude", "goal", "duration"),
    [
        (OSCILLATOR, "mass", 1.0, 0.04, 3.567932),
        (OSCILLATOR, "mass", 1.0, 0.05, 3.695652),
        ({**CSA, "variant": "printed"}, "base_yaw", 100.0, 0.05, 14.024438),
        (HUB, "hub", 13.558, 1.0, 3.238377),
    ],
)
def test_the_fewest_switches_end_a_robust_slew_as_soon_as_they_can(
    model: Any, joint: Any, amplitude: Any, goal: Any, duration: Any
) -> None:
    plan = planned(model, joint, amplitude, True, goal=goal)
    assert plan.summary["switches"] == 5
    assert plan.duration == pytest.approx(duration, abs=1e-6)
    arcs = np.diff(np.array([0.0, *plan.summary["switch_times"], plan.duration]))
    assert arcs == pytest.approx(arcs[::-1], abs=1e-9)


def test_five_switches_that_are_not_antisymmetric_end_the_hub_slew_sooner() -> None:
    plan = planned(HUB, "hub", 13.558, True, structure="asymmetric")
    assert plan.summary["switches"] == 5
    assert plan.duration == pytest.approx(2.785863, abs=1e-6)
    assert np.abs(plan.summary["terminal_error"]).max() < 1e-8


@pytest.mark.parametrize(
    ("model", "joint", "amplitude", "goal", "switches"),
    [
        (OSCILLATOR, "mass", 1.0, 10.0, 7),
        (HUB, "hub", 13.558, 1.0, 7),
        (HUB, "hub", 2.0 * FOOT_POUND, 1.0, 15),
    ],
)
def test_a_plan_says_how_much_sooner_more_switches_would_end_it(
    model: Any, joint: Any, amplitude: Any, goal: Any, switches: Any
) -> None:
    few, optimal = (
        planned(model, joint, amplitude, True, goal=goal, structure=structure)
        for structure in ("fewest", "optimal")
    )
    assert optimal.summary["optimal"]
    assert optimal.summary["switches"] == switches
    assert few.summary["optimal_duration"] == pytest.approx(optimal.duration, abs=1e-8)
    less = few.duration - optimal.duration
    said = f"structure: optimal takes {less:.3g} s less with {switches} switches"
    assert few.summary["optimality"].endswith(said)


def test_a_damped_hub_gets_the_extremal_that_it_is_asked_for() -> None:
    damped = {**HUB, "damping_ratio": 0.01, "initial": {"hub": 1.1708}}
    goal, amplitude = 1.1708 + 2.4517, 1.30669 * FOOT_POUND
    plan = planned(damped, "hub", amplitude, False, goal=goal, structure="optimal")
    assert plan.summary["optimal"]
    assert plan.summary["switches"] == 5
    few = planned(damped, "hub", amplitude, False, goal=goal)
    assert few.duration > plan.duration
    assert few.summary["optimal_duration"] == pytest.approx(plan.duration, abs=1e-8)


@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("seed", seeds(4))
def test_no_slew_of_the_linear_model_is_faster_than_its_optimum(robust: Any, seed: Any) -> None:
    rng = np.random.default_rng(seed)
    testbed = FloatingOscillatorTestbed(damping_ratio=float(rng.uniform(0.0, 0.1)))
    of = slew(testbed, 10.0 ** rng.uniform(-1.0, 1.0), robust, 10.0 ** rng.uniform(-1.0, 1.0))
    optimum, few = linear_optimum(of), continued_durations(of, antisymmetric=False)
    assert optimum.duration <= present(few).sum() * (1.0 + 1e-9)
    arcs = extremal_durations(of)
    if arcs is not None:
        assert arcs.sum() == pytest.approx(optimum.duration, rel=1e-4)
        assert switching_function(of, arcs).holds


def test_where_no_three_switches_lead_to_the_goal_five_do() -> None:
    """The rigid slew to this goal hardly excites the mode: arcs of three switches would vanish."""
    testbed = HubTestbed()
    model = testbed.model()
    start = np.zeros(2 * model.coordinates)
    slew = BangBang(model, 0, start, 0.9512350346907495, 6.319002605058413, False)
    assert continued_durations(slew) is None
    durations = found_durations(slew)
    assert durations.size == 6
    assert np.abs(slew.residual(durations)).max() < 1e-7
    assert durations.sum() == pytest.approx(3.843763, abs=1e-6)
