"""Compile every kernel once, so that no run pays for it."""

from dataclasses import replace

import numpy as np

from flexslew_control.controllers import CONTROLLERS
from flexslew_control.planners import make_plan
from flexslew_control.planners.feedforward.optimized_feedforward import OptimizedFeedforward
from flexslew_control.planners.slew import CsaGoal, CsaModel
from flexslew_lab.trial.in_process import fly
from flexslew_lab.trial.trial import Trial, bench_settings, build_controllers
from flexslew_plant.bench.bench import Bench

if __name__ == "__main__":
    goal = CsaGoal(base_yaw=0.1, hub_pitch=0.1)
    for modes in (1, 3):
        model = CsaModel(modes=modes)
        plan = make_plan(OptimizedFeedforward(model=model, goal=goal), 0.01, (1e3, 1e3))
    trial = Trial(duration=0.1, controllers={name: {} for name in CONTROLLERS})
    for name in CONTROLLERS:
        flown = replace(trial, active=name)
        bench = Bench(bench_settings(flown))
        bench.model.jacobian(np.zeros(2 * bench.model.coordinates), np.zeros(2))
        controllers = build_controllers(flown, bench, "warm-up")
        for controller in controllers.values():
            controller.adopt(plan)
        fly(bench, controllers)
