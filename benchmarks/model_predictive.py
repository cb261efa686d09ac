"""Model predictive control: how long an answer takes."""

from time import thread_time

import numpy as np

from flexslew_control.controllers import build_controller
from flexslew_control.controllers.controller import Controller
from flexslew_lab.notebook import trial
from flexslew_lab.trial.trial import (
    Trial,
    bench_settings,
    law_of,
    plan_of_trial,
    plant_of,
    set_plan,
)
from flexslew_plant.bench.bench import Bench
from flexslew_plant.measurement import EffortCommand

_STEPS, _TICKS = 40, 1000


def figures() -> dict[str, float]:
    """Return what an answer of `model_predictive` takes on csa under M1, with 40 steps.

    answer_p50_ms, answer_p99_ms: of its answers to the questions of a flight, estimator, look
        ahead and solution together [ms].
    """
    what = trial("predictive_m1", {"controllers.model_predictive.steps": _STEPS})
    seconds = _answers(what)
    return {
        "answer_p50_ms": 1e3 * float(np.quantile(seconds, 0.5)),
        "answer_p99_ms": 1e3 * float(np.quantile(seconds, 0.99)),
    }


def _answers(what: Trial) -> list[float]:
    """Return how long the answers of a flight take [s]."""
    law, values = law_of(what.active, what.controllers[what.active] or {})
    built: Controller = build_controller(what.active, law, values, plant_of(what), "benchmark")
    refused = set_plan({what.active: built}, what.active, plan_of_trial(what))
    assert refused is None
    bench, seconds = Bench(bench_settings(what)), []
    for _ in range(_TICKS):
        asked = bench.question
        begin = thread_time()
        answer = built.observe(asked)
        seconds.append(thread_time() - begin)
        assert answer is not None
        command = EffortCommand(asked.tick, asked.epoch, asked.controller, answer.command.effort)
        bench.offer(command)
        bench.advance()
    return seconds
