"""Steps of a controller in C beside those of the bench: m1's law with its plan."""

import tempfile
from pathlib import Path
from time import perf_counter

from flexslew_lab.export.c_module import module_of
from flexslew_lab.export.compiled import CompiledModule
from flexslew_lab.export.flight_vector import controller_vector
from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import build_controllers, plan_of_trial, set_plan
from flexslew_plant.measurement import Measurement

STEPS = 2000


def figures() -> dict[str, float]:
    """Return steps per second in C, called from Python, and on the bench, and their ratio."""
    trial, source = read_trial("m1", [])
    plan, name = plan_of_trial(trial, predict=False), trial.active
    vector = controller_vector(trial, name, plan, source, STEPS)
    with tempfile.TemporaryDirectory() as folder:
        module = module_of(trial, build_controllers(trial, source)[name], plan, source=source)
        compiled = CompiledModule(module, Path(folder))
        started = perf_counter()
        compiled.repeat(vector.inputs[-1], 100 * STEPS)
        in_c = 100 * STEPS / (perf_counter() - started)
    controllers = build_controllers(trial, source)
    set_plan(controllers, name, plan)
    questions = [
        Measurement(k, 0, row[0], name, row[2:4], row[4:6], row[6:8], row[8:10], row[10:12])
        for k, row in enumerate(vector.inputs)
    ]
    controllers[name].warm(2)
    started = perf_counter()
    for question in questions:
        controllers[name].observe(question)
    on_bench = len(questions) / (perf_counter() - started)
    return {
        "c_controller_steps_per_s": in_c,
        "bench_controller_steps_per_s": on_bench,
        "c_controller_over_bench": in_c / on_bench,
    }
