"""Trials per second in a batch and on the bench, beside a SciPy loop of the same run."""

import shutil
import subprocess
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import numpy as np
from scipy.integrate import solve_ivp

from flexslew_lab.run.pool import Pool
from flexslew_lab.studies.batch.fleet import BatchRunner
from flexslew_lab.studies.cases import Cases, case_of, case_trial
from flexslew_lab.studies.execution.worker import Job
from flexslew_lab.studies.flight import simulate_case
from flexslew_lab.studies.run import PreparedStudy, prepare
from flexslew_lab.studies.study import parse_study
from flexslew_plant.arrays import Vector

_STUDY = """
study: benchmark
trial: m1
seed: 7
sampling: {method: random, n: 1024}
batch: %s
vary:
  testbed.parameters.bending_stiffness: {relative: {uniform: [-0.2, 0.2]}}
"""
_OTHER = """
name: oscillator
duration: 40.0
testbed: {kind: floating_oscillator}
plan: {method: reference_only, goal: {mass: 0.1}, duration: 10.0}
controllers: {pd_feedforward: {kp: 2.0, kd: 2.0}}
"""
_THREE_AXES = """
name: three_axes
duration: 40.0
period: 0.02
testbed:
  kind: spacecraft
  platform: {mass: 200.0, inertia: {xx: 35.0, yy: 30.0, zz: 32.0}}
  appendages:
    left:
      hinge: {place: [0.0, 0.6, 0.0], axes: [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]}
      shape: {kind: modal_data, file: solar_panel.yaml}
    right:
      hinge: {place: [0.0, -0.6, 0.0], axes: [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]}
      shape: {kind: modal_data, file: solar_panel.yaml}
  actuators: {}
  wheels:
    roll: {axis: [1.0, 0.0, 0.0], inertia: 0.02, limit: 0.5, momentum_limit: 10.0}
    pitch: {axis: [0.0, 1.0, 0.0], inertia: 0.02, limit: 0.5, momentum_limit: 10.0}
    yaw: {axis: [0.0, 0.0, 1.0], inertia: 0.02, limit: 0.5, momentum_limit: 10.0}
plan: {method: reference_only, goal: {roll: 0.5, pitch: -0.3, yaw: 0.4}, duration: 30.0}
controllers:
  pd_feedforward: {kp: [12.0], kd: [60.0]}
"""
_ROUNDS = 3
_ON_BENCH = 16  # trials on each number of processes
_COUNTED = 50_000_000  # numbers
_C = Path(__file__).with_name("csa_flights.c")
_FLAGS = "-O3 -march=native -mprefer-vector-width=512 -ffast-math -fopenmp-simd"


def figures() -> dict[str, float]:
    """Return trials of 100 s with 3 modes under PD + feedforward, per second of wall time.

    studies_batch_kernel: in a batch on one core, from trial to metrics.
    studies_other_batch: 40 s of the floating oscillator in a batch, over the same on the bench.
    studies_batch_2: in a batch on two processes, from the first chunk to the last result.
    studies_spacecraft_batch: own_spacecraft in a batch, over the same on the bench.
    studies_three_axes_batch: 40 s of a craft in three axes in a batch, over the same on the bench.
    studies_bench_1, studies_bench_2: by the ordinary bench on one and on two processes.
    studies_bench_speed_up: of two processes over one.
    studies_machine_speed_up: the floor for that, two processes that only count over one.
    studies_scipy: the floor, the closed loop by solve_ivp, DOP853 with its default tolerances, tick
        by tick, in one process.
    studies_batch_over_scipy: on two processes, over two of these.
    studies_c, studies_batch_kernel_over_c: where gcc is there, csa_flights.c on one core, the same
        equations in a loop that it makes vectors of, without sensors and all but two metrics, by
        a scheme of order 4; and studies_batch_kernel over it.
    """
    with TemporaryDirectory() as folder:
        batch = prepare(parse_study(_STUDY % "true", "benchmark", Path(folder)))
        bench = prepare(parse_study(_STUDY % "false", "benchmark", Path(folder)))
        (Path(folder) / "other.yaml").write_text(_OTHER)
        other = (_STUDY % "true").replace("m1", "other.yaml").replace(
            "testbed.parameters.bending_stiffness: {relative: {uniform: [-0.2, 0.2]}}",
            "controllers.pd_feedforward.kp: {relative: {uniform: [-0.2, 0.2]}}",
        )  # fmt: skip
        others = prepare(parse_study(other, "benchmark", Path(folder)))
        craft = prepare(
            parse_study(other.replace("other.yaml", "own_spacecraft"), "benchmark", Path(folder))
        )
        (Path(folder) / "three.yaml").write_text(_THREE_AXES)
        three = prepare(
            parse_study(other.replace("other.yaml", "three.yaml"), "benchmark", Path(folder))
        )
    found = {"studies_batch_kernel": _kernel(batch)}
    found["studies_other_batch"] = _kernel(others) / _one_by_one(others)
    found["studies_spacecraft_batch"] = _kernel(craft) / _one_by_one(craft)
    found["studies_three_axes_batch"] = _kernel(three) / _one_by_one(three)
    found["studies_batch_2"] = _processes(batch, 2, 1024)
    found["studies_bench_1"] = _processes(bench, 1, _ON_BENCH)
    found["studies_bench_2"] = _processes(bench, 2, 2 * _ON_BENCH)
    found["studies_bench_speed_up"] = found["studies_bench_2"] / found["studies_bench_1"]
    found["studies_machine_speed_up"] = _counting(2) / _counting(1)
    found["studies_scipy"] = _scipy(bench)
    found["studies_batch_over_scipy"] = found["studies_batch_2"] / (2.0 * found["studies_scipy"])
    in_c = _in_c()
    if in_c is not None:
        found["studies_c"] = in_c
        found["studies_batch_kernel_over_c"] = found["studies_batch_kernel"] / in_c
    return found


def _in_c() -> float | None:
    """Return the rate of the same flights in C; None: there is no gcc that makes them."""
    gcc = shutil.which("gcc")
    if gcc is None:
        return None
    with TemporaryDirectory() as folder:
        made = Path(folder) / "flights"
        command = [gcc, *_FLAGS.split(), str(_C), "-o", str(made), "-lmvec", "-lm"]
        if subprocess.run(command, capture_output=True, check=False).returncode:
            return None  # another processor or C library
        flown = subprocess.run([made], capture_output=True, check=True, text=True)
        return float(flown.stdout.split()[0])


def _kernel(ready: PreparedStudy) -> float:
    batch = BatchRunner(ready.study, ready.plans)
    cases = list(Cases(ready.study, ready.samples, range(256)))
    best = np.inf
    for _ in range(_ROUNDS + 1):
        start = perf_counter()
        count = sum(len(results) for results, _ in batch.fly(cases))
        best = min(best, perf_counter() - start)
    return count / best


def _one_by_one(ready: PreparedStudy) -> float:
    cases = list(Cases(ready.study, ready.samples, range(_ON_BENCH)))
    start = perf_counter()
    for case in cases:
        simulate_case(ready.study, case, ready.plans)
    return len(cases) / (perf_counter() - start)


def _processes(ready: PreparedStudy, workers: int, count: int) -> float:
    """Return the rate of processes that are warm: the first round is not counted."""
    pool = Pool(Job(ready.study, ready.plans), workers)
    best = np.inf
    try:
        for _ in range(_ROUNDS + 1):
            start = perf_counter()
            for _ in pool.fly(Cases(ready.study, ready.samples, range(count))):
                pass
            best = min(best, perf_counter() - start)
    finally:
        pool.close()
    return count / best


def _counting(workers: int) -> float:
    """Return how many numbers processes count together, per second of wall time."""
    with get_context("forkserver").Pool(workers) as pool:
        pool.map(_count, [1] * workers)
        start = perf_counter()
        pool.map(_count, [_COUNTED] * workers, chunksize=1)
        return workers * _COUNTED / (perf_counter() - start)


def _count(numbers: int) -> None:
    for _ in range(numbers):
        pass


def _scipy(ready: PreparedStudy) -> float:
    """Return the rate of a plain loop over the ticks of one trial's first tenth."""
    trial = case_trial(ready.study, case_of(ready.study, ready.samples, 0))
    plan = ready.plans.of(trial)
    assert plan is not None
    model = trial.testbed.model()
    m, n = model.joints, model.coordinates
    x, ticks = np.zeros(2 * n), round(trial.duration / trial.period) // 10
    start = perf_counter()
    for k in range(ticks):
        r = plan.reference(k)
        u = r.effort + 460.0 * (r.position - x[:m]) + 920.0 * (r.velocity - x[n : n + m])

        def slope(_: float, y: Vector, u: Vector = u) -> Vector:
            return model.derivative(y, u)

        x = solve_ivp(slope, (0.0, trial.period), x, method="DOP853").y[:, -1]
    return 0.1 / (perf_counter() - start)


if __name__ == "__main__":
    for key, value in figures().items():
        print(f"{key:40s} {value:12.4g}")
