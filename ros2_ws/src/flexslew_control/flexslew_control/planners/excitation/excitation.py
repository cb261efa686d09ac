"""A plan that shakes the bench, so that a model can be identified from the log."""

from dataclasses import replace

import numpy as np

from flexslew_control.law import per_joint
from flexslew_control.plan import Plan
from flexslew_control.planners.entry import PlannerEntry, PlanTask
from flexslew_control.planners.excitation.experiments import Experiments, divide, signal
from flexslew_control.planners.excitation.limits import PredictedPeaks, scale_to_limits
from flexslew_control.planners.excitation.section import Excitation as Excitation
from flexslew_control.planners.slew import Slew, plan_on_ticks, slew_of
from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import plain
from flexslew_plant.testbeds.model import Model

_BELOW, _ABOVE = 0.4, 2.5  # default band, in parts of the lowest and the highest frequency


def plan_excitation(task: PlanTask) -> Plan:
    """Return the plan that shakes the joints in turn of phase, with the reference at rest.

    A multisine is orthogonal over the joints: as many experiments as joints, of whole periods each,
    so that the frequency responses of the joints can be separated line by line.

    Raises:
        BadInput: if there is no such joint, the band is empty, or the duration is less than two
            periods.
    """
    settings: Excitation = task.settings
    plant, feedback = task.plant, task.feedback
    whole = settings.model if settings.model is not None else plain(plant.testbed)
    slew = slew_of(replace(settings, model=whole), plant, feedback)
    model = slew.model
    joints = _joint_indices(settings, model)
    band = _band(settings, slew)
    parts = divide(settings, len(joints), band, slew.period)
    size = slew.effort_limit.size
    unit = np.zeros((parts.taper * 2 + parts.count * parts.repeated * parts.period, size))
    unit[:, joints] = signal(settings, parts, band, slew.period)
    unit = np.vstack((unit, np.zeros((parts.after, size))))
    if settings.amplitude is not None:
        names = tuple(model.joint_names[k] for k in joints)
        given = np.zeros(size)
        given[joints] = per_joint("plan: amplitude", settings.amplitude, names)
        effort, predicted = given * unit, None
        over = given > slew.effort_limit
        if over.any():
            name = model.joint_names[int(np.argmax(over))]
            raise BadInput(
                f"plan: amplitude: {given[over][0]:g} is not allowed: {name} has "
                f"{slew.effort_limit[over][0]:g}"
            )
    else:
        effort, predicted = scale_to_limits(settings, slew, unit * slew.effort_limit)
    return _plan(settings, slew, effort, band, parts, predicted)


def _joint_indices(settings: Excitation, model: Model) -> list[int]:
    names = settings.joints or model.joint_names
    unknown = [name for name in names if name not in model.joint_names]
    if unknown or len(set(names)) < len(names):
        wrong = unknown[0] if unknown else next(n for n in names if names.count(n) > 1)
        raise BadInput(
            f"plan: joints: {wrong} is not allowed: name each of "
            f"{', '.join(model.joint_names)} at most once"
        )
    return [model.joint_names.index(name) for name in names]


def _band(settings: Excitation, slew: Slew) -> tuple[float, float]:
    highest = np.pi / slew.period / 2.0
    if settings.band is not None:
        low, high = settings.band
        if not low < high <= highest:
            raise BadInput(
                f"plan: band: [{low:g}, {high:g}] is not allowed: the second must be larger, and "
                f"at most {highest:.4g} rad/s (four ticks a period)"
            )
        return low, high
    rest = slew.model.rest(slew.named(slew.start))
    frequencies = slew.model.linearise(rest).frequencies
    if not frequencies.size:
        raise BadInput("plan: band: is missing: the model has no modes that could set it")
    return _BELOW * float(frequencies[0]), min(_ABOVE * float(frequencies[-1]), highest)


def _plan(
    settings: Excitation,
    slew: Slew,
    effort: Matrix,
    band: tuple[float, float],
    parts: Experiments,
    predicted: PredictedPeaks | None,
) -> Plan:
    ticks = len(effort)
    peaks = np.abs(effort).max(axis=0)
    crest = [float(np.abs(c).max() / np.sqrt(np.mean(c**2))) if c.any() else 0.0 for c in effort.T]
    summary = {
        "duration": settings.duration,
        "band": list(band),
        "period": parts.period * slew.period,
        "periods": parts.repeated,
        "experiments": parts.count,
        "taper": parts.taper * slew.period,
        "peak_effort": peaks.tolist(),
        "crest_factor": crest,
        "believes": slew.beliefs,
    }
    if predicted is not None:
        summary |= {
            "predicted_peak_effort": slew.named(predicted.effort),
            "predicted_excursion": slew.named(predicted.excursion),
            "predicted_tip_deflection": predicted.tip,
        }
    rest = np.tile(slew.start, (ticks + 1, 1))
    plan = plan_on_ticks(settings, slew, (rest, np.zeros_like(rest)), effort, summary)
    model, initial = plain(slew.testbed), slew.named(slew.start)
    return replace(plan, request={**plain(settings), "model": model, "initial": initial})


EXCITATION = PlannerEntry(Excitation, plan_excitation, slews=False)
