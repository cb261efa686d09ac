"""The fastest turn that keeps out of the cones of `keep_out`, and below a rate, on pieces.

Each side of a cone may hold a slew of its own, and programs never go from one to the other. So they
start from paths on both sides of every cone, and from the slew that no cone keeps away.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from flexslew_control.planners.attitude.attitude_path import Knot, completed, through
from flexslew_control.planners.progress import Progress
from flexslew_control.planners.time_optimal.three_axes.fastest_turns import (
    PIECES,
    STEPS,
    Fastest,
    Start,
    fastest_flexible,
    fastest_rigid,
    from_starts,
    means,
    transcribed,
)
from flexslew_control.planners.time_optimal.three_axes.path_limits import PathLimits
from flexslew_control.planners.time_optimal.three_axes.reorientation import Reorientation
from flexslew_control.planners.time_optimal.three_axes.sequential_programs import (
    LocalArcs,
    fastest_near,
)
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import PlanFailed
from flexslew_plant.testbeds.attitude import product, quaternion, to_inertial
from flexslew_plant.testbeds.contract import Cone

_LOOKED_AT = 120  # pieces of a free slew
_ASIDE = 0.3  # from the edge of a cone that a start goes round [rad]
_EARLIEST = 0.2  # share of the way at which it passes the cone, and as late from the end
_NONE = 1e-9  # length of a vector without a direction
_POINTS = 25  # of the way, one of which is nearest to a cone
_WIDER, _WIDENINGS = 1e-3, 4  # spare of the path's limits [rad, -], and how often it may grow


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


def fastest_rigid_within(limits: PathLimits, stiff: Reorientation, progress: Progress) -> Fastest:
    """Return the fastest slew of a craft without modes that keeps to limits at the pieces' ends.

    Raises:
        PlanFailed: no start leads to one.
    """
    free = fastest_rigid(stiff, progress)
    if not limits.names:
        return free
    states = stiff.states(*_on_pieces(free, _LOOKED_AT))
    if limits.excess(stiff.model, states).max() <= 0.0:
        return free
    body = replace(stiff, limits=limits)
    found = from_starts(body, progress, starts_round(body, free))
    return transcribed(body, found[0], len(found))


def fastest_within(
    limits: PathLimits,
    slew: Reorientation,
    stiff: Reorientation,
    free: Fastest,
    on_ticks: Callable[[Fastest], tuple[Matrix, Matrix]],
    progress: Progress,
) -> tuple[Fastest, Matrix, Matrix]:
    """Return the fastest slew that keeps to the limits at all ticks, and its states and efforts.

    The programs check the ends of the pieces, with a spare for the excess between them.

    Args:
        limits: limits of the path.
        slew: the slew.
        stiff: the same without modes.
        free: its fastest slew without limits.
        on_ticks: returns the states at the ticks and the efforts of a slew.
        progress: called after every start.

    Raises:
        PlanFailed: if no slew does.
    """
    spare, local = _WIDER, None
    for _ in range(_WIDENINGS):
        held = replace(limits, spare=spare)
        body = replace(stiff, limits=held)
        if local is None:
            found = from_starts(body, progress, starts_round(body, free))
            local = LocalArcs(found[0].duration, np.repeat(found[0].shares, 2, axis=0), np.inf)
        local = fastest_near(body, local.shares, local.duration, STEPS)
        best = transcribed(body, local, len(found))
        if slew.model.modes:
            best = fastest_flexible(replace(slew, limits=held), best)
        states, effort = on_ticks(best)
        beyond = float(limits.excess(slew.model, states).max())
        if beyond <= 0.0:
            return best, states, effort
        spare += 2.0 * beyond
    names = ", ".join(limits.names)
    raise PlanFailed(f"no slew keeps to {names}: {beyond:.2g} beyond is left; change the goal")


def starts_round(slew: Reorientation, free: Fastest) -> list[Start]:
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


def _on_pieces(slew: Fastest, count: int) -> tuple[Matrix, float]:
    """Return the mean efforts of a slew over so many equal pieces, and its duration [s]."""
    knots = np.concatenate(([0.0], np.cumsum(slew.durations)))
    ends = np.linspace(0.0, knots[-1], count + 1)
    return means(slew.efforts, knots, ends), float(knots[-1])


def _past(slew: Reorientation, cone: Cone, side: float) -> Start:
    """Return the efforts of a smooth turn past a cone, without gyroscopic torques.

    It goes through the attitude of the eigenaxis that is nearest to the cone, turned the least way
    so that the boresight is outside the cone.

    Args:
        slew: the slew.
        cone: the cone that it goes past.
        side: side of the cone, 1 or -1.
    """
    first = slew.attitude.orientation(slew.first)
    shares = np.linspace(_EARLIEST, 1.0 - _EARLIEST, _POINTS)
    way = product(first, quaternion(np.outer(shares, slew.turn)))
    k = int(np.argmin(cone.margin(way)))
    look = to_inertial(way[k : k + 1], cone.boresight)[0]
    ahead = np.cross(to_inertial(way[k : k + 1], slew.turn)[0], look)
    across = _unit(np.cross(cone.axis, ahead), cone.axis)
    angle = cone.half_angle + _ASIDE
    there = np.cos(angle) * cone.axis + side * np.sin(angle) * across
    about = _unit(np.cross(look, there), look)
    by = np.arctan2(np.linalg.norm(np.cross(look, there)), look @ there)
    passing = product(quaternion(by * about), way[k])
    still = np.zeros(3)
    goal = product(first, quaternion(slew.turn))
    path = completed([Knot(0.0, first, still), Knot(shares[k], passing), Knot(1.0, goal, still)])
    rate = through(path, np.linspace(0.0, 1.0, PIECES + 1)).rate
    efforts = PIECES * np.diff(rate, axis=0) @ np.linalg.pinv(slew.gain).T / slew.amplitude
    most = float(abs(efforts).max())
    return Start(efforts / most, float(np.sqrt(most)))


def _unit(along: Vector, across: Vector) -> Vector:
    """Return a unit vector along a vector; where there is none, one across another."""
    if np.linalg.norm(along) < _NONE:
        along = np.cross(across, np.eye(3)[int(np.argmin(abs(across)))])
    unit: Vector = along / np.linalg.norm(along)
    return unit
