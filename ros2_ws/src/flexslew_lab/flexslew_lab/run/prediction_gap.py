"""The prediction of a plan compared with the result of its flight."""

from typing import Any

from flexslew_control.plan import Plan
from flexslew_lab.trial.trial import Trial
from flexslew_plant.hardware.actuator import ActuatorSettings
from flexslew_plant.hardware.sensors import SensorSettings
from flexslew_plant.settings import plain
from flexslew_plant.testbeds.contract import Testbed

_ALLOWED = 0.1  # of the prediction [-]
_ZERO_RESIDUAL = 1e-5  # residual that counts as none [m]


def prediction_gap(trial: Trial, plan: Plan | None, metrics: dict[str, Any]) -> str:
    """Return in one line that a flight left more than its plan predicts, or an empty text.

    Only where the bench is what the planner believes in, or the plan has been flown on the whole
    bench, and nothing disturbs it: elsewhere the difference is what the trial is for.

    Args:
        trial: that was flown.
        plan: that it flew.
        metrics: the content of metrics.json.
    """
    left = metrics.get("residual_tip_deflection")
    if plan is None or left is None or trial.schedule:
        return ""
    predicted = plan.summary.get("predicted_residual_tip_deflection")
    seen = {k: v for k, v in plain(trial.testbed).items() if k != "initial"}
    model = dict(plan.request.get("model") or {})
    model.pop("initial", None)
    ideal_hardware = trial.sensors == SensorSettings() and trial.actuator == ActuatorSettings()
    ideal_hardware = ideal_hardware and _has_no_disturbance(trial.testbed)
    same_model = model == seen or "residual_tip_deflection_on_model" in plan.summary
    if predicted is None or not same_model or not ideal_hardware:
        return ""
    if left <= predicted * (1.0 + _ALLOWED) + _ZERO_RESIDUAL:
        return ""
    return (
        f"the flight left {left:.3g} m at the tip, the plan predicts {predicted:.3g} m on "
        "the same bench: does the active controller have the gains that the plan assumes?"
    )


def _has_no_disturbance(testbed: Testbed) -> bool:
    """Return whether nothing but its drives moves a testbed after the start."""
    model = testbed.model()
    return not (model.outside or model.appendages.instruments)
