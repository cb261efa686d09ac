"""What a plan about one axis leaves on the whole bench: all modes, all axes, the free platform.

A planner turns a spacecraft about one axis on some of its modes. The plan is flown once more, in
process and before anybody adopts it, on the equations that the bench itself integrates: efforts
held over every tick, the joint feedback about the plan, the limits of the drives.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flexslew_control.law import PlantDescription, per_joint
from flexslew_control.plan import Plan
from flexslew_control.planners.prediction import WATCHED, Prediction
from flexslew_control.planners.slew import Feedback
from flexslew_plant.arrays import Vector

NOTHING = 1e-5  # residual of the tips that counts as none [m]
_ALLOWED = 0.1  # more than on the planner's own model [-]


class Better(NamedTuple):
    """A plan on other modes that leaves less."""

    modes: int  # frequencies that it counts with
    promise: Prediction


def kept(plan: Plan, bench: Prediction) -> bool:
    """Return whether a plan leaves the bench as still as the model that it is made on."""
    on_model = float(plan.summary["predicted_residual_tip_deflection"])
    return bench.tip_deflection <= (1.0 + _ALLOWED) * on_model + NOTHING


def told(
    plan: Plan, plant: PlantDescription, bench: Prediction, better: Better | None = None
) -> Plan:
    """Return the plan with what it leaves on the bench, and a warning if that is more.

    Args:
        plan: with what it leaves on the model that it is made on.
        plant: what stands on the bench.
        bench: what it leaves there.
        better: what would leave less; None: no plan that was tried.
    """
    on_model = plan.summary["predicted_residual_tip_deflection"]
    away = dict(zip(plant.joint_names, bench.attitude_error.tolist(), strict=True))
    summary = {
        **plan.summary,
        "predicted_residual_tip_deflection": bench.tip_deflection,
        "predicted_residual_attitude_error": away,
        "residual_tip_deflection_on_model": on_model,
    }
    if not kept(plan, bench):
        remedy = "no plan about one axis on more modes leaves less than half"
        if better is not None:
            left = better.promise.tip_deflection
            remedy = f"model: {{modes: {better.modes}}} leaves {left:.3g} m"
        words = (
            f"on the whole bench it leaves {bench.tip_deflection:.3g} m at the tips, on the model "
            f"that it is made on {on_model:.3g} m; {remedy}"
        )
        earlier = plan.summary.get("warning")
        summary["warning"] = f"{earlier}; {words}" if earlier else words
    return replace(plan, summary=summary)


def flown_on_bench(plan: Plan, plant: PlantDescription, feedback: Feedback) -> Prediction:
    """Return the residuals of a plan that is flown on the whole bench.

    Args:
        plan: for all joints of the bench.
        plant: what stands on the bench.
        feedback: gains of the controller that flies it.
    """
    model, names, limit = plant.testbed.model(), plant.joint_names, plant.effort_limit
    kp, kd = per_joint("kp", feedback.kp, names), per_joint("kd", feedback.kd, names)
    rest = model.rest(dict(zip(names, plan.position[0].tolist(), strict=True)))
    x = np.concatenate((rest, np.zeros(model.coordinates)))
    last = int(np.ceil(plan.duration / plan.period - 1e-9))
    nothing, tip = np.zeros(len(names)), model.appendages.tip
    swing, peak, away = 0.0, 0.0, np.zeros(len(names))
    for k in range(max(len(plan.effort), last) + int(np.ceil(WATCHED / plan.period))):
        position, velocity = model.joint_state(x)
        now = _largest(tip @ model.modal_state(x)[0])
        peak = max(peak, now)
        if k >= last:
            swing = max(swing, now)
            away = np.maximum(away, abs(position - plan.position[-1]))
        known = k < len(plan.effort)
        at = min(k, len(plan.position) - 1)
        effort = plan.effort[k] + 0.0 if known else nothing
        effort = effort + kp * (plan.position[at] - position)
        effort += kd * ((plan.velocity[at] if known else nothing) - velocity)
        x = model.advance(
            x, np.clip(effort, -limit, limit), plan.period, t=plan.start + k * plan.period
        )
    now = _largest(tip @ model.modal_state(x)[0])
    return Prediction(max(swing, now), away, max(peak, now))


def _largest(values: Vector) -> float:
    """Return the largest |value|; infinite where the flight has diverged."""
    largest = float(np.abs(values).max(initial=0.0))
    return largest if np.isfinite(largest) else np.inf
