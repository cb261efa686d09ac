"""The running score of one member on the bench, as stepped_loop counts it in a batch."""

from collections.abc import Sequence

import numpy as np

from flexslew_control.plan import Plan
from flexslew_lab.metrics.efforts import saturation_excess
from flexslew_lab.metrics.from_bag import manoeuvre_of
from flexslew_lab.studies.batch.stepped import RUNNING, RunningTerm
from flexslew_plant.arrays import Vector
from flexslew_plant.bench.bench import Bench, Truth

_ROUNDING = 1e-9  # of a time [s]


class RunningScore:
    """The sum of weight / (1 + value / half) over metrics that only grow.

    Args:
        bench: at tick 0.
        plan: that is flown; None: the manoeuvre is over from the start.
        terms: of the score.
    """

    def __init__(self, bench: Bench, plan: Plan | None, terms: Sequence[RunningTerm]) -> None:
        self._model, self._limit = bench.model, bench.limit
        self._period, self._terms = bench.settings.period, terms
        self._end, self._goal = 0.0, np.full(bench.limit.size, np.nan)
        if plan is not None:
            manoeuvre = manoeuvre_of(
                plan.position, plan.velocity, plan.start, plan.duration, bench.testbed
            )
            self._end = manoeuvre.end
            self._goal = self._goal if manoeuvre.goal is None else manoeuvre.goal
        self._values = dict.fromkeys((term.metric for term in terms), 0.0)

    def update(self, truth: Truth) -> float:
        """Return the running score after a tick."""
        values = self._values
        over = truth.time >= self._end - _ROUNDING
        for name in values:
            value = self._measure(name, truth, over)
            _, adds_up = RUNNING[name]
            values[name] = values[name] + value if adds_up else max(values[name], value)
        return sum(term.weight / (1.0 + values[term.metric] / term.half) for term in self._terms)

    def _measure(self, name: str, truth: Truth, over: bool) -> float:
        """Return what a tick adds to a metric, or its value at the tick."""
        held, effort = self._period if truth.tick else 0.0, truth.applied_effort
        match name:
            case "residual_tip_deflection" | "peak_tip_deflection":
                counted = over or name.startswith("peak")
                return _largest(truth.tip_deflection) if counted else 0.0
            case "residual_attitude_error":
                x = np.concatenate((truth.position, truth.velocity))
                return _largest(self._model.joint_state(x)[0] - self._goal) if over else 0.0
            case "peak_effort":
                return _largest(effort)
            case "control_effort":
                return held * float(effort.dot(effort))
            case _:
                full = (saturation_excess(effort, self._limit) >= 0.0).any()
                return held if full else 0.0


def _largest(values: Vector) -> float:
    return float(np.abs(values).max(initial=0.0))
