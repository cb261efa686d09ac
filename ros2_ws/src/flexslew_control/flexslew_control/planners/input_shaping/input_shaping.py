"""The planner that shapes a rigid command such that the appendages end at rest."""

from typing import Any

import numpy as np

from flexslew_control.plan import Plan
from flexslew_control.planners.entry import PlannerEntry, Variant
from flexslew_control.planners.input_shaping.section import Command, InputShaping, ShapedBy
from flexslew_control.planners.input_shaping.shaped_modes import modes_of_file
from flexslew_control.planners.input_shaping.shaped_motion import (
    FINE,
    clamped_frequencies,
    mean_efforts,
    nominal_motion,
)
from flexslew_control.planners.input_shaping.shaped_trajectory import plan_shaped_trajectory
from flexslew_control.planners.progress import Progress
from flexslew_control.planners.slew import Slew, plan_on_ticks, require_effort, tick_times
from flexslew_control.planners.slewing import SlewPlanner
from flexslew_control.planners.trajectories import PROFILES
from flexslew_control.planners.trajectory_file import points_of_file
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import Trust
from flexslew_plant.settings import plain, validated


def plan_input_shaping(settings: InputShaping, slew: Slew, progress: Progress) -> Plan:
    """Return the shaped slew; see make_plan.

    What is shaped is the drive of the modes, so they end at rest although the joints that turn
    them move; see contract.Shaped. The effort moves joints and modes together, so the frequencies
    to shape are those with the joints held.

    Raises:
        BadInput: a shaper that cannot be, or nothing to turn.
        ExcessTorque: the slew needs more effort than the drives have.
    """
    if slew.static:
        raise BadInput("plan: goal: the joints are there already; give another goal")
    model = slew.model
    shaped = ShapedBy.of(settings, [(w, settings.damping) for w in clamped_frequencies(model)])
    shaper = shaped.shaper
    duration = settings.duration + shaper.duration
    ticks = tick_times(settings.start, duration, slew.period)
    h = slew.period / FINE
    t: Vector = h * np.arange(FINE * (len(ticks) - 1) + 1, dtype=np.float64)
    path, rate = np.zeros(t.size), np.zeros(t.size)
    for at, amplitude in zip(shaper.times, shaper.amplitudes, strict=True):
        p, dp = command_profile(settings.command, (t - at) / settings.duration)
        path += amplitude * p
        rate += amplitude * dp / settings.duration
    try:
        q, v = nominal_motion(slew, path, rate, h)
    except BadInput as error:
        raise BadInput(f"plan: goal: {error}") from None
    effort = mean_efforts(model, q, v, h)
    peak = np.abs(effort).max(axis=0)
    words = "the shaped slew needs {:.4g} N m on {}, the limit is {:g} N m"
    require_effort(peak, slew.effort_limit, model.joint_names, words)
    m = model.joints
    q, v = q[::FINE], v[::FINE]
    summary = {
        "duration": duration,
        **shaped.summary,
        "modal_residual": [
            float(np.hypot(q[-1, j], v[-1, j] / w))
            for j, w in enumerate(clamped_frequencies(model), m)
        ],  # amplitude left in every mode, joints held [m]
        "peak_effort": peak.tolist(),
    }
    reference = q[:, :m].copy(), v[:, :m].copy()
    return plan_on_ticks(settings, slew, reference, effort, summary, np.hstack((q, v)))


def command_profile(name: Command, s: Vector) -> tuple[Vector, Vector]:
    """Return p and p' of a unit command from 0 to 1 over 0 <= s <= 1, at rest outside.

    sin2 starts and stops with sin^2 pulses of a third each and coasts between them; bang_bang
    is the rigid body's time-optimal command; the others are those of rest_to_rest.
    """
    x = np.clip(s, 0.0, 1.0)
    if name == "bang_bang":
        late = x > 0.5
        p = np.where(late, 1 - 2 * (1 - x) ** 2, 2 * x * x)
        rate = np.where(late, 4 * (1 - x), 4 * x)
    elif name == "sin2":
        a, b = _pulse(np.clip(3 * x, 0.0, 1.0)), _pulse(np.clip(3 * x - 2, 0.0, 1.0))
        p = 0.5 * (a[0] - b[0]) + 1.5 * np.clip(x - 1 / 3, 0.0, None)
        rate = 1.5 * (a[1] - b[1])
    else:
        p, rate = PROFILES[name](x)
    return p, np.where((s > 0.0) & (s < 1.0), rate, 0.0)


def _pulse(y: Vector) -> tuple[Vector, Vector]:
    """Return the integral of the rate that a pulse 2 sin^2(pi y) gains, and that rate (0 to 1)."""
    integral = y**2 / 2 - (1 - np.cos(2 * np.pi * y)) / (4 * np.pi**2)
    return integral, y - np.sin(2 * np.pi * y) / (2 * np.pi)


def with_files(settings: InputShaping, source: str, trust: Trust) -> InputShaping:
    """Return a section with the trajectory and the modes of its files; see PlannerEntry."""
    given: dict[str, Any] = {}
    if isinstance(settings.trajectory, str):
        given["trajectory"] = points_of_file(settings.trajectory, source, trust)
    if isinstance(settings.modes, str):
        given["modes"] = modes_of_file(settings.modes, source, trust)
    if not given:
        return settings
    changed: InputShaping = validated(InputShaping, {**plain(settings), **given}, source, trust)
    return changed


_SHAPED_TRAJECTORY = PlannerEntry(InputShaping, plan_shaped_trajectory, slews=False)
SHAPING = PlannerEntry(
    InputShaping,
    SlewPlanner(plan_input_shaping, exact=lambda s: s.shaper != "none"),
    with_files=with_files,
    instead=lambda s: _SHAPED_TRAJECTORY if s.trajectory is not None else None,
    variants=(Variant("zvd", {"shaper": "zvd"}),),
)
