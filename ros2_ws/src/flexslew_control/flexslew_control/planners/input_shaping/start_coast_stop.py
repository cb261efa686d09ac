"""Start-coast-stop: sin^2 torques, two-impulse shaping, elastic tracking (Sung and Joo, (43))."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from pydantic import Field
from scipy.integrate import cumulative_simpson

from flexslew_control.plan import Plan
from flexslew_control.planners.attitude.attitude_goal import GoalKey
from flexslew_control.planners.entry import PlannerEntry
from flexslew_control.planners.input_shaping.shaped_motion import (
    FINE,
    clamped_frequencies,
    mean_efforts,
    nominal_motion,
)
from flexslew_control.planners.input_shaping.shapers import UNSHAPED, Shaper, make_shaper
from flexslew_control.planners.progress import Progress
from flexslew_control.planners.slew import Slew, plan_on_ticks, tick_times
from flexslew_control.planners.slewing import RESIDUAL_SHARE, SlewPlanner
from flexslew_control.planners.trajectories import rounded_up
from flexslew_control.shared_keys import DesignModel, Initial, Start
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds import Model


@section
class StartCoastStop:
    """A pulse of torque, a coast and the opposite pulse, each shaped."""

    method: Literal["start_coast_stop"] = "start_coast_stop"
    model: DesignModel = None
    initial: Initial = None
    goal: GoalKey = None
    start: Start = 0.0
    # amplitude T_amp of eq. (47), before shaping; null: 100 [N m]
    amplitude: Positive | None = None
    # total duration (pulses, coast and shaper) in place of the amplitude [s]
    duration: Positive | None = None
    pulse_frequency: Positive = 0.4  # frequency Omega of the pulses, eq. (47) [rad/s]
    # whose first frequency is shaped: clamped (joints held), system (joints free), or none; a
    # model without modes has none to shape
    shaper: Literal["clamped", "system", "none"] = "clamped"
    # damping ratio zeta of the shaper [-]
    shaper_damping: float = Field(default=0.0, ge=0.0, lt=1.0)
    # elastic (accounts for the elastic coordinates), rigid, or zero_order (rigid, its value at each
    # tick)
    feedforward: Literal["elastic", "rigid", "zero_order"] = "elastic"
    # whether every mode of the tracking model swings as the first does
    equal_frequencies: bool = False
    # how long after the end the reference's modes swing on [s]; then it is straight and at rest
    swing_on: NonNegative = 0.0


@dataclass(frozen=True)
class PulsePair:
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
        return self._pulse_rate(t) - self._pulse_rate(t - self.stop)

    def _pulse(self, t: Vector) -> Vector:
        active = (t > 0.0) & (t < self.length)
        return np.where(active, self.amplitude * np.sin(self.frequency * t) ** 2, 0.0)

    def _pulse_rate(self, t: Vector) -> Vector:
        s = np.clip(t, 0.0, self.length)
        omega = self.frequency
        return self.amplitude * (0.5 * s - np.sin(2.0 * omega * s) / (4.0 * omega))


_AMPLITUDE = 100.0  # unless it or the duration is given [N m]


def pulse_pair(angle: float, amplitude: float, frequency: float, inertia: float) -> PulsePair:
    """Return the pulses that turn a rigid inertia by `angle`, weaker where they would overlap.

    theta_c' = T t_0 / (2 I) (48), t_s = angle / theta_c' (49).

    Args:
        angle: positive or negative [rad].
        amplitude: T_amp [N m].
        frequency: Omega [rad/s].
        inertia: I [kg m^2].
    """
    length = np.pi / frequency
    acceleration = amplitude / inertia
    if abs(angle) < 0.5 * acceleration * length**2:
        acceleration = 2.0 * abs(angle) / length**2
    stop = 2.0 * abs(angle) / (acceleration * length) if acceleration > 0.0 else length
    return PulsePair(float(np.copysign(acceleration, angle)), frequency, float(stop))


def pulse_pair_in(angle: float, duration: float, frequency: float) -> PulsePair:
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
        alternative = ""
        if duration > 0.0:
            needed = rounded_up(2.0 * np.pi / duration)
            alternative = f" or a pulse_frequency of {needed:g} rad/s (now {frequency:g})"
        raise PlanFailed(
            f"two pulses of {length:.4g} s do not fit into {duration:.4g} s (the duration less the "
            f"shaper's); use a duration longer by {rounded_up(2.0 * length - duration):g} "
            f"s{alternative}"
        )
    stop = duration - length
    return PulsePair(2.0 * angle / (length * stop), frequency, stop)


def plan_start_coast_stop(settings: StartCoastStop, slew: Slew, progress: Progress) -> Plan:
    """Return the shaped start-coast-stop manoeuvre with its elastic states; see make_plan.

    The shaped pulses are the command that the joints follow such that the drive of every mode is
    shaped too (contract.Shaped), so the elastic tracking model (43) comes to rest with it. Their
    strength is that which turns the rigid inertia about the first joint that moves.

    Raises:
        BadInput: there is nothing to turn.
        PlanFailed: the feedforward is above the limit.
    """
    if slew.static:
        raise BadInput("plan: goal: the joints are there already; give another goal")
    model, joints = slew.model, slew.model.joints
    leader = int(np.flatnonzero(slew.goal - slew.start)[0])  # the pulses are its torque
    rest = model.rest(slew.named(slew.start))
    shaper = _shaper(model, rest, settings)
    delay = shaper.duration
    way, frequency = float((slew.goal - slew.start)[leader]), settings.pulse_frequency
    inertia = float(model.mass_matrix(rest)[leader, leader])
    if settings.duration is None:
        motion = pulse_pair(way, settings.amplitude or _AMPLITUDE, frequency, inertia)
    elif settings.amplitude is None:
        motion = pulse_pair_in(way, settings.duration - delay, frequency)
    else:
        raise BadInput("plan: amplitude and duration: only one of them may be given; leave one out")
    duration = motion.duration + delay
    ticks = tick_times(settings.start, duration + settings.swing_on, slew.period)
    h = slew.period / FINE
    t: Vector = np.arange(FINE * (len(ticks) - 1) + 1, dtype=np.float64) * h
    rate = shaper.shape(motion.rate, t)
    path = cumulative_simpson(rate, dx=h, initial=0.0)
    path_scale = abs(float(path[-1]))
    path, rate = path / path[-1], rate / path[-1]
    try:
        q, v = nominal_motion(slew, path, rate, h, settings.equal_frequencies)
    except BadInput as error:
        raise BadInput(f"plan: goal: {error}") from None
    over = FINE * (len(tick_times(settings.start, duration, slew.period)) - 1)
    q[over:, :joints], v[over:, :joints] = slew.goal, 0.0
    joint_mask = np.arange(model.coordinates) < joints
    coordinates = (q, v) if settings.feedforward == "elastic" else (q * joint_mask, v * joint_mask)
    effort = mean_efforts(model, *coordinates, h)
    if settings.feedforward == "zero_order":
        at = t[:-1:FINE]
        effort[:, leader] = inertia * shaper.shape(motion.acceleration, at) / path_scale * abs(way)
    peak = abs(effort).max(axis=0)
    if (peak > slew.effort_limit).any():
        raise PlanFailed(
            f"the feedforward reaches {peak.round(1).tolist()} N m, above the limit "
            f"{slew.effort_limit.tolist()}; give a smaller amplitude or pulse_frequency"
        )
    summary = {
        "duration": duration,
        "pulse_amplitude": abs(motion.amplitude) * inertia,
        "pulse_length": motion.length,
        "coast_end": motion.stop,
        "shaper_delay": delay,
        "peak_effort": [float(x) for x in peak],
        **_residual_summary(settings, slew, q[: over + 1], v[: over + 1]),
    }
    reference = q[::FINE, :joints].copy(), v[::FINE, :joints].copy()
    state = np.hstack((q[::FINE], v[::FINE]))
    return plan_on_ticks(settings, slew, reference, effort, summary, state)


def _residual_summary(settings: StartCoastStop, slew: Slew, q: Matrix, v: Matrix) -> dict[str, Any]:
    """Return for the summary how far the tips swing on after the end, and a warning if they do."""
    model, m = slew.model, slew.model.joints
    if settings.feedforward != "elastic" or not model.modes:
        return {}  # where the joints yield, the nominal modes are not those of the flight
    linear = model.linearise(model.rest(slew.named(slew.goal)))
    squares = np.diag(linear.stiffness)[m:] / np.diag(linear.mass)[m:]  # with the joints held
    tip = abs(model.appendages.tip)
    left = float((tip @ np.sqrt(q[-1, m:] ** 2 + v[-1, m:] ** 2 / squares)).max())
    if left <= RESIDUAL_SHARE * float((tip @ abs(q[:, m:].T)).max()):
        return {"tip_left_swinging": left}
    why = "nothing is shaped"
    if settings.shaper == "system":
        why = "shaper: system is for feedforward: rigid, where the joints yield to the modes"
    if settings.shaper == "clamped":
        why = "only the first mode is shaped, with the damping of shaper_damping"
    return {
        "tip_left_swinging": left,
        "warning": f"the tip vibrates by {left:.3g} m after the end: {why}",
    }


def _shaper(model: Model, rest: Vector, settings: StartCoastStop) -> Shaper:
    """Return the two impulses that cancel the first mode (50), or one."""
    if settings.shaper == "none" or not model.modes:
        return UNSHAPED
    if settings.shaper == "clamped":
        frequency = min(clamped_frequencies(model))
    else:
        frequency = float(model.linearise(rest).frequencies[0])
    return make_shaper("zv", frequency, settings.shaper_damping)


def _residual_reason(settings: StartCoastStop) -> str:
    """Return why the modes may be left to swing by a feedforward that does not move them."""
    if settings.feedforward == "elastic":
        return ""
    return f"feedforward: {settings.feedforward} has no part that moves the modes"


START_COAST_STOP = PlannerEntry(
    StartCoastStop,
    SlewPlanner(
        plan_start_coast_stop, exact=lambda s: s.feedforward == "elastic", rings=_residual_reason
    ),
)
