"""Start-coast-stop with sin^2 torques, two-impulse shaping and the elastic tracking model (43)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from pydantic import Field
from scipy.integrate import cumulative_simpson
from scipy.linalg import expm

from flexslew_control.plan import Plan
from flexslew_control.planners.feedforward.gauss_newton import Progress
from flexslew_plant.arrays import Matrix, Vector, compiled
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.settings import NonNegative, Positive, plain, section
from flexslew_plant.testbeds import build_model
from flexslew_plant.testbeds.csa import CsaInitial, CsaTestbed
from flexslew_plant.testbeds.model import Model

_FINE = 4  # grid intervals a tick
_Function: TypeAlias = Callable[[Vector], Vector]


@section
class Goal:
    """Where the joints rest at the end."""

    base_yaw: float = float(np.pi / 6)  # [rad]
    hub_pitch: float = Field(default=0.5, gt=-1.5, lt=1.5)  # [rad]


@section
class StartCoastStop:
    """The `plan` section for method start_coast_stop."""

    method: Literal["start_coast_stop"] = "start_coast_stop"
    model: CsaTestbed = CsaTestbed(modes=1)  # what the planner believes
    initial: CsaInitial | None = None  # where the joints rest; null: as the model's `initial`
    goal: Goal = Goal()
    start: NonNegative = 0.0  # [s]
    amplitude: Positive | None = None  # T_amp of (47), before shaping; null: 100 [N m]
    duration: Positive | None = None  # instead: of it all, pulses, coast and shaper [s]
    pulse_frequency: Positive = 0.4  # Omega of (47) [rad/s]
    shaper: Literal["clamped", "system", "none"] = "clamped"  # whose first frequency is shaped
    shaper_damping: float = Field(default=0.0, ge=0.0, lt=1.0)  # zeta [-]
    feedforward: Literal["elastic", "rigid"] = "elastic"  # whether the effort moves q_d too


@dataclass(frozen=True)
class Pulses:
    """Unit-inertia motion under T sin^2(Omega t) for pi/Omega, and the same against it at t_s.

    Args:
        amplitude: T / I [rad/s^2].
        frequency: Omega [rad/s].
        stop: t_s, start of the second pulse [s].
    """

    amplitude: float
    frequency: float
    stop: float

    @property
    def length(self) -> float:
        """t_0, of one pulse [s] (47)."""
        return float(np.pi / self.frequency)

    @property
    def duration(self) -> float:
        """Of both pulses and the coast between them [s]."""
        return self.stop + self.length

    def acceleration(self, t: Vector) -> Vector:
        """Return the acceleration at the times t [rad/s^2]."""
        return self._pulse(t) - self._pulse(t - self.stop)

    def rate(self, t: Vector) -> Vector:
        """Return the rate [rad/s]; it coasts at T t_0 / (2 I) (48)."""
        return self._gained(t) - self._gained(t - self.stop)

    def _pulse(self, t: Vector) -> Vector:
        inside = (t > 0.0) & (t < self.length)
        return np.where(inside, self.amplitude * np.sin(self.frequency * t) ** 2, 0.0)

    def _gained(self, t: Vector) -> Vector:
        s = np.clip(t, 0.0, self.length)
        omega = self.frequency
        return self.amplitude * (0.5 * s - np.sin(2.0 * omega * s) / (4.0 * omega))


_AMPLITUDE = 100.0  # unless it or the duration is given [N m]


def pulses(angle: float, amplitude: float, frequency: float, inertia: float) -> Pulses:
    """Return the pulses that turn a rigid inertia by `angle`, weaker where they would overlap.

    theta_c' = T t_0 / (2 I) (48), t_s = angle / theta_c' (49).

    Args:
        angle: positive or negative [rad].
        amplitude: T_amp [N m].
        frequency: Omega [rad/s].
        inertia: I [kg m^2].
    """
    length = np.pi / frequency
    strength = amplitude / inertia
    if abs(angle) < 0.5 * strength * length**2:
        strength = 2.0 * abs(angle) / length**2
    stop = 2.0 * abs(angle) / (strength * length) if strength > 0.0 else length
    return Pulses(float(np.copysign(strength, angle)), frequency, float(stop))


def pulses_in(angle: float, duration: float, frequency: float) -> Pulses:
    """Return the pulses that turn by `angle` in the time given: T/I = 2 angle/(t_0 t_s).

    Args:
        angle: positive or negative [rad].
        duration: of pulses and coast [s].
        frequency: Omega [rad/s].

    Raises:
        PlanFailed: the pulses alone take longer.
    """
    length = np.pi / frequency
    if duration < 2.0 * length:
        raise PlanFailed(
            f"two pulses of {length:.4g} s do not fit into {duration:.4g} s (the duration less the "
            f"shaper's); use a duration longer by {2.0 * length - duration:.4g} s or a higher "
            f"pulse_frequency than {frequency:g} rad/s"
        )
    stop = duration - length
    return Pulses(2.0 * angle / (length * stop), frequency, stop)


def two_impulses(frequency: float, damping: float) -> tuple[float, float, float]:
    """Return A_1, A_2 and Delta T of the shaper that cancels one mode (50).

    K = exp(-zeta pi / sqrt(1 - zeta^2)), A_1 = 1/(1 + K), A_2 = K/(1 + K),
    Delta T = pi / (omega sqrt(1 - zeta^2)).

    Args:
        frequency: omega [rad/s].
        damping: zeta, below one [-].
    """
    root = float(np.sqrt(1.0 - damping**2))
    k = float(np.exp(-damping * np.pi / root))
    return 1.0 / (1.0 + k), k / (1.0 + k), float(np.pi / (frequency * root))


def start_coast_stop(
    settings: StartCoastStop,
    period: float,
    effort_limit: Vector | None = None,
    progress: Progress | None = None,
) -> Plan:
    """Return the shaped start-coast-stop manoeuvre with its elastic states.

    The pulses, shaped, are v = theta' cos(psi), rescaled such that theta reaches its goal; psi
    follows the same profile. That makes the drive of every mode, -m d/dt(cos(psi) theta'), a
    shaped function too, so M q_d'' + C q_d' + K q_d = -m v' (43) comes to rest with it.

    Args:
        settings: the `plan` section.
        period: one tick [s].
        effort_limit: of the drives, shape (joints,) [N m]; None: not checked.
        progress: never called, as nothing is iterated.

    Raises:
        BadInput: there is nothing to turn.
        PlanFailed: the feedforward is above the limit.
    """
    model = build_model(settings.model)
    joints = model.joints
    initial = settings.initial or settings.model.initial
    first = np.array([initial.base_yaw, initial.hub_pitch])
    last = np.array([settings.goal.base_yaw, settings.goal.hub_pitch])
    span = last - first
    if not span.any():
        raise BadInput("plan: goal: the joints are there already; give another goal")
    leader = 0 if span[0] != 0.0 else 1  # whose torque the pulses are
    rest = np.concatenate((first, np.zeros(model.modes)))
    shape, delay = _shaped(model, rest, settings)
    way, frequency = float(span[leader]), settings.pulse_frequency
    inertia = float(model.mass_matrix(rest)[leader, leader])
    if settings.duration is None:
        motion = pulses(way, settings.amplitude or _AMPLITUDE, frequency, inertia)
    elif settings.amplitude is None:
        motion = pulses_in(way, settings.duration - delay, frequency)
    else:
        raise BadInput("plan: amplitude and duration: only one of them may be given; leave one out")
    duration = motion.duration + delay
    ticks = int(np.ceil(duration / period - 1e-9))
    t: Vector = np.arange(_FINE * ticks + 1, dtype=np.float64) * (period / _FINE)
    rate, acceleration = shape(motion.rate)(t), shape(motion.acceleration)(t)
    q, v, a = _joint_motion(rate, acceleration, first, span, leader, period / _FINE)
    drive = a[:, 0] * np.cos(q[:, 1]) - v[:, 0] * v[:, 1] * np.sin(q[:, 1])
    flexible = _tracking_model(model, drive, period / _FINE)
    q, v, a = (np.hstack(pair) for pair in zip((q, v, a), flexible, strict=True))
    q[-1, :joints], v[-1, :joints] = last, 0.0
    effort = _mean_effort(model, q, v, a, settings.feedforward == "elastic")
    peak = abs(effort).max(axis=0)
    if effort_limit is not None and (peak > effort_limit).any():
        raise PlanFailed(
            f"the feedforward reaches {peak.round(1).tolist()} N m, above the limit "
            f"{effort_limit.tolist()}; give a smaller amplitude or pulse_frequency"
        )
    return Plan(
        method=settings.method,
        joint_names=model.joint_names,
        start=settings.start,
        period=period,
        position=q[::_FINE, :joints].copy(),
        velocity=v[::_FINE, :joints].copy(),
        effort=effort,
        state=np.hstack((q[::_FINE], v[::_FINE])),
        duration=duration,
        request=plain(settings),
        summary={
            "duration": duration,
            "pulse_amplitude": abs(motion.amplitude) * inertia,
            "pulse_length": motion.length,
            "coast_end": motion.stop,
            "shaper_delay": delay,
            "peak_effort": [float(x) for x in peak],
        },
    )


def _shaped(
    model: Model, rest: Vector, settings: StartCoastStop
) -> tuple[Callable[[_Function], _Function], float]:
    """Return the operator that shapes a function of time, and how much longer it makes it [s]."""
    if settings.shaper == "none":
        return (lambda function: function), 0.0
    linear = model.linearise(rest)
    if settings.shaper == "clamped":
        m = model.joints
        frequency = float(np.sqrt(np.min(np.diag(linear.stiffness)[m:] / np.diag(linear.mass)[m:])))
    else:
        frequency = float(linear.frequencies[0])
    a1, a2, delay = two_impulses(frequency, settings.shaper_damping)
    return (lambda function: lambda t: a1 * function(t) + a2 * function(t - delay)), delay


def _joint_motion(
    rate: Vector, acceleration: Vector, first: Vector, span: Vector, leader: int, h: float
) -> tuple[Matrix, Matrix, Matrix]:
    """Return q, v and a of the joints on the fine grid, each (times, 2).

    psi' = (psi span / leader's span) rate, theta' = s v / cos(psi) with the scale s that
    reaches the goal.
    """
    q, v, a = (np.zeros((rate.size, 2)) for _ in range(3))
    share = span[1] / span[leader]
    v[:, 1], a[:, 1] = share * rate, share * acceleration
    q[:, 1] = first[1] + cumulative_simpson(v[:, 1], dx=h, initial=0.0)
    q[:, 0] = first[0]
    if span[0] != 0.0:
        cosine, sine = np.cos(q[:, 1]), np.sin(q[:, 1])
        turned = cumulative_simpson(rate / cosine, dx=h, initial=0.0)
        scale = span[0] / turned[-1]
        v[:, 0] = scale * rate / cosine
        a[:, 0] = (scale * acceleration + v[:, 0] * sine * v[:, 1]) / cosine
        q[:, 0] += scale * turned
    return q, v, a


def _tracking_model(model: Model, drive: Vector, h: float) -> tuple[Matrix, Matrix, Matrix]:
    """Return q_d, q_d', q_d'' of M q'' + C q' + K q = -m drive (43), each (times, modes).

    Args:
        model: whose modes at psi = 0 give M, C, K and m.
        drive: d/dt(cos(psi) theta'), on the grid [rad/s^2].
        h: grid interval [s].
    """
    m, n = model.joints, model.coordinates
    linear = model.linearise(np.zeros(n))
    q, v, a = (np.zeros((drive.size, n - m)) for _ in range(3))
    for j in range(m, n):
        mass = linear.mass[j, j]
        spring, damper = linear.stiffness[j, j] / mass, linear.damping[j, j] / mass
        force = -linear.mass[0, j] / mass * drive
        # [q, q', force, force'] with the force linear over an interval: exact by expm
        matrix = np.zeros((4, 4))
        matrix[0, 1] = matrix[1, 2] = matrix[2, 3] = 1.0
        matrix[1, 0], matrix[1, 1] = -spring, -damper
        step = np.ascontiguousarray(expm(matrix * h)[:2])
        swing = _driven(step, force, h)
        q[:, j - m], v[:, j - m] = swing[:, 0], swing[:, 1]
        a[:, j - m] = force - spring * swing[:, 0] - damper * swing[:, 1]
    return q, v, a


@compiled
def _driven(step: Matrix, force: Vector, h: float) -> Matrix:
    """Return [q, q'] from rest at every grid point, shape (times, 2)."""
    out = np.zeros((force.size, 2))
    for k in range(force.size - 1):
        slope = (force[k + 1] - force[k]) / h
        for i in range(2):
            out[k + 1, i] = (
                step[i, 0] * out[k, 0]
                + step[i, 1] * out[k, 1]
                + step[i, 2] * force[k]
                + step[i, 3] * slope
            )
    return out


def _mean_effort(model: Model, q: Matrix, v: Matrix, a: Matrix, elastic: bool) -> Matrix:
    """Return the joints' rows of M a + h, averaged over each tick (Simpson), (ticks, joints)."""
    m = model.joints
    half = _FINE // 2
    at = []
    for k in range(0, len(q), half):
        x, rate, slope = q[k].copy(), v[k].copy(), a[k].copy()
        if not elastic:
            x[m:], rate[m:], slope[m:] = 0.0, 0.0, 0.0
        at.append((model.mass_matrix(x) @ slope + model.bias(x, rate))[:m])
    u = np.array(at)
    mean: Matrix = (u[:-2:2] + 4.0 * u[1:-1:2] + u[2::2]) / 6.0
    return mean
