"""What moves a free platform besides its efforts: its orbit, and wheels that are not balanced."""

from collections.abc import Mapping

import numpy as np

from flexslew_plant.arrays import Vector, compiled_once
from flexslew_plant.testbeds.outside import Outside
from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft
from flexslew_plant.testbeds.spacecraft.equations.geometry import rotation
from flexslew_plant.testbeds.spacecraft.imbalance import add_imbalance, packed_imbalance
from flexslew_plant.testbeds.spacecraft.orbit import ORBIT_SIZE, Orbit, orbit_torque, packed_orbit
from flexslew_plant.testbeds.spacecraft.settings import WheelSettings
from flexslew_plant.testbeds.spacecraft.units import Units


def outside_of(
    craft: Spacecraft, orbit: Orbit | None, wheels: Mapping[str, WheelSettings], units: Units
) -> Outside | None:
    """Return the forces of the orbit and of wheels that are not balanced; None: there are none.

    Args:
        craft: the spacecraft, with a free platform.
        orbit: that it is on.
        wheels: its wheels' settings.
        units: in which these are written.
    """
    harmonics = packed_imbalance(craft, wheels, units)
    if orbit is None and not harmonics.size:
        return None
    numbers = np.concatenate((packed_orbit(craft, orbit), harmonics))
    return Outside(add_forces, numbers, craft.sizes[1])


@compiled_once("force")
def add_forces(numbers: Vector, x: Vector, t: float, span: float, force: Vector) -> None:
    """Add the forces of orbit and wheels; see Outside.add."""
    torque = orbit_torque(numbers[:ORBIT_SIZE], rotation(x[3], x[4], x[5], x[6]), t)
    for i in range(3):
        force[3 + i] += torque[i]
    add_imbalance(numbers[ORBIT_SIZE:], x, span, force)
