"""What a circular orbit does to the attitude of a free platform: torques from outside.

With r the place, s the Sun, B the field in body axes, J the inertia about the centre of mass
(Wertz 1978, section 17.2; Hughes 1986, chapter 8):
    gravity gradient  3 n^2 r x J r,           drag      c_d x (-C_d A rho |v| v / 2),
    magnetic          m x B,                   sunlight  c_s x (-P (1 + q) A s).
They are couples: the orbit itself stays circular, and the appendages are not bent by them, nor
hinges turned; J is that of the undeformed craft as its hinges stand. There is
no shadow of the Earth, and its field is that of a dipole along the inertial z axis.
"""

from typing import Annotated

import numpy as np
from pydantic import Field

from flexslew_plant.arrays import Vector, compiled_once
from flexslew_plant.settings import NonNegative, section
from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft
from flexslew_plant.testbeds.spacecraft.equations.geometry import (
    Matrix3,
    apply,
    cross,
    plus,
    scaled,
    symmetric,
    triple,
)
from flexslew_plant.testbeds.spacecraft.settings import Triple
from flexslew_plant.testbeds.spacecraft.shapes.integrals import SYMMETRIC_ENTRIES, point_inertia

GRAVITY = 3.986004418e14  # of the Earth [m^3/s^2]
RADIUS = 6.371e6  # of the Earth [m]
FIELD = 3.12e-5  # at the surface above the equator [T]
SOLAR_FORCE_PER_AREA = 4.56e-6  # pressure on what absorbs it [N/m^2]

# where the numbers that orbit_torque reads begin: n, the angle at time zero, the course at angle
# zero, m times the field above the equator, -C_d A rho v^2 / 2 c_d, -P (1 + q) A c_s, s, 3 n^2 J,
# 3 n^2
_RATE, _PHASE, _VELOCITY, _DIPOLE, _DRAG, _LIGHT, _SUN = 0, 1, 2, 5, 8, 11, 14
GRADIENT, GRADIENT_OF_ONE = 17, 23
ORBIT_SIZE = 24  # all zeros: there is no orbit


@section
class Orbit:
    """A circular orbit, round the inertial origin, and what of it turns the craft."""

    altitude: Annotated[float, Field(gt=0.0, le=1e12)]  # above the Earth's surface [m]
    inclination: float = 0.0  # of the orbit to the inertial x-y plane, about x [rad]
    phase: float = 0.0  # of the craft at time zero, from x [rad]
    gravity_gradient: bool = True  # whether it acts
    # magnetic, of the craft, in body axes [A m^2]; the Earth's is along the inertial z
    dipole: Triple = (0.0, 0.0, 0.0)
    drag_area: NonNegative = 0.0  # area times drag coefficient [m^2]
    air_density: NonNegative = 0.0  # at this altitude [kg/m^3]
    # centre of the air's pressure, from the centre of mass [m]
    drag_centre: Triple = (0.0, 0.0, 0.0)
    solar_area: NonNegative = 0.0  # area times one plus its reflectivity [m^2]
    # centre of the light's pressure, from the centre of mass [m]
    solar_centre: Triple = (0.0, 0.0, 0.0)
    sun: Triple = (1.0, 0.0, 0.0)  # direction to the Sun in inertial space, of any length


@compiled_once()
def orbit_torque(o: Vector, attitude: Matrix3, t: float) -> Triple:
    """Return the torque of an orbit in body axes [N m].

    Args:
        o: see packed_orbit.
        attitude: from inertial to body axes, row by row.
        t: time [s].
    """
    angle = o[_PHASE] + o[_RATE] * t
    cosine, sine = np.cos(angle), np.sin(angle)
    x, start_velocity = (1.0, 0.0, 0.0), triple(o, _VELOCITY)
    place = plus(scaled(cosine, x), scaled(sine, start_velocity))
    velocity = plus(scaled(cosine, start_velocity), scaled(-sine, x))
    field = plus(scaled(-3.0 * place[2], place), (0.0, 0.0, 1.0))  # of a dipole to the south
    up = apply(attitude, place)
    torque = cross(up, symmetric(o[GRADIENT:], up))
    torque = plus(torque, cross(triple(o, _DIPOLE), apply(attitude, field)))
    torque = plus(torque, cross(triple(o, _DRAG), apply(attitude, velocity)))
    return plus(torque, cross(triple(o, _LIGHT), apply(attitude, triple(o, _SUN))))


def packed_orbit(spacecraft: Spacecraft, orbit: Orbit | None) -> Vector:
    """Return the numbers that orbit_torque reads for a craft on an orbit, or on none."""
    packed = np.zeros(ORBIT_SIZE)
    if orbit is None:
        return packed
    distance = RADIUS + orbit.altitude  # from the centre of the Earth [m]
    rate = float(np.sqrt(GRAVITY / distance**3))
    dynamic = 0.5 * orbit.air_density * (rate * distance) ** 2  # pressure of the air
    packed[_RATE], packed[_PHASE] = rate, orbit.phase
    packed[_VELOCITY:_DIPOLE] = 0.0, np.cos(orbit.inclination), np.sin(orbit.inclination)
    packed[_DIPOLE:_DRAG] = FIELD * (RADIUS / distance) ** 3 * np.array(orbit.dipole)
    packed[_DRAG:_LIGHT] = -dynamic * orbit.drag_area * np.array(orbit.drag_centre)
    if orbit.solar_area:
        pressure = -SOLAR_FORCE_PER_AREA * orbit.solar_area
        packed[_LIGHT:_SUN] = pressure * np.array(orbit.solar_centre)
        packed[_SUN:GRADIENT] = np.array(orbit.sun) / np.linalg.norm(orbit.sun)
    if orbit.gravity_gradient:
        mass, first, inertia = spacecraft.rigid()  # undeformed, hinges at zero
        central = inertia - mass * point_inertia(first / mass)
        factor = 3.0 * rate**2
        packed[GRADIENT:GRADIENT_OF_ONE] = [factor * central[k] for k in SYMMETRIC_ENTRIES]
        packed[GRADIENT_OF_ONE] = factor
    return packed
