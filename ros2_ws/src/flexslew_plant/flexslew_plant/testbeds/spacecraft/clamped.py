"""One appendage clamped to its platform, in numbers for a law: what moves it, what it shows."""

import numpy as np

from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.contract import Clamped
from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.shapes.integrals import inertia_of


def platform_inputs(spacecraft: Spacecraft) -> tuple[Matrix, Matrix]:
    """Return the force and the torque of every joint's effort on the platform, (3, joints)."""
    force, torque = np.zeros((3, len(spacecraft.drives))), np.zeros((3, len(spacecraft.drives)))
    for k, d in enumerate(spacecraft.drives):
        if d.what in (at.FORCE, at.THRUSTER):
            force[:, k] = d.direction
            torque[:, k] = 0.0 if d.point is None else np.cross(d.point.place, d.direction)
        elif d.what == at.TORQUE:
            torque[:, k] = d.direction
        elif d.what == at.WHEEL:
            torque[:, k] = spacecraft.wheels[d.owner].axis
        elif d.what == at.GYRO:
            torque[:, k] = spacecraft.gyros[d.owner].across
    return force, torque


def clamped(spacecraft: Spacecraft, name: str, tips: tuple[str, ...]) -> Clamped:
    """Return an appendage clamped to the platform; see HasClampedAppendages.

    Args:
        spacecraft: the spacecraft.
        name: of the appendage.
        tips: names of the tip readings.

    Raises:
        BadInput: there is none of this name, or it is rigid.
    """
    names = [a.name for a in spacecraft.appendages if a.modes]
    if name not in names:
        raise BadInput(
            f"appendage: {name} is not a flexible appendage of the testbed; allowed: "
            f"{', '.join(names) or 'none'}"
        )
    index = [a.name for a in spacecraft.appendages].index(name)
    a = spacecraft.appendages[index]
    assert a.shape is not None
    seen = a.integrals.seen_from(a.place, a.axes)
    force, torque = platform_inputs(spacecraft)
    joints, columns = [], []
    for k, d in enumerate(spacecraft.drives):
        if d.what == at.TIP_TORQUE and d.owner == index and d.point is not None:
            joints.append(k)
            columns.append(d.point.turn.T @ d.direction)
    reading_names = [f"{name}_{axis}" for axis in "xyz"] + [f"{name}_rate_{axis}" for axis in "xyz"]
    mass, first, inertia = spacecraft.rigid()
    return Clamped(
        a.mass,
        a.stiffness,
        a.damping,
        spacecraft.first_mode(index),
        joints,
        np.array(columns).reshape(-1, a.modes).T,
        a.axes.T @ a.shape.tip.displacement,
        [tips.index(reading) for reading in reading_names],
        seen.rotation.T,
        0.5 * inertia_of(seen.second_1),
        torque,
        force,
        mass,
        first,
        inertia,
    )
