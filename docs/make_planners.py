"""Draw docs/planners.png: `python docs/make_planners.py`; it prints the table of planners.md too.

The floating oscillator moved by 1 m with 1 N under the PD of its trial, stiffness within 20 %: what
every planner leaves on the worst of 11 plants, over the duration. Then M1 by both robust planners.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from time import process_time
from typing import Any

import matplotlib as mpl
import numpy as np

from flexslew_control.plan import Plan
from flexslew_control.planners import PLANNERS, make_plan, plan_settings
from flexslew_control.planners.minimax.limit_curve import limit_curve
from flexslew_control.planners.residual.prediction import predicted
from flexslew_control.planners.slew import slew_of
from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import feedback_of, plant_of
from flexslew_plant.errors import BadInput, PlanFailed

mpl.use("Agg")
from matplotlib import pyplot as plt

DURATIONS = (6.0, 8.0, 10.0, 12.0, 15.0, 20.0)  # of planners that take one [s]
M1_DURATIONS = (25.0, 30.0, 40.0, 60.0)  # [s]
ERRORS = np.linspace(-0.2, 0.2, 11)  # of the stiffness


def asked() -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield every planner of slews with its variants, at every duration that it takes."""
    for name, entry in PLANNERS.items():
        if not entry.slews or not hasattr(entry.settings, "model"):
            continue  # it plans no slew
        alike = [(v.name, dict(v.keys)) for v in entry.variants if v.duration_factor == 1.0]
        for variant in (("", {}), *alike):
            label = ", ".join(filter(None, (name, variant[0])))
            for duration in DURATIONS if entry.takes_duration else (None,):
                keys = {"method": name, **variant[1]}
                yield label, keys | ({"duration": duration} if duration else {})


def flown(trial_name: str, goal: dict[str, float], **keys: Any) -> tuple[Plan, float, float]:
    """Return a plan, what it leaves on the worst plant [m], and the time to plan it [CPU s]."""
    trial = read_trial(trial_name)[0]
    plant, feedback = plant_of(trial), feedback_of(trial)
    section = plan_settings({"goal": goal, **keys}, "make_planners")
    began = process_time()
    plan = make_plan(section, plant, feedback)
    took = process_time() - began
    left = 0.0
    for error in ERRORS:
        other = replace(plant, testbed=plant.testbed.scaled(stiffness=1.0 + error))
        slew = slew_of(section, other, feedback)
        left = max(left, predicted(plan, slew).tip_deflection)
    return plan, left, took


def main() -> None:
    """Write the picture and print both tables."""
    found: dict[str, list[tuple[float, float]]] = {}
    for label, keys in asked():
        try:
            plan, left, took = flown("time_optimal_oscillator", {"mass": 1.0}, **keys)
        except (BadInput, PlanFailed) as refused:
            print(f"{label:40} {keys.get('duration', '')} refused: {refused}")
            continue
        found.setdefault(label, []).append((plan.duration, left))
        print(f"{label:40} {plan.duration:8.3f} s {left:10.3g} m {took:8.2f} s to plan", flush=True)
    trial = read_trial("time_optimal_oscillator")[0]
    section = plan_settings({"method": "minimax_feedforward", "goal": {"mass": 1.0}}, "here")
    bound = limit_curve(slew_of(section, plant_of(trial), feedback_of(trial)), (-0.2, 0.2), 20.0)
    assert bound is not None
    figure, axes = plt.subplots(figsize=(9.5, 5.2), layout="constrained")
    for k, (label, points) in enumerate(found.items()):
        style = "o-" if len(points) > 1 else "s"
        axes.semilogy(*np.array(points).T, style, color=f"C{k % 10}", ms=5, lw=1, label=label)
    below = {"color": "k", "ls": "--", "lw": 1, "label": "no efforts leave less"}
    axes.step(bound.duration, bound.residual, where="pre", **below)  # of less time, too
    axes.axvline(bound.least_time or np.nan, color="grey", lw=0.8, ls=":")
    axes.set(xlabel="duration [s]", ylabel="worst residual tip deflection [m]", ylim=(1e-8, 2.0))
    axes.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.savefig(Path(__file__).parent / "planners.png", dpi=110)
    for method, duration in product(("robust_feedforward", "minimax_feedforward"), M1_DURATIONS):
        goal = {"base_yaw": 1.0, "hub_pitch": 0.5}
        keys = {"method": method, "duration": duration, "model": {"modes": 3}}
        _, left, took = flown("m1", goal, **keys)
        print(f"M1, {method:24} {duration:g} s {left:10.3g} m {took:8.2f} s to plan", flush=True)


if __name__ == "__main__":
    main()
