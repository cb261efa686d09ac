"""How long shapers and time-optimal plans take, beside a floor measured in the same run."""

from collections.abc import Callable
from time import perf_counter

import numpy as np

from flexslew_control.law import PlantDescription
from flexslew_control.planners import make_plan, plan_settings
from flexslew_control.planners.input_shaping.shapers import make_shaper
from flexslew_control.planners.time_optimal.bang_bang import BangBang
from flexslew_control.planners.time_optimal.switching import continued_durations
from flexslew_plant.testbeds import default_testbed
from flexslew_plant.testbeds.hub_with_appendages import FOOT_POUND, HubTestbed


def figures() -> dict[str, float]:
    """Return wall times by name [ms]: the best of several runs, compiled before."""
    model = HubTestbed().model()
    three, five = (
        BangBang(model, 0, np.zeros(4), 1.0, 2.0 * FOOT_POUND, robust) for robust in (False, True)
    )
    arcs = continued_durations(three)
    if arcs is None:
        raise RuntimeError("the benchmark's slew was not found")
    ticks = np.linspace(0.0, 25.0, 2501)
    robust, shaped = (
        plan_settings({"method": name}, "") for name in ("robust_feedforward", "input_shaping")
    )
    hub = {
        "method": "time_optimal",
        "model": {"kind": "hub_with_appendages"},
        "goal": {"hub": 1.0},
        "amplitude": 2.0 * FOOT_POUND,
    }
    fastest, insensitive = (
        plan_settings({**hub, "robust": robust}, "") for robust in (False, True)
    )
    bench = PlantDescription(default_testbed(), 0.01, np.full(2, 150.0))
    hub_bench = PlantDescription(HubTestbed(), 0.01, np.full(1, 150.0))
    return {
        "shaping_floor_one_simulation_ms": _best(lambda: three.final(arcs)),
        "shaping_zvd_of_2500_ticks_ms": _best(
            lambda: make_shaper("zvd", 0.338329).shape(lambda t: np.clip(t / 25.0, 0.0, 1.0), ticks)
        ),
        "time_optimal_three_switches_ms": _best(lambda: continued_durations(three)),
        "time_optimal_five_switches_ms": _best(lambda: continued_durations(five)),
        "time_optimal_three_switches_plan_ms": _best(lambda: make_plan(fastest, hub_bench)),
        "time_optimal_five_switches_plan_ms": _best(lambda: make_plan(insensitive, hub_bench)),
        "robust_feedforward_five_models_ms": _best(lambda: make_plan(robust, bench)),
        "input_shaping_plan_ms": _best(lambda: make_plan(shaped, bench)),
    }


def _best(call: Callable[[], object], runs: int = 7) -> float:
    call()
    times = []
    for _ in range(runs):
        before = perf_counter()
        call()
        times.append(perf_counter() - before)
    return 1e3 * min(times)


if __name__ == "__main__":
    for name, value in figures().items():
        print(f"{name}: {value:.3f}")
