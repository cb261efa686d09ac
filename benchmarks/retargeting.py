"""What the laws for turning antennas cost: one update at 20 states, and planning their gains.

Beside each stands a floor measured in the same run: for an update the gains times the state alone,
for the plan the products of its backward recursion alone.
"""

from collections.abc import Callable
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np

from flexslew_control.controllers import build_controller
from flexslew_control.law import Estimate
from flexslew_control.linear.perturbation import HALVINGS
from flexslew_control.planners import make_plan, plan_settings
from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_lab.trial.trial import SavedPlan, bench_settings, plant_of
from flexslew_plant.bench.bench import Bench

_UPDATES, _RUNS = 2000, 5
_LAWS = ("disturbance_minimisation", "disturbance_accommodating", "planned_gains", "modal_space")
_NONE = np.zeros(0)


def figures() -> dict[str, float]:
    """Return what an update and a plan take.

    update_*_us: the law alone, with 10 coordinates and as many efforts: 20 states [us].
    answer_*_us: the whole answer to a measurement, estimator included [us].
    update_floor_us: [Kp, Kd, Ki] times the state of the same size, in NumPy [us].
    update_*_ratio: an update over that floor [-].
    plan_perturbation_ms: the gains of example 2, 18 coordinates, 300 ticks [ms].
    plan_perturbation_ratio: that over the products of its recursion alone [-].
    """
    gains, state = np.ones((10, 30)), np.ones(30)
    floor = _each(lambda: gains @ state)
    found = {"update_floor_us": 1e6 * floor}
    for law in _LAWS:
        update, answer = _updates(law)
        found[f"update_{law}_us"] = 1e6 * update
        found[f"update_{law}_ratio"] = update / floor
        found[f"answer_{law}_us"] = 1e6 * answer
    return {**found, **_planning()}


def _updates(law: str) -> tuple[float, float]:
    """Return how long one update of a law, and one whole answer, takes [s]."""
    two = {"shape": {"modes_across": 2, "modes_third": 2}}
    plan: dict[str, Any] = {"feedforward": "none"}
    plan |= {"gains": "perturbation"} if law == "planned_gains" else {}
    changes = {"testbed": {"appendages": {"beam": two}}, "plan": plan, "period": 0.01}
    trial = example_trial("antenna_1", changes)
    plant = plant_of(trial)
    assert plant.testbed.model().coordinates == 10
    own = {"design": "sampled"} if law == "disturbance_minimisation" else {}
    controller = build_controller("law", law, own, plant, "benchmark")
    assert trial.plan is not None
    assert not isinstance(trial.plan, SavedPlan)
    refused = controller.adopt(make_plan(trial.plan, plant))
    assert not refused, refused
    bench = Bench(bench_settings(trial))
    ticks = iter(range(1, 10**9))

    def answered() -> None:
        tick = next(ticks)
        asked = bench.question._replace(controller="law", tick=tick, time=tick * trial.period)
        assert controller.observe(asked) is not None

    whole = _each(answered)
    small = np.full(10, 1e-3)
    estimate = Estimate(small, small, _NONE, np.zeros((0, 0)), _NONE)
    reference = controller.reference(100)
    asked = bench.question._replace(tick=100)
    return _each(lambda: controller.law.update(asked, estimate, reference)), whole


def _planning() -> dict[str, float]:
    trial = example_trial("antenna_2")
    settings = plan_settings({"method": "retargeting", "gains": "perturbation"}, "benchmark")
    plant = plant_of(trial)
    times, ratios = [], []
    for run in range(_RUNS + 1):
        start = perf_counter()
        plan = make_plan(settings, plant)
        took = perf_counter() - start
        floor = _products(3 * 18, len(plan.gains) - 1)
        if run:  # the first one loads the compiled code
            times.append(took)
            ratios.append(took / floor)
    return {
        "plan_perturbation_ms": 1e3 * median(times),
        "plan_perturbation_ratio": median(ratios),
    }


def _products(size: int, ticks: int) -> float:
    """Return how long the products of a backward recursion take [s]."""
    a, b = np.eye(size), np.eye(size)
    start = perf_counter()
    for _ in range(2 * (HALVINGS + 1) * ticks):
        a = a @ b
    return perf_counter() - start


def _each(call: Callable[[], object]) -> float:
    """Return how long one call takes: the best of several series [s]."""
    best = np.inf
    for _ in range(_RUNS):
        start = perf_counter()
        for _ in range(_UPDATES):
            call()
        best = min(best, (perf_counter() - start) / _UPDATES)
    return float(best)


if __name__ == "__main__":
    for name, value in figures().items():
        print(f"{name}: {value:.3f}")
