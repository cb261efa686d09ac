"""A spacecraft as plain numbers in SI."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.shapes.integrals import Integrals
from flexslew_plant.testbeds.spacecraft.shapes.shape import AppendagePoint, FlexibleShape

_ROUNDED = 0.01  # of a mass, by which the effective mass of modes may be above it in a file


@dataclass(frozen=True)
class PrescribedRotation:
    """A turn of a prescribed hinge.

    Args:
        begin: [s].
        duration: [s].
        angle: of the turn [rad].
        axis: unit vector in appendage axes, shape (3,).
        profile: smooth, bang_bang or table (layout.SMOOTH ...).
        table: rows (s, share, slope, curvature) with s from 0 to 1, shape (k, 4).
    """

    begin: float
    duration: float
    angle: float
    axis: Vector
    profile: int = at.SMOOTH
    table: Matrix = field(default_factory=lambda: np.zeros((0, 4)))


@dataclass(frozen=True)
class Appendage:
    """What hangs on the platform.

    Args:
        name: its name.
        integrals: of all its points, rigid ones included.
        mass, stiffness: diagonals of the modal matrices, shape (n,).
        damping: modal damping matrix, shape (n, n).
        place: r_o of the hinge in body axes, shape (3,) [m].
        axes: E, body to appendage at angle zero, shape (3, 3).
        hinge: fixed, prescribed or driven (layout.FIXED ...).
        axis: of a driven hinge, unit vector in both frames, shape (3,).
        spring, damper: of a driven hinge [N m/rad, N m s/rad].
        second_order: whether terms of second order in the deflections count.
        manoeuvres: of a prescribed hinge, in the order of time.
        shape: what it was made from; none for a rigid one.
        alpha, beta: how much of the damping is alpha M + beta K [1/s, s].
    """

    name: str
    integrals: Integrals
    mass: Vector
    stiffness: Vector
    damping: Matrix
    place: Vector
    axes: Matrix
    hinge: int = at.FIXED
    axis: Vector = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    spring: float = 0.0
    damper: float = 0.0
    second_order: bool = True
    manoeuvres: tuple[PrescribedRotation, ...] = ()
    shape: FlexibleShape | None = None
    alpha: float = 0.0
    beta: float = 0.0

    @property
    def modes(self) -> int:
        """N."""
        return len(self.mass)


class Wheel(NamedTuple):
    """A reaction wheel; its mass and inertia at rest belong to the platform's."""

    name: str
    axis: Vector  # unit vector in body axes, (3,)
    inertia: float  # about it [kg m^2]
    largest_speed: float  # [rad/s]; infinite: no limit


class MomentGyro(NamedTuple):
    """A control moment gyro; its mass and inertia at rest belong to the platform's."""

    name: str
    axis: Vector  # g of its gimbal, unit vector in body axes, (3,)
    rotor: Vector  # s of its rotor at gimbal angle zero, unit vector across g, (3,)
    momentum: float  # of its rotor [N m s]

    @property
    def across(self) -> Vector:
        """G x s, along which it turns the platform at angle zero, shape (3,)."""
        return np.cross(self.axis, self.rotor)


def mass_warning(a: Appendage) -> str:
    """Return a warning if the modes of an appendage move more than its mass; else "".

    The effective masses L^2 / m of all modes of a structure add up to at most its mass, along every
    axis; L is the participation in translation and m the modal mass.
    """
    if not a.mass.size:
        return ""
    effective = np.sum(a.integrals.translation**2 / a.mass, axis=-1)
    max_axis, mass = int(np.argmax(effective)), a.integrals.mass
    if effective[max_axis] <= (1.0 + _ROUNDED) * mass:
        return ""
    return (
        f"appendage {a.name}: the effective mass of its modes along {'xyz'[max_axis]} is "
        f"{effective[max_axis]:,.6g} kg, its mass is {mass:,.6g} kg; look at the units of its "
        "modal "
        "data, unless the platform holds the rest of its mass"
    )


class SpacecraftActuator(NamedTuple):
    """An actuator; its effort is a force [N] or a torque [N m]."""

    name: str
    what: int  # layout.FORCE ...
    owner: int = -1  # appendage, wheel or gyro; -1: the platform
    direction: Vector = np.zeros(3)  # unit vector in the owner's axes
    point: AppendagePoint | None = None  # where it acts
    limit: float = np.inf

    @property
    def unit(self) -> str:
        """N or N m."""
        return "N" if self.what in (at.FORCE, at.POINT_FORCE, at.MODAL, at.THRUSTER) else "N m"


@dataclass(frozen=True)
class Spacecraft:
    """A platform with appendages, wheels and actuators.

    Args:
        mass: m_r [kg].
        first: S_r, first moment, shape (3,) [kg m].
        inertia: I_r about the body origin, shape (3, 3) [kg m^2].
        appendages, wheels, drives, gyros: what it carries.
        motion: free, held or about a pivot (layout.FREE ...).
        pivot_axis: unit vector in body axes, shape (3,).
        pivot_place: of the pivot in body axes, shape (3,) [m].
    """

    mass: float
    first: Vector
    inertia: Matrix
    appendages: tuple[Appendage, ...] = ()
    wheels: tuple[Wheel, ...] = ()
    drives: tuple[SpacecraftActuator, ...] = ()
    motion: int = at.FREE
    pivot_axis: Vector = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    pivot_place: Vector = field(default_factory=lambda: np.zeros(3))
    gyros: tuple[MomentGyro, ...] = ()

    @property
    def hinged(self) -> tuple[Appendage, ...]:
        """The appendages on driven hinges, in the order of their joints."""
        return tuple(a for a in self.appendages if a.hinge == at.DRIVEN)

    @property
    def modes(self) -> int:
        """Of all appendages together."""
        return sum(a.modes for a in self.appendages)

    @property
    def sizes(self) -> tuple[int, int]:
        """How many entries q and v have."""
        others = len(self.hinged) + len(self.wheels) + len(self.gyros) + self.modes
        platform_sizes = {at.FREE: (7, 6), at.HELD: (0, 0), at.PIVOT: (1, 1)}[self.motion]
        return platform_sizes[0] + others, platform_sizes[1] + others

    def first_mode(self, index: int) -> int:
        """Return where the modes of an appendage begin among all modes."""
        return sum(a.modes for a in self.appendages[:index])

    def rigid(self) -> tuple[float, Vector, Matrix]:
        """Return mass, first moment and inertia about the body origin, all undeformed."""
        mass, first, inertia = self.mass, self.first.copy(), self.inertia.copy()
        for a in self.appendages:
            seen = a.integrals.seen_from(a.place, a.axes)
            mass, first, inertia = mass + seen.mass, first + seen.first, inertia + seen.inertia
        return mass, first, inertia
