"""What moves a free platform besides its efforts: its orbit, and wheels that are not balanced."""

from collections.abc import Mapping

import numpy as np

from flexslew_plant.arrays import Vector, compiled_once
from flexslew_plant.testbeds.outside import Outside
from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft
from flexslew_plant.testbeds.spacecraft.assembly.packing import packed
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.equations.geometry import rotation
from flexslew_plant.testbeds.spacecraft.equations.whole import inertia_of_whole
from flexslew_plant.testbeds.spacecraft.imbalance import add_imbalance, packed_imbalance
from flexslew_plant.testbeds.spacecraft.orbit import (
    GRADIENT,
    GRADIENT_OF_ONE,
    ORBIT_SIZE,
    Orbit,
    orbit_torque,
    packed_orbit,
)
from flexslew_plant.testbeds.spacecraft.settings import WheelSettings
from flexslew_plant.testbeds.spacecraft.units import Units


def outside_of(
    spacecraft: Spacecraft, orbit: Orbit | None, wheels: Mapping[str, WheelSettings], units: Units
) -> Outside | None:
    """Return what orbit and wheels off balance do to a free platform; None: nothing."""
    harmonics = packed_imbalance(spacecraft, wheels, units)
    if orbit is None and not harmonics.size:
        return None
    orbit_numbers = packed_orbit(spacecraft, orbit)
    has_hinges = any(a.hinge != at.FIXED for a in spacecraft.appendages)
    whole = packed(spacecraft) if has_hinges and orbit_numbers[GRADIENT_OF_ONE] else np.zeros(0)
    spacecraft_start = np.array([ORBIT_SIZE + harmonics.size + 1.0])
    numbers = np.concatenate((orbit_numbers, spacecraft_start, harmonics, whole))
    return Outside(add_forces, numbers, spacecraft.sizes[1])


@compiled_once("force")
def add_forces(numbers: Vector, x: Vector, t: float, span: float, force: Vector) -> None:
    """Add the forces of orbit and wheels; see Outside.add.

    Args:
        numbers: packed_orbit, where a packed spacecraft begins, packed_imbalance, and that
            spacecraft if hinges turn in the gravity gradient.
        x: state.
        t: time [s].
        span: [s].
        force: in and out.
    """
    orbit, whole = numbers[:ORBIT_SIZE], int(numbers[ORBIT_SIZE])
    if whole < numbers.size:
        orbit = orbit.copy()
        inertia = inertia_of_whole(numbers[whole:], x, t)
        for i in range(6):
            orbit[GRADIENT + i] = orbit[GRADIENT_OF_ONE] * inertia[i]
    torque = orbit_torque(orbit, rotation(x[3], x[4], x[5], x[6]), t)
    for i in range(3):
        force[3 + i] += torque[i]
    add_imbalance(numbers[ORBIT_SIZE + 1 : whole], x, span, force)
