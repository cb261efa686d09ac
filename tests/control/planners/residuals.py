"""What a plan leaves when it is flown in process."""

from collections.abc import Callable
from typing import Any

import numpy as np

from flexslew_control.plan import Plan
from flexslew_lab.run.in_process import run_bench
from flexslew_plant.bench.bench import Bench, Truth
from flexslew_plant.testbeds.model import Model


class Watch:
    """Calls a function with the truth of every tick."""

    def __init__(self, truth: Callable[[Truth], None]) -> None:
        self.truth = truth

    def question(self, question: Any) -> None:
        return

    answer = event = question


class Residual:
    """Largest tip deflection and joint errors from a plan's end on."""

    def __init__(self, plan: Plan, model: Model) -> None:
        self.plan, self.model = plan, model
        self.tip, self.joints = 0.0, np.zeros(len(plan.joint_names))

    def truth(self, truth: Truth) -> None:
        if truth.time >= self.plan.end - 1e-9:
            at = self.model.joint_state(np.concatenate((truth.position, truth.velocity)))[0]
            away = abs(self.model.joint_error(at, self.plan.position[-1]))
            self.joints = np.maximum(self.joints, away)
            self.tip = max(self.tip, float(np.abs(truth.tip_deflection).max()))


def residual_of(plan: Plan, bench: Bench, controllers: dict[str, Any]) -> Residual:
    """Return what a plan leaves on a bench; the controllers that fly it adopt it here."""
    for controller in controllers.values():
        assert controller.adopt(plan) is None
    found = Residual(plan, bench.model)
    run_bench(bench, controllers, Watch(found.truth))
    return found
