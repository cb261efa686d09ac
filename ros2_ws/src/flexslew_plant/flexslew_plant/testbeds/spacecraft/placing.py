"""Where a spacecraft rests, by the positions along its efforts."""

from collections.abc import Mapping

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft.assembly.craft import CraftDrive, Spacecraft
from flexslew_plant.testbeds.spacecraft.equations import layout as at

_TURNING = (at.TORQUE, at.WHEEL, at.GYRO, at.THRUSTER)  # what reads the platform's turn


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
    place = np.zeros(3)
    turn = _turn(craft, axes, positions)
    own = {at.FREE: 7, at.HELD: 0, at.PIVOT: 1}[craft.motion]
    for d in craft.drives:
        value = positions.get(d.name, 0.0)
        if d.what == at.FORCE:
            place += value * d.direction
        elif d.what == at.HINGE:
            q[own + sum(a.hinge == at.DRIVEN for a in craft.appendages[: d.owner])] = value
        elif value and d.what not in _TURNING:
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


def _turn(craft: Spacecraft, axes: Matrix, positions: Mapping[str, float]) -> Vector:
    """Return the rotation vector whose parts along the named actuators are these, shape (3,) [rad].

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
