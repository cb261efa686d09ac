"""Where a spacecraft rests, by the positions along its efforts."""

from collections.abc import Mapping

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft.assembly.craft import CraftDrive, Spacecraft
from flexslew_plant.testbeds.spacecraft.equations import layout as at

_OF_PLATFORM = (at.FORCE, at.TORQUE, at.WHEEL, at.GYRO, at.THRUSTER)  # what reads its place or turn


def position_unit(drive: CraftDrive) -> str:
    """Return the unit of the collocated position."""
    return "m" if drive.unit == "N" else "rad"


def placed(craft: Spacecraft, axes: Matrix, positions: Mapping[str, float]) -> Vector:
    """Return q at rest with the platform placed and turned and the hinges at their angles.

    Args:
        craft: the spacecraft.
        axes: see turning_axes.
        positions: along the actuators, by name [rad or m].
    """
    q = np.zeros(craft.sizes[0])
    place, turn = _placed_and_turned(craft, axes, positions)
    own = {at.FREE: 7, at.HELD: 0, at.PIVOT: 1}[craft.motion]
    for d in craft.drives:
        value = positions.get(d.name, 0.0)
        if d.what == at.HINGE:
            q[own + sum(a.hinge == at.DRIVEN for a in craft.appendages[: d.owner])] = value
        elif value and d.what not in _OF_PLATFORM:
            raise BadInput("appendages start at rest", "initial", d.name, value)
    if craft.motion == at.PIVOT:
        q[0] = turn @ craft.pivot_axis
    if craft.motion == at.FREE:
        angle = float(np.linalg.norm(turn))
        half = np.sinc(angle / 2.0 / np.pi) / 2.0
        q[3:6], q[6] = half * turn, np.cos(angle / 2.0)
        v, w = q[3:6], q[6]
        once = np.cross(v, place)
        q[:3] = place + 2.0 * w * once + 2.0 * np.cross(v, once)
    return q


def _placed_and_turned(
    craft: Spacecraft, axes: Matrix, positions: Mapping[str, float]
) -> tuple[Vector, Vector]:
    """Return place and rotation vector, shape (3,) [m] and (3,) [rad].

    The actuators that read the turn determine it; forces that are somewhere determine the rest, by
    least squares where their readings are not orthonormal. A force at zero, or left out, does not
    count.
    """
    turn = _turn(craft, axes, positions)
    asking = [d for d in craft.drives if d.what == at.FORCE and positions.get(d.name)]
    rows = np.array([_read_by_force(craft, d) for d in asking]).reshape(-1, 6)
    asked = np.array([positions[d.name] for d in asking]) - rows[:, 3:] @ turn
    rows[:, 3:] -= rows[:, 3:] @ np.linalg.pinv(axes) @ axes  # turns that nothing else reads
    if abs(rows @ rows.T - np.eye(len(rows))).max(initial=0.0) > 1e-12:
        both = np.linalg.pinv(rows) @ asked
    else:
        both = np.zeros(6)
        for row, value in zip(rows, asked, strict=True):
            both += value * row
    return both[:3], turn + both[3:]


def _read_by_force(craft: Spacecraft, drive: CraftDrive) -> Vector:
    """Return what a force on the platform reads of place and turn, shape (6,) [-], [m/rad]."""
    arm = np.zeros(3) if drive.spot is None else drive.spot.place
    if craft.motion == at.FREE:
        return np.concatenate((drive.direction, np.cross(arm, drive.direction)))
    axis = craft.pivot_axis if craft.motion == at.PIVOT else np.zeros(3)
    lever = np.cross(arm - craft.pivot_place, drive.direction)
    return np.concatenate((np.zeros(3), (lever @ axis) * axis))


def _turn(craft: Spacecraft, axes: Matrix, positions: Mapping[str, float]) -> Vector:
    """Return the rotation vector with these parts along the named actuators, shape (3,) [rad].

    Along axes that are no orthonormal ones it is found by least squares.
    """
    named = np.array([d.name in positions for d in craft.drives], dtype=bool) & axes.any(axis=1)
    axes = axes[named]
    asked = np.array([positions[d.name] for d, on in zip(craft.drives, named, strict=True) if on])
    if abs(axes @ axes.T - np.eye(len(axes))).max(initial=0.0) > 1e-12:
        return np.asarray(np.linalg.pinv(axes) @ asked)
    turn = np.zeros(3)
    for axis, value in zip(axes, asked, strict=True):
        turn += value * axis
    return turn


def turning_axes(craft: Spacecraft) -> Matrix:
    """Return the body axis along which each actuator reads the platform's turn, else zeros.

    Of a thruster it is the lever of its push about the body origin [m].

    Args:
        craft: the spacecraft.

    Returns:
        shape (actuators, 3).
    """
    axes = np.zeros((len(craft.drives), 3))
    for row, d in zip(axes, craft.drives, strict=True):
        if d.what == at.WHEEL:
            row[:] = craft.wheels[d.owner].axis
        elif d.what == at.GYRO:
            row[:] = craft.gyros[d.owner].across
        elif d.what == at.TORQUE:
            row[:] = d.direction
        elif d.what == at.THRUSTER and d.spot is not None:
            row[:] = np.cross(d.spot.place, d.direction)
    return axes
