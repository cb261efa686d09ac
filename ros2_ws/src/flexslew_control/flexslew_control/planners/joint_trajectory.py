"""A plan through given points, as trajectory_msgs/JointTrajectory and joint controllers have it.

Between two points each joint follows the polynomial that their derivatives leave: linear where
only positions are given, cubic with velocities, quintic with accelerations (the splines of the
joint_trajectory_controller of ros2_controllers).
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field
from scipy.interpolate import BPoly

from flexslew_control.plan import Plan
from flexslew_control.planners.attitude.attitude_path import body_rates
from flexslew_control.planners.entry import PlannerEntry, PlanTask
from flexslew_control.planners.slew import Slew, plan_on_ticks, slew_of, tick_times
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.known_joints import ByJoint
from flexslew_plant.settings import NonNegative, plain, section

MOST_POINTS = 10_000
_ON_TICK = 1e-9  # of a tick, by which a point may be off it
_QUANTITIES = ("position", "velocity", "acceleration")


@section
class TrajectoryPoint:
    """Where joints are at a time; a joint that no point names stays where it is."""

    at: NonNegative  # after the start [s]
    position: ByJoint[float]  # [rad or m]
    # of all joints of the trajectory, or of none
    velocity: ByJoint[float] = Field(default_factory=dict)  # [rad/s or m/s]
    acceleration: ByJoint[float] = Field(default_factory=dict)  # [rad/s^2 or m/s^2]
    effort: ByJoint[float] = Field(default_factory=dict)  # feedforward [N m or N]


Points = Annotated[tuple[TrajectoryPoint, ...], Field(max_length=MOST_POINTS)]


@section
class JointTrajectory:
    """A motion through given points with given efforts, as a JointTrajectory message."""

    goal: ClassVar[dict[str, float]] = {}  # the points say it

    method: Literal["joint_trajectory"] = "joint_trajectory"
    points: Points = ()  # in the order of their times; first the joints rest, unless one is at 0
    initial: ByJoint[float] | None = None  # where joints start [rad or m]; null: as the testbed
    start: NonNegative = 0.0  # [s]


def plan_joint_trajectory(task: PlanTask) -> Plan:
    """Return the plan through the points, held at the last one.

    Efforts are linear between the points and zero where none are given; the plan has their mean
    over each tick. Joints that read an attitude follow polynomials of its rotation vector; their
    rates are the body rates of that motion.

    Raises:
        BadInput: no such joint, points that are not in order or not whole, a last point that still
            moves, or an effort beyond the limit.
    """
    settings: JointTrajectory = task.settings
    slew = slew_of(settings, task.plant, task.feedback)
    if not settings.points:
        raise BadInput("at least one, with `at` and `position`", "plan", "points", [])
    names = _joints(settings.points, slew)
    points = _from_rest(settings.points, names, slew)
    times = np.array([point.at for point in points])
    ticks = tick_times(settings.start, float(times[-1]), slew.period)
    position = np.tile(slew.start, (len(ticks), 1))
    velocity, mean = np.zeros_like(position), np.zeros_like(position[1:])
    clipped = np.clip(ticks, times[0], times[-1])
    for name in names:
        k = slew.model.joint_names.index(name)
        position[:, k], velocity[:, k] = _interpolate(points, times, clipped, name)
        efforts = np.array([point.effort.get(name, 0.0) for point in points])
        mean[:, k] = _means(times, efforts, ticks)
    attitude = slew.model.attitude
    if attitude is not None:
        phi, slope = attitude.rotation_vector_of(position), attitude.rotation_vector_of(velocity)
        velocity += (body_rates(phi, slope) - slope) @ attitude.axes.T
    summary = {
        "duration": float(times[-1]),
        "peak_effort": np.abs(mean).max(axis=0, initial=0.0).tolist(),
    }
    request = {**plain(settings), "initial": slew.named(slew.start)}
    plan = plan_on_ticks(settings, slew, (position, velocity), mean, summary)
    return replace(plan, request=request)


def _interpolate(
    points: Sequence[TrajectoryPoint], times: Vector, ticks: Vector, name: str
) -> tuple[Vector, Vector]:
    """Return position and velocity of a joint at the ticks; at rest at the end."""
    given = [
        [values[name] for q in _QUANTITIES if name in (values := getattr(point, q))]
        for point in points
    ]
    path = BPoly.from_derivatives(times, given)
    rate: Vector = path.derivative()(ticks)
    rate[0], rate[-1] = points[0].velocity.get(name, 0.0), 0.0
    return path(ticks), rate


def _means(times: Vector, efforts: Vector, ticks: Vector) -> Vector:
    """Return the mean over each tick of what is linear between points, and zero after the last."""
    at = np.interp(ticks, times, efforts)
    means: Vector = 0.5 * (at[:-1] + at[1:])
    intervals = np.searchsorted(ticks, times, side="right") - 1
    for k in np.unique(intervals[intervals < len(means)]).tolist():
        begin, end = ticks[k], ticks[k + 1]
        slack = _ON_TICK * (end - begin)
        knots = times[(times > begin + slack) & (times < end - slack)]
        if knots.size:
            edges = np.unique(np.concatenate(([begin], knots, [min(end, times[-1])])))
            samples = np.interp(edges, times, efforts)
            means[k] = 0.5 * (samples[1:] + samples[:-1]) @ np.diff(edges) / (end - begin)
    return means


def _joints(points: Sequence[TrajectoryPoint], slew: Slew) -> tuple[str, ...]:
    """Return the names of the joints of the trajectory after a check of every point.

    Raises:
        BadInput: if a point is not allowed; the error names its key.
    """
    names = tuple(points[0].position)
    limit = dict(zip(slew.model.joint_names, slew.effort_limit.tolist(), strict=False))
    for k, point in enumerate(points):
        for key in (*_QUANTITIES, "effort"):
            given: dict[str, float] = getattr(point, key)
            if set(given) != set(names) and (given or key == "position"):
                words = f"name {', '.join(names) or 'a joint'} as in the first point"
                raise _wrong(k, key, sorted(given), words)
        for name, value in point.effort.items():
            if abs(value) > limit.get(name, np.inf):
                raise _wrong(k, f"effort.{name}", value, f"at most {limit[name]:g}")
        if point.acceleration and not point.velocity:
            raise _wrong(k, "velocity", {}, "accelerations need velocities")
    if any(points[-1].velocity.values()):
        words = "zero at the last point: it is held"
        raise _wrong(len(points) - 1, "velocity", points[-1].velocity, words)
    return names


def _from_rest(
    points: Sequence[TrajectoryPoint], names: tuple[str, ...], slew: Slew
) -> tuple[TrajectoryPoint, ...]:
    """Return the points from time 0 on, where without one of them the joints are at rest.

    Raises:
        BadInput: their times do not rise, or end where they begin.
    """
    for k, (one, other) in enumerate(pairwise(points)):
        if not other.at > one.at:
            raise _wrong(k + 1, "at", other.at, f"later than the point before, {one.at:g} s")
    if points[-1].at == 0.0:
        raise _wrong(0, "at", 0.0, "above 0 s at the last point: joints do not jump")
    if points[0].at == 0.0:
        return tuple(points)
    here = slew.named(slew.start)
    zeros = dict.fromkeys(names, 0.0)
    rest = TrajectoryPoint(at=0.0, position={name: here[name] for name in names})
    if points[0].velocity:
        rest = replace(rest, velocity=zeros)
    if points[0].acceleration:
        rest = replace(rest, acceleration=zeros)
    return (rest, *points)


def _wrong(number: int, key: str, value: Any, why: str) -> BadInput:
    return BadInput(why, "plan", f"points.{number}.{key}", value)


TRAJECTORY = PlannerEntry(
    JointTrajectory,
    plan_joint_trajectory,
    slews=False,
    example={"points": [{"at": 5.0, "position": {}}]},
)
