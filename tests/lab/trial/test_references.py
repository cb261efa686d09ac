"""What every planner's reference is, over random goals, durations and testbeds."""

from contextlib import suppress
from typing import Any
from zlib import crc32

import numpy as np
import pytest
from tests.representatives import products, representatives

import flexslew as fs
from flexslew_control.planners import PLANNERS
from flexslew_plant.errors import PlanFailed

TESTBEDS = {  # the trial that has it: shortest and longest duration that is asked for [s]
    "m1": (25.0, 45.0),
    "replan_oscillator": (12.0, 20.0),
    "time_optimal_hub": (15.0, 30.0),
    "own_spacecraft": (30.0, 60.0),
    "antenna_4": (20.0, 40.0),
}
SLEWS = [name for name, entry in PLANNERS.items() if entry.slews and name != "none"]
QUICK: dict[str, dict[str, Any]] = {
    "minimax_feedforward": {"ensemble": {"vary": {}}},
    "start_coast_stop": {"amplitude": 0.3},
}
CLOSE = 3e-6  # what the solvers leave: minimax_feedforward up to 2e-6 [rad or m, and per second]


@pytest.mark.parametrize(("bench", "method"), products(TESTBEDS, SLEWS))
def test_it_goes_from_start_to_goal_and_rests_there_without_a_step(bench: str, method: str) -> None:
    rng = np.random.default_rng(crc32(f"{bench} {method}".encode()))
    trial = fs.trial(bench, {"schedule": [], "plan": {"method": "none"}})
    joints, typical = trial.testbed.model().joint_names, trial.testbed.typical_goal
    for _ in range(3):  # the first that the drives can do
        goal = {name: float(rng.uniform(-0.8, 0.8)) * typical[name] for name in typical}
        section = {"method": method, "goal": goal, **QUICK.get(method, {})}
        if PLANNERS[method].takes_duration:
            section["duration"] = float(rng.uniform(*TESTBEDS[bench]))
        with suppress(PlanFailed):
            plan = fs.plan(fs.trial(trial, {"plan": section}))
            break
    else:
        pytest.fail("none of three slews has a plan")
    assert not plan.position[0].any()
    assert not plan.velocity[0].any()
    last = [goal.get(name, 0.0) for name in joints]
    np.testing.assert_allclose(plan.position[-1], last, atol=CLOSE)
    fastest = max(1.0, float(np.abs(plan.velocity).max()))
    np.testing.assert_allclose(plan.velocity[-1], 0.0, atol=CLOSE * fastest)
    assert step(plan) < CLOSE


def step(plan: Any) -> float:
    """Return how far the reference goes in a tick beyond what its rates explain [rad or m].

    With rates v, w at its ends and accelerations up to a, of which the neighbouring ticks tell, a
    tick of h leads h (v + w) / 2 on, and a h^2 / 4 at most beside that.
    """
    h, v = plan.period, plan.velocity
    gap = np.abs(np.diff(plan.position, axis=0) - 0.5 * h * (v[1:] + v[:-1]))
    change = np.abs(np.diff(v, axis=0))
    near = np.pad(change, ((1, 1), (0, 0)))
    most = np.maximum(change, np.maximum(near[:-2], near[2:]))
    return float((gap - 0.25 * h * most).max())


@pytest.mark.slow
@pytest.mark.parametrize(
    "method",
    representatives(["robust_feedforward", "optimized_feedforward"], "optimized_feedforward"),
)
def test_a_nominal_flight_that_misses_the_goal_is_told_by_the_same_efforts(
    method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    keys: dict[str, Any] = {"method": method, "goal": {"base_yaw": 0.6, "hub_pitch": 0.12}}
    if method == "optimized_feedforward":
        keys |= {"reading": "regularised", "rho": 1e-6}
    trial = fs.trial("m1", {"plan": keys, "duration": 60.0})
    bent, flown = fs.plan(trial), fs.fly(trial)
    with monkeypatch.context() as patched:
        for module in ("feedforward.robust_feedforward", "slewing"):
            patched.setattr(
                f"flexslew_control.planners.{module}.joints_at_rest", lambda plan, *_: plan
            )
        plain, before = fs.plan(trial), fs.fly(trial)
    assert step(plain) > 1e-3
    assert step(bent) < CLOSE
    for name in ("base_yaw", "hub_pitch"):
        np.testing.assert_allclose(flown[f"position.{name}"], before[f"position.{name}"], atol=1e-9)
