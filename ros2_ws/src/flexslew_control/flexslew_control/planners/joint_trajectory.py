"""A plan through given points, as trajectory_msgs/JointTrajectory and joint controllers have it.

Between two points each joint follows the polynomial that their derivatives leave: linear where
only positions are given, cubic with velocities, quintic with accelerations (the splines of the
joint_trajectory_controller of ros2_controllers).
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field
from scipy.interpolate import BPoly

from flexslew_control.plan import Plan
from flexslew_control.planners.attitude.attitude_path import body_rates
from flexslew_control.planners.entry import PlannerEntry, PlanTask
from flexslew_control.planners.input_shaping.shapers import UNSHAPED, Shaper
from flexslew_control.planners.slew import Slew, plan_on_ticks, slew_of, tick_times
from flexslew_plant.arrays import Matrix, Vector
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
    points, names = checked_points(settings.points, slew, "points")
    return plan_of_motion(settings, slew, motion_along(points, names, slew, settings.start), {})


class PointMotion(NamedTuple):
    """A motion through points, on the ticks."""

    position: Matrix  # (ticks + 1, joints) [rad or m]
    velocity: Matrix  # (ticks + 1, joints) [rad/s or m/s]
    effort: Matrix  # its mean over each tick, (ticks, joints) [N m or N]
    duration: float  # [s]

    @property
    def peak(self) -> Vector:
        """Largest efforts, shape (joints,) [N m or N]."""
        return np.asarray(np.abs(self.effort).max(axis=0, initial=0.0))


def plan_of_motion(settings: Any, slew: Slew, motion: PointMotion, summary: dict[str, Any]) -> Plan:
    """Return the plan of a motion through points, with more entries of its summary."""
    whole = {"duration": motion.duration, **summary, "peak_effort": motion.peak.tolist()}
    reference = motion.position, motion.velocity
    plan = plan_on_ticks(settings, slew, reference, motion.effort, whole)
    return replace(plan, request={**plain(settings), "initial": slew.named(slew.start)})


def motion_along(
    points: Sequence[TrajectoryPoint],
    names: Sequence[str],
    slew: Slew,
    start: float,
    shaper: Shaper = UNSHAPED,
) -> PointMotion:
    """Return the motion through points, convolved with a shaper; see plan_joint_trajectory.

    Args:
        points: from time 0 on, see checked_points.
        names: of the joints that they move.
        slew: the bench, and where the joints start.
        start: of the plan [s].
        shaper: impulses A_i at t_i: the motion is sum A_i q(t - t_i).
    """
    times = np.array([point.at for point in points])
    duration = float(times[-1]) + shaper.duration
    ticks = tick_times(start, duration, slew.period)
    position = np.tile(slew.start, (len(ticks), 1))
    velocity, mean = np.zeros_like(position), np.zeros_like(position[1:])
    for name in names:
        k = slew.model.joint_names.index(name)
        path = _path(points, times, name)
        efforts = np.array([point.effort.get(name, 0.0) for point in points])
        position[:, k] = 0.0
        for at, amplitude in zip(shaper.times.tolist(), shaper.amplitudes.tolist(), strict=True):
            q, v = _followed(path, ticks - at, points[0].velocity.get(name, 0.0), slew.period)
            position[:, k] += amplitude * q
            velocity[:, k] += amplitude * v
            mean[:, k] += amplitude * _means(times + at, efforts, ticks)
    attitude = slew.model.attitude
    if attitude is not None:
        phi, slope = attitude.rotation_vector_of(position), attitude.rotation_vector_of(velocity)
        velocity += (body_rates(phi, slope) - slope) @ attitude.axes.T
    return PointMotion(position, velocity, mean, duration)


def _path(points: Sequence[TrajectoryPoint], times: Vector, name: str) -> BPoly:
    """Return the piecewise polynomial of a joint through its points."""
    given = [
        [values[name] for q in _QUANTITIES if name in (values := getattr(point, q))]
        for point in points
    ]
    return BPoly.from_derivatives(times, given)


def _followed(path: BPoly, t: Vector, first_rate: float, period: float) -> tuple[Vector, Vector]:
    """Return position and velocity along a path at times t; at rest before it and at its end."""
    begin, end = path.x[0], path.x[-1]
    inside = np.clip(t, begin, end)
    rate: Vector = path.derivative()(inside)
    rate[t <= begin], rate[t >= end - _ON_TICK * period] = 0.0, 0.0
    rate[t == begin] = first_rate
    return path(inside), rate


def _means(times: Vector, efforts: Vector, ticks: Vector) -> Vector:
    """Return the mean over each tick of what is linear between points, and zero elsewhere."""
    edges = np.union1d(ticks, times[times < ticks[-1]])
    inside = (edges[1:] > times[0]) & (edges[:-1] < times[-1])
    samples, lengths = np.interp(edges, times, efforts), inside * np.diff(edges)
    impulses = 0.5 * (samples[1:] + samples[:-1]) * lengths
    begins = np.searchsorted(edges, ticks[:-1])
    return np.asarray(np.add.reduceat(impulses, begins) / np.diff(ticks))


def checked_points(
    points: Sequence[TrajectoryPoint], slew: Slew, key: str
) -> tuple[tuple[TrajectoryPoint, ...], tuple[str, ...]]:
    """Return points from time 0 on, where the joints rest unless one is there, and their joints.

    Args:
        points: as given.
        slew: the bench, and where the joints start.
        key: of the section that has them, for an error.

    Raises:
        BadInput: there is none, or one is not allowed; the error names its key.
    """
    if not points:
        raise BadInput("at least one, with `at` and `position`", "plan", key, [])
    try:
        names = _joints(points, slew)
        return _from_rest(points, names, slew), names
    except _WrongPoint as error:
        why, place, value = error.args
        raise BadInput(why, "plan", f"{key}.{place}", value) from None


def _joints(points: Sequence[TrajectoryPoint], slew: Slew) -> tuple[str, ...]:
    """Return the names of the joints of the trajectory after a check of every point.

    Raises:
        _WrongPoint: if a point is not allowed; the error names its key.
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
        _WrongPoint: their times do not rise, or end where they begin.
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


class _WrongPoint(Exception):
    """A point is not allowed: why, its number and key, and the value."""


def _wrong(number: int, key: str, value: Any, why: str) -> _WrongPoint:
    return _WrongPoint(why, f"{number}.{key}", value)


TRAJECTORY = PlannerEntry(
    JointTrajectory,
    plan_joint_trajectory,
    slews=False,
    example={"points": [{"at": 5.0, "position": {}}]},
)
