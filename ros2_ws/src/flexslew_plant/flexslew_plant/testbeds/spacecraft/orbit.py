"""What a circular orbit does to the attitude of a free platform: torques from outside.

With r the place, s the Sun, B the field in body axes, J the inertia about the centre of mass
(Wertz 1978, section 17.2; Hughes 1986, chapter 8):
    gravity gradient  3 n^2 r x J r,           drag      c_d x (-C_d A rho |v| v / 2),
    magnetic          m x B,                   sunlight  c_s x (-P (1 + q) A s).
They are couples: the orbit itself stays circular, and the appendages are not bent by them. There is
no shadow of the Earth, and its field is that of a dipole along the inertial z axis.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds.attitude import cross, to_body
from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft
from flexslew_plant.testbeds.spacecraft.settings import Triple

GRAVITY = 3.986004418e14  # of the Earth [m^3/s^2]
RADIUS = 6.371e6  # of the Earth [m]
FIELD = 3.12e-5  # at the surface above the equator [T]
SUNLIGHT = 4.56e-6  # pressure on what absorbs it [N/m^2]
_X, _SOUTH = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, -1.0])


@section
class Orbit:
    """A circular orbit, round the inertial origin, and what of it turns the craft."""

    altitude: Positive  # above the Earth's surface [m]
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


@dataclass(frozen=True)
class Surroundings:
    """A craft on its orbit.

    Args:
        orbit: its settings, in SI.
        inertia: of the undeformed craft about its centre of mass, shape (3, 3).
    """

    orbit: Orbit
    inertia: Matrix

    @cached_property
    def distance(self) -> float:
        """From the centre of the Earth [m]."""
        return RADIUS + self.orbit.altitude

    @cached_property
    def rate(self) -> float:
        """Of the orbit, n [rad/s]."""
        return float(np.sqrt(GRAVITY / self.distance**3))

    @cached_property
    def across(self) -> Vector:
        """Along the orbit's course where it crosses the inertial x axis, shape (3,)."""
        return np.array([0.0, np.cos(self.orbit.inclination), np.sin(self.orbit.inclination)])

    @cached_property
    def sun(self) -> Vector:
        """Unit vector to the Sun in inertial space, shape (3,)."""
        sun: Vector = np.array(self.orbit.sun) / np.linalg.norm(self.orbit.sun)
        return sun

    def torque(self, attitude: Matrix, t: float) -> Vector:
        """Return the torque in body axes, shape (3,) [N m].

        Args:
            attitude: from inertial to body axes, shape (3, 3).
            t: time [s].
        """
        o, angle = self.orbit, self.orbit.phase + self.rate * t
        cosine, sine = np.cos(angle), np.sin(angle)
        place = cosine * _X + sine * self.across
        torque = np.zeros(3)
        if o.gravity_gradient:
            up = attitude @ place
            torque += 3.0 * self.rate**2 * cross(up, self.inertia @ up)
        if any(o.dipole):
            field = (
                (3.0 * (_SOUTH @ place) * place - _SOUTH) * FIELD * (RADIUS / self.distance) ** 3
            )
            torque += cross(np.array(o.dipole), attitude @ field)
        if o.drag_area and o.air_density:
            course = cosine * self.across - sine * _X
            pressure = 0.5 * o.air_density * (self.rate * self.distance) ** 2
            torque += cross(np.array(o.drag_centre), -pressure * o.drag_area * (attitude @ course))
        if o.solar_area:
            light = attitude @ self.sun
            torque += cross(np.array(o.solar_centre), -SUNLIGHT * o.solar_area * light)
        return torque


def orbit_forces(craft: Spacecraft, orbit: Orbit) -> Callable[[Vector, float, float], Vector]:
    """Return what gives the generalised forces of the orbit; see Model.outside.

    Args:
        craft: the spacecraft.
        orbit: that it is on.
    """
    mass, first, inertia = craft.rigid()
    about = first / mass
    surroundings = Surroundings(
        orbit, inertia - mass * (about @ about * np.eye(3) - np.outer(about, about))
    )
    _, rates = craft.sizes

    def forces(x: Vector, t: float, span: float) -> Vector:
        found = np.zeros(rates)
        found[3:6] = surroundings.torque(to_body(x[3:7]), t)
        return found

    return forces
