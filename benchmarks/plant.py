"""How fast the bench ticks in process, beside what a bare loop takes, in the same run."""

from collections.abc import Callable
from statistics import median
from time import perf_counter

import numpy as np

from flexslew_control.controllers import build_controller
from flexslew_control.law import PlantDescription
from flexslew_plant.arrays import Vector, compiled
from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.testbeds.csa import CsaTestbed
from flexslew_plant.testbeds.model import Model

_ROUNDS = 21
_TIMES = 4_000  # samples or ticks a round
_PERIOD = 0.01  # [s]
_EFFORT: Vector = np.array([10.0, 5.0])  # [N m]


@compiled
def _nothing(p: Vector, effort: Vector, dt: float, steps: int, x: Vector) -> None:
    x[0] = p[0]


def figures() -> dict[str, float]:
    """Return medians of rounds in which ours and the floors take turns, and the best rounds.

    plant_sample_us: one 10 ms sample of the CSA testbed with 3 modes, called from Python [us].
    plant_empty_call_us: its floor, a compiled function that takes the same and does nothing [us].
    plant_kernel_us: the same sample without leaving the compiled code [us].
    plant_ticks_per_s: the loop closed with PD through Bench and Controller, without a log [1/s].
    plant_bare_ticks_per_s: its floor, a bare loop of u = -Kp q - Kd v and Model.advance [1/s].
    *_best: of the round that a busy machine disturbed least.
    """
    model = CsaTestbed(modes=3).model()
    x = np.zeros(2 * model.coordinates)
    x[1], x[2], x[5], x[6] = 0.3, 0.2, 0.05, 0.03
    cases: dict[str, Callable[[], float]] = {
        "plant_sample_us": lambda: _samples(model, x),
        "plant_empty_call_us": lambda: _empty_calls(model, x),
        "plant_kernel_us": lambda: _kernel(model, x),
        "plant_ticks_per_s": _ticks,
        "plant_bare_ticks_per_s": lambda: _bare_ticks(model, x),
    }
    seconds: dict[str, list[float]] = {name: [] for name in cases}
    for run in range(_ROUNDS + 1):
        for name, case in cases.items():
            taken = case() / _TIMES
            if run:  # the first one loads the compiled code
                seconds[name].append(taken)
    found = {}
    for name, times in seconds.items():
        for suffix, value in (("", median(times)), ("_best", min(times))):
            found[name + suffix] = 1e6 * value if name.endswith("us") else 1.0 / value
    return found


def _samples(model: Model, x: Vector) -> float:
    start = perf_counter()
    for _ in range(_TIMES):
        model.advance(x, _EFFORT, _PERIOD)
    return perf_counter() - start


def _empty_calls(model: Model, x: Vector) -> float:
    out = x.copy()
    start = perf_counter()
    for _ in range(_TIMES):
        _nothing(model.packed, _EFFORT, _PERIOD, 1, out)
    return perf_counter() - start


def _kernel(model: Model, x: Vector) -> float:
    start = perf_counter()
    model.advance(x, _EFFORT, _TIMES * _PERIOD, _TIMES)
    return perf_counter() - start


def _ticks() -> float:
    bench = Bench(BenchSettings(duration=_TIMES * _PERIOD))
    described = PlantDescription(bench.settings.testbed, _PERIOD, bench.limit)
    pd = build_controller("pd_feedforward", "pd_feedforward", {}, described, "benchmark")
    start = perf_counter()
    while not bench.done:
        answer = pd.observe(bench.question)
        if answer is None:
            raise RuntimeError("the controller did not answer")
        bench.offer(answer.command)
        bench.advance()
    return perf_counter() - start


def _bare_ticks(model: Model, x: Vector) -> float:
    n, m = model.coordinates, model.joints
    kp, kd = np.full(m, 460.0), np.full(m, 920.0)
    start = perf_counter()
    for _ in range(_TIMES):
        x = model.advance(x, -kp * x[:m] - kd * x[n : n + m], _PERIOD)
    return perf_counter() - start


if __name__ == "__main__":
    for key, value in figures().items():
        print(f"{key:40s} {value:12.4g}")
