"""One appendage clamped to its platform, in numbers for a law: what moves it, what it shows."""

import numpy as np

from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.contract import Clamped
from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.shapes.integrals import inertia_of


def platform_inputs(craft: Spacecraft) -> tuple[Matrix, Matrix]:
    """Return the force and the torque of every joint's effort on the platform, (3, joints)."""
    force, torque = np.zeros((3, len(craft.drives))), np.zeros((3, len(craft.drives)))
    for k, d in enumerate(craft.drives):
        if d.what in (at.FORCE, at.THRUSTER):
            force[:, k] = d.direction
            torque[:, k] = 0.0 if d.spot is None else np.cross(d.spot.place, d.direction)
        elif d.what == at.TORQUE:
            torque[:, k] = d.direction
        elif d.what == at.WHEEL:
            torque[:, k] = craft.wheels[d.owner].axis
        elif d.what == at.GYRO:
            torque[:, k] = craft.gyros[d.owner].across
    return force, torque


def clamped(craft: Spacecraft, name: str, tips: tuple[str, ...]) -> Clamped:
    """Return an appendage clamped to the platform; see HasClampedAppendages.

    Args:
        craft: the spacecraft.
        name: of the appendage.
        tips: names of the tip readings.

    Raises:
        BadInput: there is none of this name, or it is rigid.
    """
    names = [a.name for a in craft.appendages if a.modes]
    if name not in names:
        raise BadInput(
            f"appendage: {name} is not a flexible appendage of the testbed; allowed: "
            f"{', '.join(names) or 'none'}"
        )
    index = [a.name for a in craft.appendages].index(name)
    a = craft.appendages[index]
    assert a.shape is not None
    seen = a.integrals.seen_from(a.place, a.axes)
    force, torque = platform_inputs(craft)
    joints, columns = [], []
    for k, d in enumerate(craft.drives):
        if d.what == at.TIP_TORQUE and d.owner == index and d.spot is not None:
            joints.append(k)
            columns.append(d.spot.turn.T @ d.direction)
    readings = [f"{name}_{axis}" for axis in "xyz"] + [f"{name}_rate_{axis}" for axis in "xyz"]
    mass, first, inertia = craft.rigid()
    return Clamped(
        a.mass,
        a.stiffness,
        a.damping,
        craft.first_mode(index),
        joints,
        np.array(columns).reshape(-1, a.modes).T,
        a.axes.T @ a.shape.tip.displacement,
        [tips.index(reading) for reading in readings],
        seen.rotation.T,
        0.5 * inertia_of(seen.second_1),
        torque,
        force,
        mass,
        first,
        inertia,
    )
