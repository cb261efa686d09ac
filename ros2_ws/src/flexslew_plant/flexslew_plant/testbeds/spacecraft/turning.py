"""A spacecraft that turns about one axis: its pivot, the modes that count, the efforts of all."""

from dataclasses import replace

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds.contract import DriveMap, RigidTurn
from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft
from flexslew_plant.testbeds.spacecraft.clamped import platform_inputs
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.settings import AppendageSettings
from flexslew_plant.testbeds.spacecraft.shapes.integrals import point_inertia

_SAME = 1e-6  # relative difference by rounding alone


def pivot_point(spacecraft: Spacecraft) -> Vector:
    """Return about which point it turns: the body origin if forces hold it, else the centre."""
    if any(d.what == at.FORCE for d in spacecraft.drives):
        return np.zeros(3)
    mass, first, _ = spacecraft.rigid()
    return first / mass


def actuator_map(spacecraft: Spacecraft) -> DriveMap:
    """Return what the drives do to the turn of a free platform; see contract.TurnedByDrives."""
    mass, first, _ = spacecraft.rigid()
    force, torque = platform_inputs(spacecraft)
    kinds = [d.what for d in spacecraft.drives]
    wheels = tuple(k for k, what in enumerate(kinds) if what == at.WHEEL)
    return DriveMap(
        torque - np.cross(first / mass, force, axisb=0, axisc=0),
        tuple(k for k, what in enumerate(kinds) if what == at.THRUSTER),
        wheels,
        np.array([spacecraft.wheels[spacecraft.drives[k].owner].inertia for k in wheels]),
        tuple(k for k, what in enumerate(kinds) if what == at.GYRO),
        np.array([(g.axis, g.rotor) for g in spacecraft.gyros]).reshape(-1, 2, 3),
        np.array([g.momentum for g in spacecraft.gyros]),
    )


def rigid_rotation_efforts(spacecraft: Spacecraft, axis: Vector) -> RigidTurn:
    """Return what every joint does while the rigid spacecraft turns about an axis.

    Force m (w' x c + w x (w x c)) and torque I w' + w x I w about the body origin, shared out by
    least squares where there are more or fewer efforts than needed (Sung and Joo, (44) to (46)).
    A hinge's motor holds its appendage where it is.
    """
    mass, first, inertia = spacecraft.rigid()
    pivot = pivot_point(spacecraft)
    centre = first / mass
    pivot_inertia = inertia - mass * (point_inertia(centre) - point_inertia(centre - pivot))
    offset = first - mass * pivot
    force, moment = platform_inputs(spacecraft)
    force_supported = any(d.what == at.FORCE for d in spacecraft.drives)
    # thrusters push a free craft off, so their torque is about its centre of mass
    torque = moment if force_supported else actuator_map(spacecraft).torque
    rows = np.vstack((force, torque)) if force_supported else torque
    inverse = np.linalg.pinv(rows)

    def efforts(push: Vector, angular_part: Vector) -> Vector:
        wrench = np.concatenate((push, angular_part)) if force_supported else angular_part
        shared: Vector = inverse @ wrench
        return shared

    motor_torque, rate_torque = _hinge_motor_torque(spacecraft, axis, pivot)
    return RigidTurn(
        float(axis @ pivot_inertia @ axis),
        efforts(np.cross(axis, offset), pivot_inertia @ axis) + motor_torque,
        efforts(np.cross(axis, np.cross(axis, offset)), np.cross(axis, pivot_inertia @ axis))
        + rate_torque,
        axis @ moment,  # forces read the place of their points; where there are some, it is held
    )


def _hinge_motor_torque(
    spacecraft: Spacecraft, axis: Vector, pivot: Vector
) -> tuple[Vector, Vector]:
    """Return what hinges' motors hold per angular acceleration and per square of the rate.

    About the hinge: s x a + J w' + w x J w, with a of the hinge, s and J of what it carries.

    Args:
        spacecraft: the spacecraft.
        axis: about which it turns, shape (3,).
        pivot: a point of that axis, shape (3,) [m].

    Returns:
        of each drive, zero for all but hinges, (drives,) each.
    """
    motor_torque, rate_torque = np.zeros(len(spacecraft.drives)), np.zeros(len(spacecraft.drives))
    for k, d in enumerate(spacecraft.drives):
        if d.what != at.HINGE:
            continue
        a = spacecraft.appendages[d.owner]
        local_axis, arm = a.axes @ axis, a.axes @ (a.place - pivot)
        first, inertia = a.integrals.first, a.integrals.inertia
        hinge_acceleration = np.cross(local_axis, arm)
        motor_torque[k] = a.axis @ (np.cross(first, hinge_acceleration) + inertia @ local_axis)
        rate_moment = np.cross(first, np.cross(local_axis, hinge_acceleration)) + np.cross(
            local_axis, inertia @ local_axis
        )
        rate_torque[k] = a.axis @ rate_moment
    return motor_torque, rate_torque


def keep_largest_modes(
    spacecraft: Spacecraft,
    parts: dict[str, AppendageSettings],
    axis: Vector,
    place: Vector,
    modes: int,
) -> dict[str, AppendageSettings]:
    """Return the appendages with those modes alone that a turn about an axis deflects most.

    Modes of one frequency, as two equal panels have them, count as one: they swing together.

    Args:
        spacecraft: the spacecraft.
        parts: its appendages, by name.
        axis: of the turn, shape (3,).
        place: on that axis, shape (3,).
        modes: how many different frequencies are kept altogether.
    """
    found = []
    for a in spacecraft.appendages:
        seen = a.integrals.seen_from(a.place - place, a.axes)
        pull = axis @ seen.rotation  # of the angular acceleration on each mode
        deflection = abs(pull) / np.sqrt(a.mass) / np.where(a.stiffness > 0.0, a.stiffness, 1.0)
        square = a.stiffness / a.mass
        found += [
            (size * mass, a.name, k + 1, float(square[k]))
            for k, (size, mass) in enumerate(zip(deflection, a.mass, strict=True))
        ]
    found.sort(reverse=True)
    squares: list[float] = []
    kept = []
    for size, name, k, square_of in found:
        known = any(abs(square_of - other) <= _SAME * other for other in squares)
        if not known and len(squares) < modes:
            squares.append(square_of)
        elif not known or size <= _SAME * found[0][0]:  # of another frequency, or not driven
            continue
        kept.append((name, k))
    return {
        name: replace(part, only_modes=tuple(sorted(k for n, k in kept if n == name)))
        for name, part in parts.items()
    }
