"""A craft in three axes follows attitudes over time, as for a target on the ground, or spins.

Between the points body rates and accelerations are continuous; the efforts are those with which
the whole model follows, w x J w, modes and moving wheels included.
"""

from dataclasses import replace
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from flexslew_control.plan import Plan
from flexslew_control.planners.attitude.attitude_goal import AttitudeGoal, Triple
from flexslew_control.planners.attitude.attitude_path import (
    AttitudeMotion,
    Knot,
    completed,
    interpolate,
    spin_up,
    spinning,
)
from flexslew_control.planners.attitude.eigenaxis import (
    continuous,
    joint_coupling,
    tracking_efforts,
)
from flexslew_control.planners.checks.one_way import shared_out
from flexslew_control.planners.entry import PlannerEntry, PlanTask
from flexslew_control.planners.slew import (
    ExcessTorque,
    plan_on_ticks,
    slew_of,
    tick_times,
)
from flexslew_control.shared_keys import Initial, Start
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import Positive, plain, section
from flexslew_plant.testbeds.orientation.attitude import quaternion, rotation_vector

_ROUNDING = 1e-9  # of a limit


@section
class AttitudePoint:
    """An attitude at a time."""

    at: Positive  # after the start [s]
    # less than half a turn from the point before; `relative` and `to` start from there
    attitude: AttitudeGoal
    # body rates x y z there [rad/s]; null: at rest at the last point, else by the points around it
    rate: Triple | None = None


@section
class Spin:
    """A turn that goes on: about an axis of the body, which stays in space."""

    axis: Triple  # in body axes, of any length
    rate: float  # [rad/s]
    duration: Positive  # from rest to that rate [s]

    def __post_init__(self) -> None:
        """Refuse no axis, in words for the section's reader."""
        if not np.linalg.norm(self.axis) > 0.0:
            raise ValueError("axis must not be zero")

    @property
    def rates(self) -> Vector:
        """Along x y z of the body, shape (3,) [rad/s]."""
        axis = np.array(self.axis)
        rates: Vector = self.rate * axis / np.linalg.norm(axis)
        return rates


Profile = Annotated[tuple[AttitudePoint, ...], Field(max_length=10_000)]


@section
class AttitudeProfile:
    """A spacecraft in three axes follows attitudes over time, or spins up."""

    goal: ClassVar[dict[str, float]] = {}  # points and spin say it

    method: Literal["attitude_profile"] = "attitude_profile"
    points: Profile = ()  # in the order of their times; first the craft is at rest
    spin: Spin | None = None  # after the last point, where the craft is at rest; null: none
    # how long the plan lasts; a profile that ends in motion turns on until then, and needs it
    # to reach the run's end; null: until the last point [s]
    duration: Positive | None = None
    initial: Initial = None
    start: Start = 0.0

    @property
    def turns_until(self) -> float | None:
        """When the reference stops that turns at the plan's end [s]; None: it ends at rest."""
        last = self.points[-1].rate if self.points else None
        if self.spin is None and not any(last or ()):
            return None
        return self.start + (self.duration or 0.0)


def plan_attitude_profile(task: PlanTask) -> Plan:
    """Return the plan through the points and to the spin, which it keeps until its end.

    Raises:
        BadInput: no attitude in three axes, or points that are not in order.
        ExcessTorque: a drive has not what the profile needs.
        PlanFailed: the period is too long for the modes.
    """
    settings: AttitudeProfile = task.settings
    plant = task.plant
    slew = slew_of(settings, plant)
    model = plant.testbed.model()
    if model.attitude is None or model.gyros:
        raise BadInput(
            f"joints that turn the craft in three axes (wheels, torques or thrusters), not "
            f"{', '.join(model.joint_names)}; joint_trajectory follows points by joint",
            "plan",
            "method",
            settings.method,
        )
    knots = _knots(settings, quaternion(model.attitude.rotation_vector_of(slew.start)))
    duration = _duration(settings, knots[-1].at)
    ticks = tick_times(settings.start, duration, slew.period)
    motion = _motion(settings, knots, ticks)
    testbed: Any = plant.testbed
    rotation, coupling = continuous(rotation_vector(motion.attitude)), joint_coupling(testbed)
    axes = model.attitude.axes.T
    along = slew.start + (rotation - rotation[0]) @ coupling
    position = np.where(model.attitude.reads, rotation @ axes, along)
    position[0] = slew.start
    velocity = motion.rate @ axes + motion.rate @ coupling
    effort = tracking_efforts(model.with_time_zero(settings.start), position, velocity, slew.period)
    summary = {"duration": duration, "final_rate": motion.rate[-1].tolist()}
    request = {**plain(settings), "initial": slew.named(slew.start)}
    plan = plan_on_ticks(settings, slew, (position, velocity), effort, summary)
    plan = replace(plan, request=request)
    plan, used = shared_out(plan, plant, task.law)
    peak = np.abs(plan.effort).max(axis=0, initial=0.0)
    if used > 1.0 + _ROUNDING:
        joint = int((peak / slew.effort_limit).argmax())
        raise ExcessTorque(
            f"{model.joint_names[joint]} needs {used:.3g} times its limit, "
            f"{slew.effort_limit[joint]:g}; put points further apart, give the spin a longer "
            "duration, or ask for lower rates"
        )
    return replace(plan, summary={**plan.summary, "peak_effort": peak.tolist()})


def _knots(settings: AttitudeProfile, start: Vector) -> tuple[Knot, ...]:
    """Return the start and the points.

    Raises:
        BadInput: there are none and no spin, or times that do not rise, or a spin after motion.
    """
    points, zero = settings.points, np.zeros(3)
    if not points and settings.spin is None:
        raise BadInput("give points, a spin, or both", "plan", "points", [])
    for k, (one, other) in enumerate(pairwise(points)):
        if not other.at > one.at:
            words = f"later than the point before, {one.at:g} s"
            raise BadInput(words, "plan", f"points.{k + 1}.at", other.at)
    if settings.spin is not None and points and any(points[-1].rate or ()):
        words = "zero or left out: a spin starts from rest"
        raise BadInput(words, "plan", f"points.{len(points) - 1}.rate", points[-1].rate)
    knots = [Knot(0.0, start, zero)]
    for point in points:
        rate = None if point.rate is None else np.array(point.rate)
        knots.append(Knot(point.at, point.attitude.attitude(knots[-1].attitude), rate))
    if knots[-1].rate is None:
        knots[-1] = knots[-1]._replace(rate=zero)
    return completed(knots) if points else (knots[0],)


def _duration(settings: AttitudeProfile, last: float) -> float:
    """Return the duration of the plan [s].

    Raises:
        BadInput: if the plan ends before the last point or the spin, or if it turns on after the
            last point and the section gives no end.
    """
    spin_end = last + (settings.spin.duration if settings.spin is not None else 0.0)
    requested = settings.duration
    if requested is None and settings.turns_until is not None:
        words = "the craft turns on after the last point: give the time until the run's end [s]"
        raise BadInput(words, "plan", "duration", requested)
    if requested is not None and requested < spin_end:
        words = f"at least {spin_end:g} s, when the last point or the rate of the spin is reached"
        raise BadInput(words, "plan", "duration", requested)
    return spin_end if requested is None else requested


def _motion(settings: AttitudeProfile, knots: tuple[Knot, ...], ticks: Vector) -> AttitudeMotion:
    """Return attitudes and body rates at the ticks."""
    last = knots[-1]
    assert last.rate is not None
    before, after = ticks[ticks <= last.at], ticks[ticks > last.at] - last.at
    if settings.spin is None:
        rest = spinning(last.attitude, last.rate, after)
    else:
        rest = spin_up(last.attitude, settings.spin.rates, settings.spin.duration, after)
    if len(knots) == 1:
        motion = spinning(last.attitude, last.rate, before)
    else:
        motion = interpolate(knots, before)
    return AttitudeMotion(*(np.concatenate(rows) for rows in zip(motion, rest, strict=True)))


PROFILE = PlannerEntry(AttitudeProfile, plan_attitude_profile, slews=False)
