"""Antennas that turn on prescribed hinges: their turns, and the units of a section's weights."""

from typing import Any

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import plain
from flexslew_plant.testbeds.contract import HingeTurn, UnitSizes
from flexslew_plant.testbeds.spacecraft.assembly.craft import Appendage, Spacecraft
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.settings import AppendageSettings, Motion
from flexslew_plant.testbeds.spacecraft.units import Units


def prescribed_rotations(spacecraft: Spacecraft) -> tuple[HingeTurn, ...]:
    """Return all prescribed turns, in the order of their begin."""
    rotations = []
    for a in spacecraft.appendages:
        angle = 0.0
        for m in a.manoeuvres:
            angle += m.angle
            rotations.append(HingeTurn(a.name, m.begin, m.begin + m.duration, angle))
    return tuple(sorted(rotations, key=lambda turn: (turn.begin, turn.appendage)))


def new_target_keys(
    appendages: dict[str, AppendageSettings], requested: dict[str, Any], at: float
) -> dict[str, Any]:
    """Return the keys of a section that give an appendage a new target.

    Args:
        appendages: of the section.
        requested: `appendage`, and the keys of a motion but for `at`.
        at: when it begins to turn [s].

    Raises:
        BadInput: no such appendage, or its hinge does not turn in a prescribed way.
    """
    motion = dict(requested)
    name = motion.pop("appendage", None)
    if name not in appendages:
        known = ", ".join(appendages)
        raise BadInput(f"appendage: {name} is not allowed; allowed: {known}")
    hinge = appendages[name].hinge
    given = (hinge.motion,) if isinstance(hinge.motion, Motion) else (hinge.motion or ())
    if not given and hinge.kind != "prescribed":
        raise BadInput(f"appendage: the hinge of {name} does not turn; set its kind to prescribed")
    motion_list = [plain(m) for m in given] + [{**motion, "at": at}]
    return {"appendages": {name: {"hinge": {"motion": motion_list}}}}


def mode_sizes(a: Appendage, units: Units) -> Vector:
    """Return one unit of each modal coordinate of a section in SI, shape (n,).

    A mode of a beam in closed form, which is a cantilever function times a coordinate in units of
    length (Kwak 1989, (4-1)), has the beam's mass for its modal mass; any other one has the unit
    of mass.
    """
    scaled = a.shape is not None and a.shape.tip_scaled
    sizes: Vector = units.length * np.sqrt((a.integrals.mass if scaled else units.mass) / a.mass)
    return sizes


def modal_effort(a: Appendage, mode: int, units: Units) -> float:
    """Return one unit of a force on a modal coordinate in SI; modes count from 0."""
    return units.torque / float(mode_sizes(a, units)[mode])


def section_units(spacecraft: Spacecraft, units: Units) -> UnitSizes:
    """Return the units of places, angles, modes and efforts in SI."""
    platform_units = {at.FREE: [units.length] * 3 + [1.0] * 3, at.HELD: [], at.PIVOT: [1.0]}[
        spacecraft.motion
    ]
    sizes = platform_units + [1.0] * (
        len(spacecraft.hinged) + len(spacecraft.wheels) + len(spacecraft.gyros)
    )
    for a in spacecraft.appendages:
        sizes += mode_sizes(a, units).tolist()
    efforts = []
    for d in spacecraft.drives:
        if d.what == at.MODAL and d.point is not None:
            mode = int(np.argmax(d.point.displacement[0]))
            efforts.append(modal_effort(spacecraft.appendages[d.owner], mode, units))
        else:
            efforts.append(units.force if d.unit == "N" else units.torque)
    return UnitSizes(np.array(sizes), np.array(efforts), units.torque)
