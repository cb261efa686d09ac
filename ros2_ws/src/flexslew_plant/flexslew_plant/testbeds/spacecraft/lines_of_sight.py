"""Where antennas look while their hinges turn and the platform moves, and where they should."""

from inspect import unwrap

import numpy as np
from numpy.typing import NDArray

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.contract import LineOfSight
from flexslew_plant.testbeds.orientation.attitude import to_inertial
from flexslew_plant.testbeds.spacecraft.assembly.bodies import rotation_matrix
from flexslew_plant.testbeds.spacecraft.assembly.craft import (
    Appendage,
    PrescribedRotation,
    Spacecraft,
)
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.equations.hinge_motion import share

_share = unwrap(share)  # plain Python: a few calls are not worth a compilation
_NO_ROTATION = np.array([0.0, 0.0, 0.0, 1.0])


def hinge_axes_and_angle(a: Appendage, time: Vector) -> tuple[NDArray[np.float64], Vector]:
    """Return the axes of a prescribed hinge, body to appendage, and its angle.

    Args:
        a: the appendage.
        time: shape (k,) [s].

    Returns:
        Axes of shape (k, 3, 3), angles from the hinge's rest of shape (k,) [rad].
    """
    axes, start = np.tile(a.axes, (len(time), 1, 1)), a.axes
    angle, before = np.zeros(len(time)), 0.0
    for m in a.manoeuvres:
        after_start = time >= m.begin
        s, place = np.unique(
            np.minimum((time[after_start] - m.begin) / m.duration, 1.0), return_inverse=True
        )
        done = m.angle * _done(m, s)
        axes[after_start] = np.array([rotation_matrix(m.axis, x) @ start for x in done]).reshape(
            -1, 3, 3
        )[place]
        angle[after_start] = before + done[place]
        start, before = rotation_matrix(m.axis, m.angle) @ start, before + m.angle
    return axes, angle


def lines_of_sight(
    spacecraft: Spacecraft, time: Vector, position: Matrix, goal: Vector
) -> dict[str, LineOfSight]:
    """Return the lines of sight of all antennas that turn; see HasLinesOfSight.

    Args:
        spacecraft: the spacecraft.
        time: shape (k,) [s].
        position: q, shape (k, positions).
        goal: q at the goal, shape (positions,).
    """
    attitude, requested = _attitude(spacecraft, position), _attitude(spacecraft, goal[None])
    modes = position[:, position.shape[1] - spacecraft.modes :]
    found = {}
    for index, a in enumerate(spacecraft.appendages):
        if not a.manoeuvres:
            continue
        axes, angle = hinge_axes_and_angle(a, time)
        direction = np.tile((0.0, 0.0, 1.0), (len(time), 1))
        if a.shape is not None:
            tip_rotation = (
                modes[:, spacecraft.first_mode(index) :][:, : a.modes] @ a.shape.tip.turn.T
            )
            direction = direction + np.cross(tip_rotation, direction)
        direction = to_inertial(attitude, np.einsum("kji,kj->ki", axes, direction))
        target = to_inertial(requested, target_directions(a, time))
        sine = np.linalg.norm(np.cross(direction, target), axis=1)
        error = np.arctan2(sine, np.einsum("ki,ki->k", direction, target))
        at_rest = np.zeros(len(time), dtype=bool)
        for m in a.manoeuvres:
            at_rest = np.where(time >= m.begin, time >= m.begin + m.duration - 1e-9, at_rest)
        found[a.name] = LineOfSight(angle, error, at_rest)
    return found


def target_directions(a: Appendage, time: Vector) -> Matrix:
    """Return where an antenna should point, with the platform at its goal, shape (k, 3).

    Before its first turn that is its direction at rest; from the begin of a turn on, its target.
    """
    targets, start = np.tile(a.axes[2], (len(time), 1)), a.axes
    for m in a.manoeuvres:
        start = rotation_matrix(m.axis, m.angle) @ start
        targets[time >= m.begin] = start[2]
    return targets


def _done(m: PrescribedRotation, s: Vector) -> Vector:
    """Return the share of a turn that is done, shape of s."""
    row = np.concatenate((np.zeros(at.MANOEUVRE_SIZE), m.table.ravel()))
    row[at.PROFILE], row[at.TABLE_AT], row[at.ROWS] = m.profile, at.MANOEUVRE_SIZE, len(m.table)
    return np.array([1.0 if x >= 1.0 else _share(row, 0, x)[0] for x in s.tolist()])


def _attitude(spacecraft: Spacecraft, position: Matrix) -> Matrix:
    """Return the platform's attitude as quaternions, shape (k, 4)."""
    if spacecraft.motion == at.FREE:
        return position[:, 3:7]
    if spacecraft.motion == at.HELD:
        return np.tile(_NO_ROTATION, (len(position), 1))
    half = 0.5 * position[:, :1]
    return np.hstack((np.sin(half) * spacecraft.pivot_axis, np.cos(half)))
