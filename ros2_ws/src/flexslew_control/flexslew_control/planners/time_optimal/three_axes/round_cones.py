"""The fastest turn that keeps out of the cones of `keep_out`, and below a rate, on pieces.

Each side of a cone may hold a slew of its own, and programs never go from one to the other. So they
start from paths on both sides of every cone, and from the slew that no cone keeps away.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from flexslew_control.planners.attitude.attitude_path import Knot, completed, interpolate
from flexslew_control.planners.progress import Progress
from flexslew_control.planners.time_optimal.three_axes.fastest_turns import (
    PIECES,
    STEPS,
    MinimumTimeSlew,
    Start,
    equal_pieces_slew,
    from_starts,
    means,
    minimum_time_rigid,
    minimum_time_with_modes,
)
from flexslew_control.planners.time_optimal.three_axes.path_limits import PathLimits
from flexslew_control.planners.time_optimal.three_axes.reorientation import Reorientation
from flexslew_control.planners.time_optimal.three_axes.sequential_programs import (
    LocalOptimum,
    local_minimum_time,
)
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import PlanFailed
from flexslew_plant.testbeds.contract import Cone
from flexslew_plant.testbeds.orientation.attitude import product, quaternion, to_inertial

_CHECK_PIECES = 120  # pieces of a free slew
_CONE_MARGIN = 0.3  # from the edge of a cone that a start goes round [rad]
_MIN_SHARE = 0.2  # share of the way at which it passes the cone, and as late from the end
_NONE = 1e-9  # length of a vector without a direction
_POINTS = 25  # of the way, one of which is nearest to a cone
_FIRST_MARGIN = 1e-3  # spare of the path's limits [rad, -]
_MAX_MARGIN_STEPS = 4  # how often it may grow


def require_free_ends(limits: PathLimits, slew: Reorientation) -> None:
    """Check that start and goal are within the limits.

    Raises:
        PlanFailed: if one of them is beyond a limit; the message gives by how much.
    """
    ends = limits.excess(slew.model, np.array([slew.start, slew.rest]))
    for name, (first, last) in zip(limits.names, ends.T, strict=True):
        if max(first, last) > 0.0:
            where = "start" if first > 0.0 else "goal"
            key = "initial" if first > 0.0 else "goal"
            words = f"plan: {key}: the {where} looks into {name}, by {max(first, last):.3g} rad"
            raise PlanFailed(words)


def minimum_time_rigid_limited(
    limits: PathLimits, rigid_slew: Reorientation, progress: Progress
) -> MinimumTimeSlew:
    """Return the fastest slew of a craft without modes that keeps to limits at the pieces' ends.

    Raises:
        PlanFailed: no start leads to one.
    """
    free = minimum_time_rigid(rigid_slew, progress)
    if not limits.names:
        return free
    states = rigid_slew.states(*_on_pieces(free, _CHECK_PIECES))
    if limits.excess(rigid_slew.model, states).max() <= 0.0:
        return free
    body = replace(rigid_slew, limits=limits)
    found = from_starts(body, progress, starts_round(body, free))
    return equal_pieces_slew(body, found[0], len(found))


def minimum_time_limited(
    limits: PathLimits,
    slew: Reorientation,
    rigid_slew: Reorientation,
    free: MinimumTimeSlew,
    on_ticks: Callable[[MinimumTimeSlew], tuple[Matrix, Matrix]],
    progress: Progress,
) -> tuple[MinimumTimeSlew, Matrix, Matrix]:
    """Return the fastest slew that keeps to the limits at all ticks, and its states and efforts.

    The programs check the ends of the pieces, with a spare for the excess between them.

    Args:
        limits: limits of the path.
        slew: the slew.
        rigid_slew: the same without modes.
        free: its fastest slew without limits.
        on_ticks: returns the states at the ticks and the efforts of a slew.
        progress: called after every start.

    Raises:
        PlanFailed: if no slew does.
    """
    margin, local = _FIRST_MARGIN, None
    for _ in range(_MAX_MARGIN_STEPS):
        tight_limits = replace(limits, margin=margin)
        body = replace(rigid_slew, limits=tight_limits)
        if local is None:
            found = from_starts(body, progress, starts_round(body, free))
            local = LocalOptimum(found[0].duration, np.repeat(found[0].shares, 2, axis=0), np.inf)
        local = local_minimum_time(body, local.shares, local.duration, STEPS)
        best = equal_pieces_slew(body, local, len(found))
        if slew.model.modes:
            best = minimum_time_with_modes(replace(slew, limits=tight_limits), best)
        states, effort = on_ticks(best)
        excess = float(limits.excess(slew.model, states).max())
        if excess <= 0.0:
            return best, states, effort
        margin += 2.0 * excess
    names = ", ".join(limits.names)
    raise PlanFailed(f"no slew keeps to {names}: {excess:.2g} beyond is left; change the goal")


def starts_round(slew: Reorientation, free: MinimumTimeSlew) -> list[Start]:
    """Return a slew that keeps to no limits, and smooth ones on both sides of every cone.

    Args:
        slew: what is turned, a craft without modes.
        free: its fastest slew without limits.
    """
    efforts, duration = _on_pieces(free, PIECES)
    starts = [Start(efforts / slew.amplitude, duration)]
    for cone in slew.limits.cones:
        starts += [_past(slew, cone, side) for side in (1.0, -1.0)]
    return starts


def _on_pieces(slew: MinimumTimeSlew, count: int) -> tuple[Matrix, float]:
    """Return the mean efforts of a slew over so many equal pieces, and its duration [s]."""
    knots = np.concatenate(([0.0], np.cumsum(slew.durations)))
    ends = np.linspace(0.0, knots[-1], count + 1)
    return means(slew.efforts, knots, ends), float(knots[-1])


def _past(slew: Reorientation, cone: Cone, side: float) -> Start:
    """Return the efforts of a smooth turn past a cone, without gyroscopic torques.

    It goes through the attitude of the eigenaxis that is nearest to the cone, turned the least way
    so that the boresight is outside the cone.
    """
    first = slew.attitude.orientation(slew.first)
    shares = np.linspace(_MIN_SHARE, 1.0 - _MIN_SHARE, _POINTS)
    way = product(first, quaternion(np.outer(shares, slew.turn)))
    k = int(np.argmin(cone.margin(way)))
    boresight = to_inertial(way[k : k + 1], cone.boresight)[0]
    direction = np.cross(to_inertial(way[k : k + 1], slew.turn)[0], boresight)
    normal = _unit(np.cross(cone.axis, direction), cone.axis)
    angle = cone.half_angle + _CONE_MARGIN
    target = np.cos(angle) * cone.axis + side * np.sin(angle) * normal
    axis = _unit(np.cross(boresight, target), boresight)
    by = np.arctan2(np.linalg.norm(np.cross(boresight, target)), boresight @ target)
    midpoint = product(quaternion(by * axis), way[k])
    zero_rate = np.zeros(3)
    goal = product(first, quaternion(slew.turn))
    path = completed(
        [Knot(0.0, first, zero_rate), Knot(shares[k], midpoint), Knot(1.0, goal, zero_rate)]
    )
    rate = interpolate(path, np.linspace(0.0, 1.0, PIECES + 1)).rate
    efforts = PIECES * np.diff(rate, axis=0) @ np.linalg.pinv(slew.gain).T / slew.amplitude
    most = float(abs(efforts).max())
    return Start(efforts / most, float(np.sqrt(most)))


def _unit(along: Vector, normal: Vector) -> Vector:
    """Return a unit vector along a vector; where there is none, one across another."""
    if np.linalg.norm(along) < _NONE:
        along = np.cross(normal, np.eye(3)[int(np.argmin(abs(normal)))])
    unit: Vector = along / np.linalg.norm(along)
    return unit
