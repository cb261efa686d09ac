"""Compile every kernel once, so that no run pays for it."""

from dataclasses import replace

import numpy as np

from flexslew_control.controllers import CONTROLLERS
from flexslew_control.planners import make_plan
from flexslew_control.planners.feedforward.optimized_feedforward import OptimizedFeedforward
from flexslew_lab.trial.in_process import fly
from flexslew_lab.trial.trial import Trial, bench_settings, build_controllers, plant_of
from flexslew_plant.bench.bench import Bench
from flexslew_plant.bench.hardware.actuator import ActuatorSettings
from flexslew_plant.bench.hardware.friction import Friction
from flexslew_plant.testbeds import default_testbed

if __name__ == "__main__":
    for modes in (1, 3):
        goal = dict.fromkeys(default_testbed().typical_goal, 0.1)
        wanted = OptimizedFeedforward(model={"modes": modes}, goal=goal)
        plan = make_plan(wanted, plant_of(Trial()))
    trial = Trial(duration=0.1, controllers={name: {} for name in CONTROLLERS})
    for name in CONTROLLERS:
        flown = replace(trial, active=name)
        bench = Bench(bench_settings(flown))
        bench.model.jacobian(np.zeros(2 * bench.model.coordinates), np.zeros(2))
        controllers = build_controllers(flown, bench, "warm-up")
        for controller in controllers.values():
            controller.adopt(plan)
        fly(bench, controllers)
    Friction(ActuatorSettings(), trial.period)  # compiles its kernel
