"""What a plan about one axis leaves on the whole bench: all modes, all axes, the free platform.

A planner turns a spacecraft about one axis on some of its modes. The plan is flown once more, in
process and before anybody adopts it, on the equations that the bench itself integrates: efforts
held over every tick, the law in charge with its estimator, the limits of the drives.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.controllers import PD_FEEDFORWARD, build_controller
from flexslew_control.law import ActiveLaw, PlantDescription, per_joint
from flexslew_control.plan import Plan, with_warning
from flexslew_control.planners.residual.motors import Matrices, at_once, motor_step
from flexslew_control.planners.residual.prediction import (
    MAX_MONITOR_TICKS,
    MIN_MONITOR_TIME,
    Prediction,
)
from flexslew_control.planners.slew import Feedback, Slew
from flexslew_control.plans.known_motion import ATTITUDE_ERROR, PREDICTED
from flexslew_plant.arrays import Vector, read_only
from flexslew_plant.errors import BadInput
from flexslew_plant.hardware.sensors import Sensors, SensorSettings, exact_readings
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds import Testbed, initial_state, starts_in_motion
from flexslew_plant.testbeds.integration_error import steps_per_tick

_NAME = "in_charge"  # of the controller
TIP_FLOOR = 1e-5  # residual of the tips that counts as none [m]
_MORE, _SEEN = 1.001, 1e-6  # beyond which what is left has grown [-], [m, rad]
_ALLOWED = 0.1  # more than on the planner's own model [-]


class Better(NamedTuple):
    """A plan on other modes that leaves less."""

    modes: int  # frequencies that it counts with
    prediction: Prediction


def as_predicted(plan: Plan, bench: Prediction) -> bool:
    """Return whether a plan leaves the bench as still as it has been promised so far."""
    on_model = float(plan.summary[PREDICTED])
    return bench.tip_deflection <= (1.0 + _ALLOWED) * on_model + TIP_FLOOR


def with_bench_residual(
    plan: Plan,
    plant: PlantDescription,
    bench: Prediction,
    better: Better | None = None,
    hint: str = "no plan about one axis on more modes leaves less than half",
) -> Plan:
    """Return the plan with what it leaves on the bench, and a warning if that is more.

    Args:
        plan: with what it leaves on the model that it is made on.
        plant: what stands on the bench.
        bench: what it leaves there.
        better: what would leave less; None: no plan that was tried.
        hint: in words, where there is none.
    """
    on_model = plan.summary[PREDICTED]
    if better is not None:
        left = better.prediction.tip_deflection
        hint = f"model: {{modes: {better.modes}}} leaves {left:.3g} m"
    words = (
        f"on the whole bench it leaves {bench.tip_deflection:.3g} m at the tips, on the model "
        f"that it is made on {on_model:.3g} m; {hint}"
    )
    return _with_residual(plan, plant, bench, "residual_tip_deflection_on_model", words)


def _with_residual(
    plan: Plan, plant: PlantDescription, found: Prediction, key: str, words: str
) -> Plan:
    """Return the plan with its residual, and with a warning if that is more than before."""
    errors = dict(zip(plant.joint_names, found.attitude_error.tolist(), strict=True))
    values: dict[str, Any] = {PREDICTED: found.tip_deflection, ATTITUDE_ERROR: errors}
    values[key] = plan.summary[PREDICTED]
    changed = replace(plan, summary={**plan.summary, **values})
    return changed if as_predicted(plan, found) else with_warning(changed, words)


def without_simulation(plan: Plan) -> Plan:
    """Return a plan about one axis with a warning that no law has flown it on the whole bench."""
    words = "not flown on the whole bench: what it leaves is that of the planner's own model"
    return with_warning(plan, words)


def with_law_residual(
    plan: Plan, plant: PlantDescription, found: Prediction, law: ActiveLaw, hint: str = ""
) -> Plan:
    """Return the plan with what it leaves where a law flies it, and a warning if that is more.

    Args:
        plan: with what it leaves under the joint feedback that the planner counts with.
        plant: what stands on the bench.
        found: what it leaves under the law.
        law: that flies it.
        hint: what would leave less, after a semicolon; empty: nothing that was tried.
    """
    words = (
        f"flown by {law.law} it leaves {found.tip_deflection:.3g} m at the tips, by the joint "
        f"feedback that the planner counts with {plan.summary[PREDICTED]:.3g} m{hint}"
    )
    return _with_residual(plan, plant, found, "residual_tip_deflection_by_joint_feedback", words)


def is_joint_feedback(law: ActiveLaw, slew: Slew) -> bool:
    """Return whether a law is the joint feedback that the planner counts with, and nothing else."""
    if law.law != PD_FEEDFORWARD.name or set(law.settings) - {"kp", "kd"}:
        return False
    gains: Any = PD_FEEDFORWARD.settings(**law.settings)
    names = slew.model.joint_names
    kp, kd = (per_joint("gains", tuple(np.atleast_1d(g)), names) for g in (gains.kp, gains.kd))
    return bool((kp == slew.kp).all() and (kd == slew.kd).all())


def ignored_settings(law: ActiveLaw) -> str:
    """Return in one line what a law does beyond kp and kd joint by joint; empty: nothing."""
    if law.law != PD_FEEDFORWARD.name:
        return f"kp and kd of the joints alone instead of {law.law}"
    more = [k for k, v in law.settings.items() if k not in ("kp", "kd") and v not in (None, False)]
    return f"{law.law} without {', '.join(sorted(more))}" if more else ""


def simulate_on_bench(
    plan: Plan,
    plant: PlantDescription,
    law: ActiveLaw,
    testbed: Testbed | None = None,
    motors: Matrices | None = None,
    start: Vector | None = None,
) -> Prediction | None:
    """Return the residuals of a plan that a law flies; None: it cannot fly it, or not twice.

    The law's own controller flies it in this process, with motors and sensors without errors but
    delays and gaps. It is active from the plan's start on, at rest where the plan begins; where the
    testbed starts in motion, from tick 0 on with this motion.

    Args:
        plan: for all joints of the bench.
        plant: what stands on the bench, and what the law is designed for.
        law: of the controller in charge.
        testbed: that is flown, in the bench's time; None: the bench's.
        motors: from commands to efforts; None: they give at once what is commanded.
        start: state [q, v] at the plan's start; None: as above.
    """
    try:
        controller = build_controller(_NAME, law.law, dict(law.settings), plant, "plan")
    except BadInput:  # reported where the controllers are built
        return None
    bench = plant.testbed if testbed is None else testbed
    before = plan.first_tick if start is None and starts_in_motion(bench) else 0
    if controller.adopt(replace(plan, start=before * plan.period)) or controller.reason:
        return None
    if getattr(controller.law, "flight_only", False):
        return None
    model = bench.model()
    names, limit, tip = plant.joint_names, plant.effort_limit, model.appendages.tip
    least = -limit
    least[list(model.one_way)] = 0.0
    rest = model.rest(dict(zip(names, plan.position[0].tolist(), strict=True)))
    x = np.concatenate((rest, np.zeros(model.coordinates)))
    if start is not None:
        x = start
    elif starts_in_motion(bench):
        x = initial_state(bench)
    sensors = Sensors(SensorSettings(), model, plan.period)
    last = before + int(np.ceil(plan.duration / plan.period - 1e-9))
    poles = model.integrated_poles(rest)
    steps = steps_per_tick(poles, plan.period, plan.duration + MIN_MONITOR_TIME)
    effort = np.zeros(limit.size)
    motors = motors or at_once(limit.size)
    late = np.zeros(len(motors[0]))
    deflection, peak, errors = 0.0, 0.0, np.zeros(len(names))
    last_effort, after = max(before + len(plan.effort), last), MIN_MONITOR_TIME / plan.period
    increase, k = 0, -1
    while (k := k + 1) <= last_effort + np.ceil(after):
        now = plan.start + (k - before) * plan.period
        seen = sensors.read(exact_readings(model, x, effort, now), x)
        tip_size = _largest(tip @ model.modal_state(x)[0])
        peak = max(peak, tip_size)
        if k >= last:
            left = abs(model.joint_error(seen.joint_position, plan.position[-1]))
            if tip_size > _MORE * deflection + _SEEN or (left > _MORE * errors + _SEEN).any():
                increase = k - last_effort
            deflection, errors = max(deflection, tip_size), np.maximum(errors, left)
            if k == last_effort + np.ceil(after) and 2 * increase > after:  # it is still growing
                after = max(after, min(2.0 * after, MAX_MONITOR_TICKS))
        if not np.isfinite(peak):  # before the end, too
            deflection, errors = np.inf, np.full(len(names), np.inf)
            break
        answer = controller.observe(Measurement(k, 0, now, _NAME, *seen, read_only(effort)))
        if answer is None:  # it has failed on the way
            return None
        effort = np.clip(answer.command.effort, least, limit)
        motor_step(motors, late, effort)
        x = model.advance(x, effort, plan.period, steps, now)
    return Prediction(deflection, errors, peak)


def by_feedback(feedback: Feedback) -> ActiveLaw:
    """Return the joint feedback with these gains as a law."""
    return ActiveLaw(PD_FEEDFORWARD.name, {"kp": list(feedback.kp), "kd": list(feedback.kd)})


def _largest(values: Vector) -> float:
    """Return the largest |value|; infinite where the flight has diverged."""
    largest = float(np.abs(values).max(initial=0.0))
    return largest if np.isfinite(largest) else np.inf
