"""Where a spacecraft rests, by the positions along its efforts."""

from collections.abc import Mapping

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft.assembly.craft import CraftDrive, Spacecraft
from flexslew_plant.testbeds.spacecraft.equations import layout as at


def position_unit(drive: CraftDrive) -> str:
    """Return the unit of the collocated position."""
    return "m" if drive.unit == "N" else "rad"


def placed(craft: Spacecraft, positions: Mapping[str, float]) -> Vector:
    """Return q at rest with the platform placed and turned and the hinges at their angles.

    Args:
        craft: the spacecraft.
        positions: along the actuators, by name [rad or m].
    """
    q = np.zeros(craft.sizes[0])
    place, turn = np.zeros(3), np.zeros(3)
    own = {at.FREE: 7, at.HELD: 0, at.PIVOT: 1}[craft.motion]
    hinge = 0
    for d in craft.drives:
        value = positions.get(d.name, 0.0)
        if d.what == at.FORCE:
            place += value * d.direction
        elif d.what in (at.TORQUE, at.WHEEL):
            turn += value * (craft.wheels[d.owner].axis if d.what == at.WHEEL else d.direction)
        elif d.what == at.HINGE:
            q[own + hinge] = value
        elif value:
            raise BadInput("appendages start at rest", "initial", d.name, value)
        hinge += d.what == at.HINGE
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


def turning_axes(craft: Spacecraft) -> Matrix:
    """Return the body axis along which each actuator reads the platform's turn, else zeros.

    Args:
        craft: the spacecraft.

    Returns:
        shape (actuators, 3).
    """
    axes = np.zeros((len(craft.drives), 3))
    for row, d in zip(axes, craft.drives, strict=True):
        if d.what in (at.TORQUE, at.WHEEL):
            row[:] = craft.wheels[d.owner].axis if d.what == at.WHEEL else d.direction
    return axes
