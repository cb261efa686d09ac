"""The planner that shapes a rigid command such that the appendages end at rest."""

from collections.abc import Callable
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from pydantic import Field
from scipy.integrate import cumulative_simpson

from flexslew_control.plan import Plan
from flexslew_control.shapers import Shaper, ShaperName, convolved, make_shaper
from flexslew_control.slew_request import CsaGoal, CsaModel, software_versions, tick_times
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.csa import CsaInitial, CsaTestbed
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.model import Model
from flexslew_plant.settings import NonNegative, Positive, plain, section
from flexslew_plant.testbeds import build_model

Command: TypeAlias = Literal["cubic", "quintic", "sin2", "bang_bang"]
_FINE = 4  # grid intervals a tick


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


class _Motion(NamedTuple):
    """Joints and modes on the fine grid, each (times, coordinates)."""

    q: Matrix
    v: Matrix
    a: Matrix


def plan_input_shaping(
    settings: InputShaping, period: float, effort_limit: Vector, progress: Callable[[Any], None]
) -> Plan:
    """Return the shaped slew; see make_plan.

    The shaped command is v = theta' cos(psi): the modes are driven by -m dv/dt, so they end at
    rest although psi moves; the term that the complete model adds leaves a part of the swing
    then (summary: modal_residual). The command is rescaled such that theta reaches its goal.
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
    motion = _shaped_motion(model, settings, shaper, first, last, len(ticks), h)
    effort = _mean_effort(model, motion)
    peak = np.abs(effort).max(axis=0)
    for name, needed, allowed in zip(model.joint_names, peak, effort_limit, strict=True):
        if needed > allowed:
            longer = settings.duration * np.sqrt(needed / allowed)
            raise PlanFailed(
                f"the shaped slew needs {needed:.4g} N m on {name}, the limit is {allowed:g} N m; "
                f"a duration of about {longer:.4g} s (now {settings.duration:g} s) needs less"
            )
    m = model.joints
    q, v = motion.q[::_FINE], motion.v[::_FINE]
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
) -> _Motion:
    """Return joints and modes on the fine grid of h [s]."""
    t: Vector = h * np.arange(_FINE * (ticks - 1) + 1, dtype=np.float64)
    path, rate, slope = (np.zeros(t.size) for _ in range(3))
    for at, amplitude in zip(shaper.times, shaper.amplitudes, strict=True):
        p, dp, ddp = command_profile(settings.command, (t - at) / settings.duration)
        path += amplitude * p
        rate += amplitude * dp / settings.duration
        slope += amplitude * ddp / settings.duration**2
    q, v, a = (np.zeros((t.size, model.coordinates)) for _ in range(3))
    span = last - first
    q[:, 1], v[:, 1], a[:, 1] = first[1] + span[1] * path, span[1] * rate, span[1] * slope
    cosine, sine = np.cos(q[:, 1]), np.sin(q[:, 1])
    turned = cumulative_simpson(rate / cosine, dx=h, initial=0.0)
    scale = span[0] / turned[-1]
    q[:, 0], v[:, 0] = first[0] + scale * turned, scale * rate / cosine
    a[:, 0] = (scale * slope + v[:, 0] * sine * v[:, 1]) / cosine
    _swing(model, q, v, a, 2.0 * h)
    return _Motion(q, v, a)


def _swing(model: Model, q: Matrix, v: Matrix, a: Matrix, step: float) -> None:
    """Fill in the modes driven by the joints' motion, by RK4 over two grid intervals each."""
    m = model.joints
    masses = np.diag(model.mass_matrix(q[0]))[m:]

    def slope(k: int, modes: Vector, rates: Vector) -> Vector:
        x, r = np.append(q[k, :m], modes), np.append(v[k, :m], rates)
        coupling = model.mass_matrix(x)[m:, :m] @ a[k, :m]
        return np.asarray(-(coupling + model.bias(x, r)[m:]) / masses)

    for k in range(0, len(q) - 2, 2):
        y, w = q[k, m:].copy(), v[k, m:].copy()
        a1 = slope(k, y, w)
        a2 = slope(k + 1, y + step / 2 * w, w + step / 2 * a1)
        a3 = slope(k + 1, y + step / 2 * (w + step / 2 * a1), w + step / 2 * a2)
        a4 = slope(k + 2, y + step * (w + step / 2 * a2), w + step * a3)
        q[k + 2, m:] = y + step * w + step**2 / 6 * (a1 + a2 + a3)
        v[k + 2, m:] = w + step / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        a[k, m:] = a1
    a[-1, m:] = slope(len(q) - 1, q[-1, m:], v[-1, m:])


def _mean_effort(model: Model, motion: _Motion) -> Matrix:
    """Return the joints' rows of M a + h, averaged over each tick by Simpson's rule."""
    m = model.joints
    u = np.array(
        [
            (model.mass_matrix(q) @ a + model.bias(q, v))[:m]
            for q, v, a in zip(motion.q[::2], motion.v[::2], motion.a[::2], strict=True)
        ]
    )
    mean: Matrix = (u[:-2:2] + 4.0 * u[1:-1:2] + u[2::2]) / 6.0
    return mean
