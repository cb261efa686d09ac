"""What plans promise is what flies: on the identical model, at any period, for every planner."""

from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from tests.control.planners.residuals import residual_of
from tests.plants import plant
from tests.representatives import products

from flexslew_control.controllers import build_controller
from flexslew_control.law import ActiveLaw
from flexslew_control.planners import PLANNERS, make_plan, plan_settings
from flexslew_control.planners.slew import Feedback
from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.errors import PlanFailed
from flexslew_plant.testbeds.csa import CsaInitial, CsaTestbed, CsaVariant
from flexslew_plant.testbeds.oscillators.floating_oscillator import (
    FloatingOscillatorParameters,
    FloatingOscillatorTestbed,
)

GAINS = Feedback(kp=(460.0,), kd=(920.0,))
AT_REST: dict[
    str, Any
] = {  # the methods that promise rest at the goal, and how a campaign asks for them
    "optimized_feedforward": lambda rng: {"duration": float(rng.uniform(24.0, 32.0))},
    "input_shaping": lambda rng: {
        "duration": float(rng.uniform(16.0, 24.0)),
        "shaper": str(rng.choice(["zv", "zvd"])),
        "command": str(rng.choice(["quintic", "sin2", "cubic"])),
    },
    "start_coast_stop": lambda rng: {"amplitude": float(rng.uniform(40.0, 100.0))},
}
OTHERS: dict[str, Any] = {
    "none": {},
    "reference_only": {"duration": 25.0},
    "robust_feedforward": {"duration": 28.0},
    "minimax_feedforward": PLANNERS["minimax_feedforward"].example,
    "time_optimal": {"goal": {"base_yaw": 0.8}, "reserve": 0.2},
}


def flown(plan: Any, testbed: Any, period: Any) -> Any:
    duration = np.ceil(plan.end + 40.0)
    bench = Bench(BenchSettings(testbed=testbed, period=period, duration=duration))
    described = plant(period, testbed=testbed)
    pd = build_controller("pd_feedforward", "pd_feedforward", {}, described, "here")
    return residual_of(plan, bench, {"pd_feedforward": pd})


def asked(method: Any, testbed: Any, period: Any, **more: Any) -> Any:
    settings = plan_settings({"method": method, **more}, "test")
    return make_plan(settings, plant(period, testbed=testbed), GAINS)


def agree(plan: Any, residual: Any) -> None:
    promised = plan.summary["predicted_residual_tip_deflection"]
    joints = list(plan.summary["predicted_residual_attitude_error"].values())
    assert residual.tip == pytest.approx(promised, abs=1e-6)
    np.testing.assert_allclose(residual.joints, joints, atol=1e-7)


def test_every_planner_is_in_one_of_the_campaigns() -> None:
    assert {*AT_REST, *OTHERS} == {name for name, entry in PLANNERS.items() if entry.slews}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "variant", "period"),
    products(AT_REST, ["printed", "complete"], [0.01, 0.05, 0.001]),
)
def test_random_slews_leave_nothing_on_the_model_that_they_were_planned_on(
    method: Any, variant: CsaVariant, period: float
) -> None:
    rng = np.random.default_rng([len(method), len(variant), round(1000 * period)])
    done = 0
    while done < (1 if period < 0.01 else 3):
        start, end = rng.uniform(-0.8, 0.8, 2), rng.uniform(-0.8, 0.8, 2)
        initial = CsaInitial(base_yaw=start[0], hub_pitch=start[1])
        testbed = CsaTestbed(variant=variant, modes=1, initial=initial)
        goal = {"base_yaw": float(end[0]), "hub_pitch": float(end[1])}
        try:
            plan = asked(
                method, testbed, period, goal=goal, start=10 * period, **AT_REST[method](rng)
            )
        except PlanFailed:
            continue  # more torque than there is
        done += 1
        residual = flown(plan, testbed, period)
        assert residual.tip < 1e-5
        assert residual.joints.max() < 1e-5
        agree(plan, residual)


@pytest.mark.parametrize("method", OTHERS)
def test_what_is_left_on_purpose_is_predicted(method: Any) -> None:
    testbed = CsaTestbed(modes=1)
    plan = asked(method, testbed, 0.02, **OTHERS[method])
    agree(plan, flown(plan, testbed, 0.02))


def test_a_time_optimal_slew_ends_at_rest_with_efforts_held_over_its_switches() -> None:
    testbed = CsaTestbed(modes=1)
    plan = asked("time_optimal", testbed, 0.05, goal={"base_yaw": 0.8})
    assert plan.summary["predicted_residual_tip_deflection"] < 1e-9
    assert np.abs(plan.effort).max() <= 150.0 * (1.0 + 1e-12)


def test_the_reference_of_the_paper_leaves_what_its_page_says() -> None:
    """One-mode M1: 7e-11 promised by the continuous loop, 3.2e-3 and 3.7 mm flown."""
    testbed = CsaTestbed(modes=1, variant="printed")
    more = {"goal": {"base_yaw": 1.0, "hub_pitch": 0.5}, "track": "reference"}
    plan = asked("optimized_feedforward", testbed, 0.01, **more)
    assert plan.summary["norm_terminal_error"] < 1e-9
    residual = flown(plan, testbed, 0.01)
    agree(plan, residual)
    assert residual.tip == pytest.approx(3.6e-3, abs=2e-4)


def test_a_law_without_the_planned_gains_can_follow_the_planned_trajectory() -> None:
    testbed = CsaTestbed(modes=1)
    plan = asked("optimized_feedforward", testbed, 0.01)
    bench = Bench(BenchSettings(testbed=testbed, duration=60.0, active="lqr"))
    law = build_controller("lqr", "lqr", {}, plant(testbed=testbed), "here")
    assert residual_of(plan, bench, {"lqr": law}).tip < 1e-4


SLOW = FloatingOscillatorTestbed(
    parameters=FloatingOscillatorParameters(stiffness=1e-4), effort_limit=(0.01,)
)  # a period of 444 s, under feedback of up to 900 s


def left_at_last(plan: Any, kp: float, kd: float, stiffness: float) -> tuple[float, float]:
    """Return largest stretch and error of the joint in an hour after a plan, in SciPy."""
    k, h, n = 1e-4 * stiffness, plan.period, plan.ticks
    inner = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-k, k, 0, 0], [k, -k, 0, 0], [0] * 4])
    whole = expm(h * np.hstack((inner, np.array([[0, 0, 1, 0, 0]]).T)))
    x, tip, away = np.zeros(4), 0.0, 0.0
    for tick in range(n + round(3600.0 / h)):
        r = plan.reference(tick)
        demand = r.effort[0] + kp * (r.position[0] - x[0]) + kd * (r.velocity[0] - x[2])
        x = whole[:4, :4] @ x + whole[:4, 4] * np.clip(demand, -0.01, 0.01)
        if tick + 1 >= n:
            tip, away = max(tip, abs(x[1] - x[0])), max(away, abs(x[0] - plan.position[-1, 0]))
    return tip, away


@pytest.mark.parametrize(
    ("section", "law"),
    [
        ({"method": "minimax_feedforward", "duration": 100.0}, None),
        ({"method": "minimax_feedforward", "duration": 100.0, "feedback": "none"}, None),
        ({"method": "reference_only", "duration": 100.0}, None),
        ({"method": "reference_only", "duration": 100.0}, "collocated_pid"),
    ],
)
def test_what_a_slow_plant_leaves_is_looked_for_until_it_has_shown(section: Any, law: Any) -> None:
    kp, kd = (0.0, 0.0) if section.get("feedback") else (1e-4, 1e-2)
    gains = {"kp": [kp], "kd": [kd]}
    bench = plant(0.5, (0.01,), SLOW)
    settings = plan_settings({**section, "goal": {"mass": 1.0}, "feedback": gains}, "t")
    flies = ActiveLaw(law, {**gains, "ki": [0.0]}) if law else None
    plan = make_plan(settings, bench, law=flies)
    tip, away = left_at_last(plan, kp, kd, 1.0)
    assert plan.summary["predicted_residual_tip_deflection"] == pytest.approx(tip, rel=1e-3)
    told = plan.summary["predicted_residual_attitude_error"]["mass"]
    assert told == pytest.approx(away, rel=1e-3)
    if "worst_residual" in plan.summary:
        worst = max(left_at_last(plan, kp, kd, 1.0 + error)[0] for error in (-0.2, 0.2))
        assert plan.summary["worst_residual"] == pytest.approx(max(worst, tip), rel=2e-3)
