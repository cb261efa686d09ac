"""The planner that shapes a rigid command such that the appendages end at rest."""

from collections.abc import Callable
from typing import Any, Literal, TypeAlias

import numpy as np
from pydantic import Field
from scipy.integrate import cumulative_simpson

from flexslew_control.plan import Plan
from flexslew_control.planners.input_shaping.shapers import (
    Shaper,
    ShaperName,
    convolved,
    make_shaper,
)
from flexslew_control.planners.slew import CsaGoal, CsaModel, software_versions, tick_times
from flexslew_plant.arrays import Matrix, Vector, compiled
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.settings import NonNegative, Positive, plain, section
from flexslew_plant.testbeds import build_model, dynamics
from flexslew_plant.testbeds.csa import CsaInitial, CsaTestbed
from flexslew_plant.testbeds.model import Model

Command: TypeAlias = Literal["cubic", "quintic", "sin2", "bang_bang"]
_FINE = 4  # grid intervals a tick
_STEEPEST = 1.5  # largest pitch [rad]


@section
class InputShaping:
    """The `plan` section for method input_shaping."""

    method: Literal["input_shaping"] = "input_shaping"
    model: CsaModel = CsaModel()
    initial: CsaInitial = CsaInitial()
    goal: CsaGoal = CsaGoal()
    start: NonNegative = 0.0  # [s]
    duration: Positive = 15.0  # of the command before shaping [s]
    command: Command = "quintic"
    shaper: ShaperName = "zv"
    frequencies: tuple[Positive, ...] = ()  # to shape [rad/s]; empty: the model's, joints held
    damping: float = Field(default=0.0, ge=0.0, lt=1.0)  # of the shaped modes [-]
    tolerance: float = Field(default=0.05, gt=0.0, lt=0.5)  # of the EI shapers [-]
    negative: bool = False  # whether negative impulses are accepted


def plan_input_shaping(
    settings: InputShaping, period: float, effort_limit: Vector, progress: Callable[[Any], None]
) -> Plan:
    """Return the shaped slew; see make_plan.

    What is shaped is the drive of the modes, -m w with w = d/dt(theta' cos psi) on the printed
    model and, with one more term, w = d/dt(theta' cos psi) - theta' psi' sin psi on the complete
    one, so they end at rest although psi moves. theta follows from w and reaches its goal.
    The effort moves joints and modes together, so the frequencies to shape are those with the
    joints held.

    Raises:
        BadInput: a shaper that cannot be, or nothing to turn.
        PlanFailed: the slew needs more effort than the drives have.
    """
    testbed = CsaTestbed(
        variant=settings.model.variant,
        modes=settings.model.modes,
        damping_ratio=settings.model.damping_ratio,
        parameters=settings.model.parameters,
    )
    model = build_model(testbed)
    first = np.array([settings.initial.base_yaw, settings.initial.hub_pitch])
    last = np.array([settings.goal.base_yaw, settings.goal.hub_pitch])
    if not (last - first).any():
        raise BadInput("plan: goal: the joints are there already; give another goal")
    for name, at in (("initial", first[1]), ("goal", last[1])):
        if not abs(at) <= _STEEPEST:
            raise BadInput(
                f"plan: {name}: hub_pitch: {at:g} is not allowed: input_shaping keeps within "
                f"-{_STEEPEST:g} and {_STEEPEST:g} rad, where yaw moves the appendages"
            )
    frequencies = settings.frequencies or clamped_frequencies(model)
    shaper = convolved(
        [
            make_shaper(settings.shaper, w, settings.damping, settings.tolerance, settings.negative)
            for w in frequencies
        ]
    )
    duration = settings.duration + shaper.duration
    ticks = tick_times(settings.start, duration, period)
    h = period / _FINE
    q, v = _shaped_motion(model, settings, shaper, first, last, len(ticks), h)
    effort = _efforts(model.kind, model.packed, q, v, h, model.joints)
    effort = effort.reshape(len(ticks) - 1, _FINE, -1).mean(axis=1)
    peak = np.abs(effort).max(axis=0)
    for name, needed, allowed in zip(model.joint_names, peak, effort_limit, strict=True):
        if needed > allowed:
            longer = settings.duration * np.sqrt(needed / allowed)
            raise PlanFailed(
                f"the shaped slew needs {needed:.4g} N m on {name}, the limit is {allowed:g} N m; "
                f"a duration of about {longer:.4g} s (now {settings.duration:g} s) needs less"
            )
    m = model.joints
    q, v = q[::_FINE], v[::_FINE]
    return Plan(
        method=settings.method,
        joint_names=model.joint_names,
        start=settings.start,
        period=period,
        position=q[:, :m].copy(),
        velocity=v[:, :m].copy(),
        effort=effort,
        state=np.hstack((q, v)),
        duration=duration,
        request=plain(settings),
        summary={
            "duration": duration,
            "shaper_delay": shaper.duration,
            "impulse_times": shaper.times.tolist(),
            "impulse_amplitudes": shaper.amplitudes.tolist(),
            "frequencies": [float(w) for w in frequencies],
            "sensitivity": shaper.sensitivity(frequencies[0], settings.damping, 0.3, 61).tolist(),
            "modal_residual": [
                float(np.hypot(q[-1, j], v[-1, j] / w))
                for j, w in enumerate(clamped_frequencies(model), m)
            ],  # amplitude left in every mode, joints held [m]
            "peak_effort": peak.tolist(),
        },
        versions=software_versions(),
    )


def clamped_frequencies(model: Model) -> tuple[float, ...]:
    """Return the frequencies of the modes with the joints held [rad/s]."""
    linear = model.linearise(np.zeros(model.coordinates))
    m = model.joints
    return tuple(
        float(w) for w in np.sqrt(np.diag(linear.stiffness)[m:] / np.diag(linear.mass)[m:])
    )


def command_profile(name: Command, s: Vector) -> tuple[Vector, Vector, Vector]:
    """Return p, p', p'' of a unit command from 0 to 1 over 0 <= s <= 1, at rest outside.

    sin2 starts and stops with sin^2 pulses of a third each and coasts between them; bang_bang
    is the rigid body's time-optimal command.
    """
    x = np.clip(s, 0.0, 1.0)
    inside = (s > 0.0) & (s < 1.0)
    if name == "cubic":
        p, rate, slope = x * x * (3 - 2 * x), 6 * x * (1 - x), 6 - 12 * x
    elif name == "quintic":
        p, rate = x**3 * (10 + x * (6 * x - 15)), 30 * x * x * (1 - x) ** 2
        slope = 60 * x * (1 - x) * (1 - 2 * x)
    elif name == "bang_bang":
        late = x > 0.5
        p = np.where(late, 1 - 2 * (1 - x) ** 2, 2 * x * x)
        rate, slope = np.where(late, 4 * (1 - x), 4 * x), np.where(late, -4.0, 4.0)
    else:
        first, second = np.clip(3 * x, 0.0, 1.0), np.clip(3 * x - 2, 0.0, 1.0)
        a, b = (_pulse(first), _pulse(second))
        p = 0.5 * (a[0] - b[0]) + 1.5 * np.clip(x - 1 / 3, 0.0, None)
        rate, slope = 1.5 * (a[1] - b[1]), 4.5 * (a[2] - b[2])
    return p, np.where(inside, rate, 0.0), np.where(inside, slope, 0.0)


def _pulse(y: Vector) -> tuple[Vector, Vector, Vector]:
    """Return the integral of the gained rate, that rate (0 to 1) and 2 sin^2(pi y)."""
    gained = y - np.sin(2 * np.pi * y) / (2 * np.pi)
    return (
        y**2 / 2 - (1 - np.cos(2 * np.pi * y)) / (4 * np.pi**2),
        gained,
        2 * np.sin(np.pi * y) ** 2,
    )


def _shaped_motion(
    model: Model,
    settings: InputShaping,
    shaper: Shaper,
    first: Vector,
    last: Vector,
    ticks: int,
    h: float,
) -> tuple[Matrix, Matrix]:
    """Return positions and rates of joints and modes on the fine grid of h [s].

    With k = 1 for the complete and 0 for the printed model
        theta' cos(psi)^(1 + k) = integral of w cos(psi)^k,
    which is zero at the end, as theta' must be, for one mixture w = alpha (p'' + beta p') of the
    shaped command's derivatives; alpha brings theta to its goal.
    """
    t: Vector = h * np.arange(_FINE * (ticks - 1) + 1, dtype=np.float64)
    path, rate = np.zeros(t.size), np.zeros(t.size)
    for at, amplitude in zip(shaper.times, shaper.amplitudes, strict=True):
        p, dp, _ = command_profile(settings.command, (t - at) / settings.duration)
        path += amplitude * p
        rate += amplitude * dp / settings.duration
    q, v = np.zeros((t.size, model.coordinates)), np.zeros((t.size, model.coordinates))
    span = last - first
    q[:, 1], v[:, 1] = first[1] + span[1] * path, span[1] * rate
    cosine, sine = np.cos(q[:, 1]), np.sin(q[:, 1])
    complete = settings.model.variant == "complete"
    lever = cosine if complete else np.ones(t.size)
    # the integral of lever p'' by parts: p'' jumps, p' does not
    slowing = sine * v[:, 1] if complete else np.zeros(t.size)
    first_part = lever * rate + cumulative_simpson(slowing * rate, dx=h, initial=0.0)
    second_part = cumulative_simpson(lever * rate, dx=h, initial=0.0)
    beta = -first_part[-1] / second_part[-1]
    turning = (first_part + beta * second_part) / (lever * cosine)
    turned = cumulative_simpson(turning, dx=h, initial=0.0)
    alpha = span[0] / turned[-1]
    q[:, 0], v[:, 0] = first[0] + alpha * turned, alpha * turning
    # the mean of w over each interval is exact, wherever p'' jumps
    drive = alpha / h * (np.diff(rate) + beta * np.diff(path))
    m = model.joints
    linear = model.linearise(np.zeros(model.coordinates))
    for j in range(m, model.coordinates):
        mass = linear.mass[j, j]
        spring, damper = linear.stiffness[j, j] / mass, linear.damping[j, j] / mass
        swing = _driven(spring, damper, -linear.mass[0, j] / mass * drive, h)
        q[:, j], v[:, j] = swing[:, 0], swing[:, 1]
    return q, v


@compiled
def _driven(spring: float, damper: float, force: Vector, h: float) -> Matrix:
    """Return [x, x'] of x'' + damper x' + spring x = force from rest, shape (intervals + 1, 2).

    Exact for a force that is constant over each interval of h [s]; underdamped.
    """
    decay = 0.5 * damper
    frequency = np.sqrt(spring - decay**2)
    shrink, c, s = np.exp(-decay * h), np.cos(frequency * h), np.sin(frequency * h) / frequency
    a, b = shrink * (c + decay * s), shrink * s
    e, d = -spring * b, shrink * (c - decay * s)
    out = np.zeros((force.size + 1, 2))
    for k in range(force.size):
        rest = force[k] / spring
        x, rate = out[k, 0] - rest, out[k, 1]
        out[k + 1, 0] = rest + a * x + b * rate
        out[k + 1, 1] = e * x + d * rate
    return out


@compiled
def _efforts(kind: int, p: Vector, q: Matrix, v: Matrix, h: float, joints: int) -> Matrix:
    """Return the joints' rows of M a + h, the mean over each interval of h [s].

    From the change of the rates over the interval, at the state midway: of second order, and with
    the right impulse where an acceleration jumps. Shape (intervals, joints).
    """
    n, m = q.shape[1], joints
    block, coupling, modal = np.empty((m, m)), np.empty((m, n - m)), np.empty(n - m)
    bias, x, out = np.empty(n), np.empty(2 * n), np.empty((len(q) - 1, m))
    for k in range(len(q) - 1):
        for i in range(n):
            x[i] = 0.5 * (q[k, i] + q[k + 1, i])
            x[n + i] = 0.5 * (v[k, i] + v[k + 1, i])
        dynamics.terms(kind, p, x, block, coupling, modal, bias)
        for i in range(m):
            total = bias[i] * h
            for j in range(m):
                total += block[i, j] * (v[k + 1, j] - v[k, j])
            for j in range(n - m):
                total += coupling[i, j] * (v[k + 1, m + j] - v[k, m + j])
            out[k, i] = total / h
    return out
