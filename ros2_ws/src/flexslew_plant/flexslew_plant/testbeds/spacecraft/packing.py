"""A spacecraft as plain numbers in SI, and packed into the vector that the kernels read."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft import layout as at
from flexslew_plant.testbeds.spacecraft.integrals import SIX, Integrals, inertia_of
from flexslew_plant.testbeds.spacecraft.shape import FlexibleShape, Spot


@dataclass(frozen=True)
class Manoeuvre:
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
    manoeuvres: tuple[Manoeuvre, ...] = ()
    shape: FlexibleShape | None = None

    @property
    def modes(self) -> int:
        """N."""
        return len(self.mass)


class Wheel(NamedTuple):
    """A reaction wheel, whose mass and inertia at rest belong to the platform's."""

    name: str
    axis: Vector  # unit vector in body axes, (3,)
    inertia: float  # about it [kg m^2]
    largest_speed: float  # [rad/s]; infinite: no limit


class Drive(NamedTuple):
    """An actuator; its effort is a force [N] or a torque [N m]."""

    name: str
    what: int  # layout.FORCE ...
    owner: int = -1  # appendage or wheel; -1: the platform
    direction: Vector = np.zeros(3)  # unit vector in the owner's axes
    spot: Spot | None = None  # where it acts
    limit: float = np.inf

    @property
    def unit(self) -> str:
        """N or N m."""
        return "N" if self.what in (at.FORCE, at.POINT_FORCE) else "N m"


@dataclass(frozen=True)
class Spacecraft:
    """A platform with appendages, wheels and actuators.

    Args:
        mass: m_r [kg].
        first: S_r, first moment, shape (3,) [kg m].
        inertia: I_r about the body origin, shape (3, 3) [kg m^2].
        appendages, wheels, drives: what it carries.
        motion: free, held or about a pivot (layout.FREE ...).
        pivot_axis: unit vector in body axes, shape (3,).
        pivot_place: of the pivot in body axes, shape (3,) [m].
    """

    mass: float
    first: Vector
    inertia: Matrix
    appendages: tuple[Appendage, ...] = ()
    wheels: tuple[Wheel, ...] = ()
    drives: tuple[Drive, ...] = ()
    motion: int = at.FREE
    pivot_axis: Vector = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    pivot_place: Vector = field(default_factory=lambda: np.zeros(3))

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
        others = len(self.hinged) + len(self.wheels) + self.modes
        own = {at.FREE: (7, 6), at.HELD: (0, 0), at.PIVOT: (1, 1)}[self.motion]
        return own[0] + others, own[1] + others

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


def packed(craft: Spacecraft) -> Vector:
    """Return the numbers as layout says.

    Raises:
        BadInput: an appendage is heavier in motion than it is as a whole: its modal masses and
            participation are not positive definite with the platform.
    """
    mass, first, inertia = craft.mass, craft.first.copy(), craft.inertia.copy()
    blocks: list[Vector] = []
    hinge = start = 0
    for a in craft.appendages:
        i = a.integrals
        if a.hinge == at.FIXED:  # in body axes once and for all
            i = i.seen_from(a.place, a.axes)
            mass, first, inertia = mass + i.mass, first + i.first, inertia + i.inertia
        blocks.append(_block(a, i, start, hinge))
        start += a.modes
        hinge += a.hinge == at.DRIVEN
    head = np.zeros(at.HEAD)
    head[at.MOTION], head[at.HINGES] = craft.motion, hinge
    head[at.WHEELS], head[at.MODES] = len(craft.wheels), start
    head[at.APPENDAGES], head[at.ACTUATORS] = len(blocks), len(craft.drives)
    axis = craft.pivot_axis
    head[at.PIVOT_AXES : at.PIVOT_AXES + 6] = [*np.cross(craft.pivot_place, axis), *axis]
    head[at.MASS], head[at.FIRST : at.FIRST + 3] = mass, first
    head[at.INERTIA : at.INERTIA + 6] = [inertia[k] for k in SIX]
    wheels = [np.append(w.axis, w.inertia) for w in craft.wheels]
    # tables first, then what they point to
    head[at.APPENDAGE_TABLE] = at.HEAD
    head[at.ACTUATOR_TABLE] = at.HEAD + len(blocks)
    head[at.WHEEL_TABLE] = head[at.ACTUATOR_TABLE] + len(craft.drives)
    position = int(head[at.WHEEL_TABLE]) + at.WHEEL_SIZE * len(wheels)
    places = []
    for block, a in zip(blocks, craft.appendages, strict=True):
        places.append(position)
        _place_manoeuvres(block, a, position)
        position += len(block)
    drives = [_drive(craft, d, places) for d in craft.drives]
    ends = np.cumsum([position, *map(len, drives)])
    tables = np.array([*places, *ends[:-1]], dtype=float)
    p: Vector = np.concatenate((head, tables, *wheels, *blocks, *drives))
    return p


def _block(a: Appendage, i: Integrals, start: int, hinge: int) -> Vector:
    """Return the block of an appendage, its manoeuvres' place still relative to it."""
    n = a.modes
    head = np.zeros(at.SUMS)
    head[at.KIND], head[at.COUNT], head[at.START] = a.hinge, n, start
    head[at.HINGE_INDEX], head[at.SECOND_ORDER] = hinge, a.second_order and n > 0
    head[at.PLACE : at.PLACE + 3] = a.place
    head[at.AXES : at.AXES + 9] = a.axes.ravel()
    head[at.AXIS : at.AXIS + 3] = a.axis
    head[at.HINGE_STIFFNESS], head[at.HINGE_DAMPING] = a.spring, a.damper
    if a.hinge != at.FIXED:
        head[at.OWN_MASS], head[at.OWN_FIRST : at.OWN_FIRST + 3] = i.mass, i.first
        head[at.OWN_INERTIA : at.OWN_INERTIA + 6] = [i.inertia[k] for k in SIX]
    one, two = inertia_of(i.second_1), inertia_of(i.second_2)
    base = np.concatenate([*(one[:, r, c] for r, c in SIX), *i.rotation]).reshape(9 * n)
    rows = np.concatenate(
        [*(two[:, :, r, c] for r, c in SIX), *(i.gyroscopic[:, :, k] for k in range(3))], axis=1
    )
    if not a.second_order:
        rows = np.zeros_like(rows)
    sums = (i.translation.ravel(), base, rows.ravel(), a.mass, a.stiffness, a.damping.ravel())
    return np.concatenate((head, *sums, *_manoeuvres(a)))


def _manoeuvres(a: Appendage) -> list[Vector]:
    """Return the manoeuvres of a hinge, each from the axes where the last one ended."""
    axes, rows = a.axes, []
    for m in a.manoeuvres:
        row = np.zeros(at.MANOEUVRE_SIZE)
        row[: at.TURN_AXIS] = m.begin, m.duration, m.angle, m.profile, 0.0, len(m.table)
        row[at.TURN_AXIS : at.TURN_AXIS + 3] = m.axis
        row[at.FROM_AXES :] = axes.ravel()
        axes = turn(m.axis, m.angle) @ axes
        rows.append(row)
    return rows + [m.table.ravel() for m in a.manoeuvres]


def _place_manoeuvres(block: Vector, a: Appendage, position: int) -> None:
    """Write where the manoeuvres and their tables lie once the block lies at `position`."""
    tables = sum(m.table.size for m in a.manoeuvres)
    begin = len(block) - tables - at.MANOEUVRE_SIZE * len(a.manoeuvres)
    block[at.MOTION_AT], block[at.MANOEUVRES] = position + begin, len(a.manoeuvres)
    table = position + len(block) - tables
    for k, m in enumerate(a.manoeuvres):
        block[begin + k * at.MANOEUVRE_SIZE + at.TABLE_AT] = table
        table += m.table.size


def turn(axis: Vector, angle: float) -> Matrix:
    """Return the direction cosines of a frame turned by angle about axis, shape (3, 3)."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    cosines: Matrix = np.eye(3) - np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew
    return cosines


def _drive(craft: Spacecraft, d: Drive, places: list[int]) -> Vector:
    """Return the block of an actuator; see layout."""
    head = np.zeros(at.SHAPES)
    direction = np.asarray(d.direction, dtype=float)
    spot = d.spot
    head[at.WHAT], head[at.WHOSE], head[at.BOUND] = d.what, -1, np.inf
    if d.what == at.WHEEL:
        wheel = craft.wheels[d.owner]
        head[at.INDEX], head[at.BOUND], direction = d.owner, wheel.largest_speed, wheel.axis
    elif d.what == at.HINGE:
        before = craft.appendages[: d.owner]
        head[at.INDEX] = sum(a.hinge == at.DRIVEN for a in before)
    elif spot is not None and d.owner >= 0:
        a = craft.appendages[d.owner]
        head[at.WHOSE] = places[d.owner]
        if a.hinge == at.FIXED:  # its numbers are in body axes
            r = a.axes.T
            direction = r @ direction
            spot = Spot(
                a.place + r @ spot.place, r @ spot.displacement, r @ spot.turn, spot.curvature
            )
    if spot is not None:
        head[at.AT : at.AT + 3] = spot.place
    head[at.DIRECTION : at.DIRECTION + 3] = direction
    if spot is None or d.owner < 0 or d.what in (at.WHEEL, at.HINGE):
        return head
    works = spot.turn if d.what == at.TIP_TORQUE else spot.displacement
    return np.concatenate((head, spot.displacement.ravel(), works.T @ direction))


def require_physical(mass: float, first: Vector, inertia: Matrix, key: str) -> None:
    """Check that a mass, first moment and inertia are those of a body.

    Args:
        mass: [kg].
        first: about the origin, shape (3,) [kg m].
        inertia: about the origin, shape (3, 3) [kg m^2].
        key: of the settings, for the message.

    Raises:
        BadInput: the mass is not positive or the inertia about the centre of mass violates the
            triangle inequality.
    """
    if not mass > 0.0:
        raise BadInput(f"{key}: mass {mass:g} kg is not positive")
    centre = first / mass
    own = inertia - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    a, b, c = np.linalg.eigvalsh(own)
    if a < -1e-9 * abs(c) or a + b < c * (1.0 - 1e-5):
        raise BadInput(
            f"{key}: principal inertias {a:.6g}, {b:.6g}, {c:.6g} kg m^2 about the centre of mass "
            f"violate the triangle inequality: {a:.6g} + {b:.6g} < {c:.6g}"
        )
