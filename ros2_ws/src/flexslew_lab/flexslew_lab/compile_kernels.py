"""Compile the kernels of everything that is shipped, so that no run pays for it.

Those of the default trial first; the others in the background, unless --wait is given. With
--studies those of the studies alone: what they need has been installed since. A run that needs one
of them earlier compiles it itself, before its tick 0.
"""

import os
import signal
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from multiprocessing import get_context
from typing import Any

import numpy as np

from flexslew_control.controllers import CONTROLLERS
from flexslew_control.planners import PLANNERS, make_plan
from flexslew_control.planners.feedforward.optimized_feedforward import OptimizedFeedforward
from flexslew_lab.background import in_background, machine_code_log
from flexslew_lab.run.in_process import run_bench
from flexslew_lab.trial.sources import DEFAULT, example_trials, read_trial
from flexslew_lab.trial.trial import (
    Trial,
    bench_settings,
    build_controllers,
    plan_of_trial,
    plant_of,
)
from flexslew_plant.bench.bench import Bench
from flexslew_plant.errors import BadInput
from flexslew_plant.hardware.actuator import ActuatorSettings
from flexslew_plant.hardware.friction import Friction
from flexslew_plant.testbeds import default_testbed, initial_state

_MOST = 8  # processes, of half a gigabyte each
_TICKS = 5


def default_bench(modes: int) -> None:
    """Fly the default testbed with every controller on an optimised plan."""
    goal = dict.fromkeys(default_testbed().typical_goal, 0.1)
    requested = OptimizedFeedforward(model={"modes": modes}, goal=goal)
    testbed: Any = default_testbed()
    trial = Trial(
        testbed=replace(testbed, modes=modes), controllers={name: {} for name in CONTROLLERS}
    )
    plan = make_plan(requested, plant_of(trial))
    for name in CONTROLLERS:
        _simulate(replace(trial, active=name), plan)
    Friction(plant_of(trial).testbed.model().resolved_motors, ActuatorSettings(), trial.period)


def default_plan(method: str) -> None:
    """Plan the manoeuvre of the default trial by another method, if it plans such ones."""
    with suppress(BadInput):
        plan_of_trial(read_trial(DEFAULT, [f"plan={method}"])[0])


def shipped_trial(name: str) -> None:
    """Plan a shipped trial and fly its first ticks."""
    trial, _ = read_trial(name, None)
    _simulate(trial, plan_of_trial(trial))


def shipped_study(name: str) -> None:
    """Plan a shipped study and fly its first sample in a batch where it can."""
    from flexslew_lab.studies.batch.fleet import BatchRunner
    from flexslew_lab.studies.cases import case_of
    from flexslew_lab.studies.run import prepare
    from flexslew_lab.studies.study import load_study, study_path

    ready = prepare(load_study(study_path(name)))
    cases = [case_of(ready.study, ready.samples, k) for k in range(len(ready.study.variants))]
    for _ in BatchRunner(ready.study, ready.plans).fly(cases):
        pass


def shipped_studies() -> list[Callable[[], None]]:
    """Return what compiles the studies; nothing where what they need is not installed yet."""
    if find_spec("pyarrow") is None:
        return []
    from flexslew_lab.studies.study import example_names

    return [partial(shipped_study, name) for name in example_names()]


def _simulate(trial: Trial, plan: Any) -> None:
    trial = replace(trial, duration=_TICKS * trial.period)
    bench = Bench(bench_settings(trial))
    model, x = bench.model, initial_state(trial.testbed)
    idle = np.zeros(model.efforts)
    if model.positions == model.coordinates:  # else it is that of a deviation, not of the state
        model.jacobian(x, idle)
    model.derivative(x, idle)
    model.energy(x)
    controllers = build_controllers(trial, "warm-up")
    for controller in controllers.values():
        if plan is not None:
            controller.adopt(plan)
    run_bench(bench, controllers)


def _exit_on_signal() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _compile(tasks: list[Callable[[], None]]) -> None:
    """Do the tasks, side by side where there are processors for it."""
    processes = min(os.cpu_count() or 1, _MOST, len(tasks))
    with ProcessPoolExecutor(processes, get_context("spawn"), _exit_on_signal) as pool:
        waiting = [pool.submit(task) for task in tasks]
        for number, done in enumerate(as_completed(waiting), 1):
            done.result()
            if number % 7 == 0:
                print(f"  {number} of {len(tasks)}", file=sys.stderr)


if __name__ == "__main__":
    _exit_on_signal()
    tasks = shipped_studies()
    if "--studies" not in sys.argv:
        shipped_trial(DEFAULT)
        tasks += [partial(default_bench, modes) for modes in (3, 1)]
        tasks += [partial(default_plan, method) for method in PLANNERS]
        tasks += [partial(shipped_trial, trial.name) for trial in reversed(example_trials())]
    if "--wait" in sys.argv or in_background(machine_code_log()):
        _compile(tasks)
