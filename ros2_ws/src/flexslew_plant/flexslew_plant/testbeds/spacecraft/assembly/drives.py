"""Actuators of a trial file in SI: where they sit and what they push."""

import numpy as np

from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft.assembly.bodies import unit_direction
from flexslew_plant.testbeds.spacecraft.assembly.craft import Appendage, SpacecraftActuator
from flexslew_plant.testbeds.spacecraft.assembly.described import SpacecraftSection
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.retargeting import modal_effort
from flexslew_plant.testbeds.spacecraft.settings import (
    ActuatorPlace,
    SensorPlace,
)
from flexslew_plant.testbeds.spacecraft.shapes.shape import AppendagePoint
from flexslew_plant.testbeds.spacecraft.units import Units

_ON_PLATFORM = {"force": at.FORCE, "torque": at.TORQUE, "thruster": at.THRUSTER}


def make_actuator_list(
    section: SpacecraftSection, parts: tuple[Appendage, ...], units: Units
) -> tuple[SpacecraftActuator, ...]:
    """Return the actuators as listed, then the hinges' motors, the wheels' and the gyros'."""
    names = [a.name for a in parts]
    found = []
    for name, d in section.actuators.items():
        key = f"testbed.actuators.{name}"
        if d.kind == "modal":
            found.append(_modal(name, d, parts, units, key))
            continue
        if d.mode is not None:
            raise BadInput("kind modal alone has a mode", key=f"{key}.mode", value=d.mode)
        direction = unit_direction(d.direction, f"{key}.direction")
        limit = d.limit * (units.torque if d.kind == "torque" else units.force)
        if d.kind == "thruster" and d.appendage is not None:
            raise BadInput(
                "a thruster sits on the platform", key=f"{key}.appendage", value=d.appendage
            )
        if d.appendage is None:
            what = _ON_PLATFORM[d.kind]
            empty = np.zeros((3, 0))
            point = AppendagePoint(np.array(d.place) * units.length, empty, empty, empty)
            found.append(SpacecraftActuator(name, what, -1, direction, point, limit))
            continue
        if d.appendage not in names:
            raise BadInput(
                f"{key}.appendage: {d.appendage} is no appendage; allowed: {', '.join(names)}"
            )
        index = names.index(d.appendage)
        what = at.POINT_FORCE if d.kind == "force" else at.TIP_TORQUE
        found.append(
            SpacecraftActuator(
                name, what, index, direction, point_on(parts[index], d, units, key), limit
            )
        )
    for k, (name, part) in enumerate(section.appendages.items()):
        if part.hinge.kind == "driven":
            limit = part.hinge.limit * units.torque
            found.append(SpacecraftActuator(f"{name}_hinge", at.HINGE, k, np.zeros(3), None, limit))
    for k, (name, w) in enumerate(section.wheels.items()):
        found.append(
            SpacecraftActuator(name, at.WHEEL, k, np.zeros(3), None, w.limit * units.torque)
        )
    for k, (name, g) in enumerate(section.control_moment_gyros.items()):
        limit = g.momentum * g.rate_limit * units.torque
        found.append(SpacecraftActuator(name, at.GYRO, k, np.zeros(3), None, limit))
    duplicates = sorted({d.name for d in found if sum(e.name == d.name for e in found) > 1})
    if duplicates:
        raise BadInput(f"testbed: two actuators are called {duplicates[0]}")
    return tuple(found)


def _modal(
    name: str, d: ActuatorPlace, parts: tuple[Appendage, ...], units: Units, key: str
) -> SpacecraftActuator:
    """Return a modal force; the displacement of its spot is the coordinate that it drives."""
    index_by_name = {a.name: k for k, a in enumerate(parts) if a.modes}
    if d.appendage not in index_by_name:
        known = ", ".join(index_by_name)
        raise BadInput(f"{key}.appendage: {d.appendage} has no modes; allowed: {known}")
    index = index_by_name[d.appendage]
    n = parts[index].modes
    if parts[index].hinge == at.DRIVEN:
        raise BadInput(f"{key}.appendage: {d.appendage} is on a driven hinge; give a force")
    if d.mode is None or d.mode > n:
        raise BadInput(f"1 to {n}", key=f"{key}.mode", value=d.mode)
    unit_mode, none = np.zeros((3, n)), np.zeros((3, n))
    unit_mode[0, d.mode - 1] = 1.0
    point = AppendagePoint(np.zeros(3), unit_mode, none, none)
    limit = d.limit * modal_effort(parts[index], d.mode - 1, units)
    return SpacecraftActuator(name, at.MODAL, index, np.zeros(3), point, limit)


def point_on(
    a: Appendage, d: ActuatorPlace | SensorPlace, units: Units, key: str
) -> AppendagePoint:
    """Return where an actuator or a sensor sits on an appendage."""
    if a.shape is None:
        empty = np.zeros((3, 0))
        return AppendagePoint(np.array(d.place) * units.length, empty, empty, empty)
    if d.at is None:
        return a.shape.tip
    if a.shape.along is None:
        raise BadInput(f"{key}.at: {a.name} is not a beam; leave it out for the tip")
    return a.shape.along.point(d.at * units.length)
