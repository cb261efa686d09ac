"""Where a spacecraft rests, by the positions along its efforts."""

from collections.abc import Mapping

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft, SpacecraftActuator
from flexslew_plant.testbeds.spacecraft.equations import layout as at

_OF_PLATFORM = (at.FORCE, at.TORQUE, at.WHEEL, at.GYRO, at.THRUSTER)  # what reads its place or turn


def position_unit(actuator: SpacecraftActuator) -> str:
    """Return the unit of the collocated position."""
    return "m" if actuator.unit == "N" else "rad"


def rest_position(spacecraft: Spacecraft, axes: Matrix, positions: Mapping[str, float]) -> Vector:
    """Return q at rest with the platform placed and turned and the hinges at their angles.

    Args:
        spacecraft: the spacecraft.
        axes: see rotation_axes.
        positions: along the actuators, by name [rad or m].
    """
    q = np.zeros(spacecraft.sizes[0])
    place, rotation = _place_and_rotation(spacecraft, axes, positions)
    platform_size = {at.FREE: 7, at.HELD: 0, at.PIVOT: 1}[spacecraft.motion]
    for d in spacecraft.drives:
        value = positions.get(d.name, 0.0)
        if d.what == at.HINGE:
            q[
                platform_size + sum(a.hinge == at.DRIVEN for a in spacecraft.appendages[: d.owner])
            ] = value
        elif value and d.what not in _OF_PLATFORM:
            raise BadInput("appendages start at rest", "initial", d.name, value)
    if spacecraft.motion == at.PIVOT:
        q[0] = rotation @ spacecraft.pivot_axis
    if spacecraft.motion == at.FREE:
        angle = float(np.linalg.norm(rotation))
        half = np.sinc(angle / 2.0 / np.pi) / 2.0
        q[3:6], q[6] = half * rotation, np.cos(angle / 2.0)
        v, w = q[3:6], q[6]
        once = np.cross(v, place)
        q[:3] = place + 2.0 * w * once + 2.0 * np.cross(v, once)
    return q


def _place_and_rotation(
    spacecraft: Spacecraft, axes: Matrix, positions: Mapping[str, float]
) -> tuple[Vector, Vector]:
    """Return place and rotation vector, shape (3,) [m] and (3,) [rad].

    The actuators that read the turn determine it; forces that are somewhere determine the rest, by
    least squares where their readings are not orthonormal. A force at zero, or left out, does not
    count.
    """
    rotation = _rotation_vector(spacecraft, axes, positions)
    force_list = [d for d in spacecraft.drives if d.what == at.FORCE and positions.get(d.name)]
    rows = np.array([_read_by_force(spacecraft, d) for d in force_list]).reshape(-1, 6)
    requested = np.array([positions[d.name] for d in force_list]) - rows[:, 3:] @ rotation
    rows[:, 3:] -= rows[:, 3:] @ np.linalg.pinv(axes) @ axes  # turns that nothing else reads
    if abs(rows @ rows.T - np.eye(len(rows))).max(initial=0.0) > 1e-12:
        solution = np.linalg.pinv(rows) @ requested
    else:
        solution = np.zeros(6)
        for row, value in zip(rows, requested, strict=True):
            solution += value * row
    return solution[:3], rotation + solution[3:]


def _read_by_force(spacecraft: Spacecraft, actuator: SpacecraftActuator) -> Vector:
    """Return what a force on the platform reads of place and turn, shape (6,) [-], [m/rad]."""
    arm = np.zeros(3) if actuator.point is None else actuator.point.place
    if spacecraft.motion == at.FREE:
        return np.concatenate((actuator.direction, np.cross(arm, actuator.direction)))
    axis = spacecraft.pivot_axis if spacecraft.motion == at.PIVOT else np.zeros(3)
    torque_arm = np.cross(arm - spacecraft.pivot_place, actuator.direction)
    return np.concatenate((np.zeros(3), (torque_arm @ axis) * axis))


def _rotation_vector(
    spacecraft: Spacecraft, axes: Matrix, positions: Mapping[str, float]
) -> Vector:
    """Return the rotation vector with these parts along the named actuators, shape (3,) [rad].

    Along axes that are no orthonormal ones it is found by least squares.
    """
    named = np.array([d.name in positions for d in spacecraft.drives], dtype=bool) & axes.any(
        axis=1
    )
    axes = axes[named]
    requested = np.array(
        [positions[d.name] for d, on in zip(spacecraft.drives, named, strict=True) if on]
    )
    if abs(axes @ axes.T - np.eye(len(axes))).max(initial=0.0) > 1e-12:
        return np.asarray(np.linalg.pinv(axes) @ requested)
    rotation = np.zeros(3)
    for axis, value in zip(axes, requested, strict=True):
        rotation += value * axis
    return rotation


def rotation_axes(spacecraft: Spacecraft) -> Matrix:
    """Return the body axis along which each actuator reads the platform's turn, else zeros.

    Of a thruster it is the lever of its push about the body origin [m].

    Returns:
        shape (actuators, 3).
    """
    axes = np.zeros((len(spacecraft.drives), 3))
    for row, d in zip(axes, spacecraft.drives, strict=True):
        if d.what == at.WHEEL:
            row[:] = spacecraft.wheels[d.owner].axis
        elif d.what == at.GYRO:
            row[:] = spacecraft.gyros[d.owner].across
        elif d.what == at.TORQUE:
            row[:] = d.direction
        elif d.what == at.THRUSTER and d.point is not None:
            row[:] = np.cross(d.point.place, d.direction)
    return axes
