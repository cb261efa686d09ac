"""From the sections of a trial file to a spacecraft in SI, checked."""

from typing import NamedTuple, Protocol

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft import layout as at
from flexslew_plant.testbeds.spacecraft.beam import (
    Beam,
    TipBody,
    closed_form_beam,
    finite_element_beam,
)
from flexslew_plant.testbeds.spacecraft.integrals import Integrals, second_of
from flexslew_plant.testbeds.spacecraft.membrane import membrane
from flexslew_plant.testbeds.spacecraft.modal_file import modal_shape
from flexslew_plant.testbeds.spacecraft.packing import (
    Appendage,
    Drive,
    Manoeuvre,
    Spacecraft,
    Wheel,
    require_physical,
    turn,
)
from flexslew_plant.testbeds.spacecraft.settings import (
    ActuatorPlace,
    AppendageSettings,
    Body,
    Damping,
    Hinge,
    Inertia,
    Motion,
    Platform,
    Rows,
    Triple,
    WheelSettings,
)
from flexslew_plant.testbeds.spacecraft.settings import Beam as BeamSettings
from flexslew_plant.testbeds.spacecraft.settings import Membrane as MembraneSettings
from flexslew_plant.testbeds.spacecraft.shape import FlexibleShape, Placed, Spot
from flexslew_plant.testbeds.spacecraft.units import UNITS, Units, UnitSystem

_PROFILES = {"smooth": at.SMOOTH, "bang_bang": at.BANG_BANG, "table": at.TABLE}
_MOTIONS = {"free": at.FREE, "held": at.HELD, "pivot": at.PIVOT}
_HINGES = {"fixed": at.FIXED, "prescribed": at.PRESCRIBED, "driven": at.DRIVEN}


class Described(Protocol):
    """What of a `testbed` section the physics needs."""

    @property
    def units(self) -> UnitSystem:
        """Of all its numbers."""

    @property
    def platform(self) -> Platform:
        """The rigid platform."""

    @property
    def appendages(self) -> dict[str, AppendageSettings]:
        """By name."""

    @property
    def wheels(self) -> dict[str, WheelSettings]:
        """By name."""

    @property
    def actuators(self) -> dict[str, ActuatorPlace]:
        """By name."""


def spacecraft(described: Described) -> Spacecraft:
    """Return the spacecraft in SI.

    Raises:
        BadInput: a body that cannot exist, directions that are not orthonormal, modes of the
            wrong shape, or a mass matrix that is not positive definite; with the numbers.
    """
    units, p = UNITS[described.units], described.platform
    mass, first, inertia = _rigid(
        Body(mass=p.mass, centre=p.centre, inertia=p.inertia), units, "testbed.platform"
    )
    parts = tuple(
        _appendage(name, a, units, f"testbed.appendages.{name}")
        for name, a in described.appendages.items()
    )
    wheels = tuple(
        Wheel(
            name,
            _unit(w.axis, f"testbed.wheels.{name}.axis"),
            w.inertia * units.torque,
            _largest_speed(w, units),
        )
        for name, w in described.wheels.items()
    )
    craft = Spacecraft(
        mass,
        first,
        inertia,
        parts,
        wheels,
        _drives(described, parts, units),
        _MOTIONS[p.motion],
        _unit(p.axis, "testbed.platform.axis"),
        np.array(p.place) * units.length,
    )
    require_positive_definite(craft)
    return craft


def require_positive_definite(craft: Spacecraft) -> None:
    """Check the mass matrix at rest, one appendage after another.

    Raises:
        BadInput: names the appendage and the lowest eigenvalue, masses scaled to one.
    """
    mass, first, inertia = craft.mass, craft.first.copy(), craft.inertia.copy()
    for w in craft.wheels:
        inertia = inertia - w.inertia * np.outer(w.axis, w.axis)
    blocks, modal = [np.zeros((6, 0))], np.zeros(0)
    for a in (None, *craft.appendages):
        if a is not None:
            seen = a.integrals.seen_from(a.place, a.axes)
            mass, first, inertia = mass + seen.mass, first + seen.first, inertia + seen.inertia
            blocks.append(np.vstack((seen.translation, seen.rotation)))
            modal = np.concatenate((modal, a.mass))
        across = np.hstack(blocks)
        full = np.block([[_rigid_block(mass, first, inertia), across], [across.T, np.diag(modal)]])
        scale = 1.0 / np.sqrt(abs(np.diag(full)))
        lowest = float(np.linalg.eigvalsh(scale[:, None] * full * scale).min())
        if not lowest > 1e-12:
            culprit = "wheels" if a is None else f"appendages.{a.name}"
            raise BadInput(
                f"testbed.{culprit}: the mass matrix with the platform is not positive definite: "
                f"lowest eigenvalue {lowest:.3g} (diagonal scaled to one); "
                "check its masses, inertias and participation factors"
            )


def _rigid_block(mass: float, first: Vector, inertia: Matrix) -> Matrix:
    x, y, z = first
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.block([[mass * np.eye(3), -skew], [skew, inertia]])


def _matrix(i: Inertia) -> Matrix:
    return np.array([[i.xx, i.xy, i.xz], [i.xy, i.yy, i.yz], [i.xz, i.yz, i.zz]])


def _rigid(body: Body, units: Units, key: str) -> tuple[float, Vector, Matrix]:
    """Return mass, first moment and inertia about the origin, in SI and checked."""
    mass, inertia = body.mass * units.mass, _matrix(body.inertia) * units.torque
    first = mass * np.array(body.centre) * units.length
    require_physical(mass, first, inertia, key)
    return mass, first, inertia


def _unit(direction: Triple, key: str) -> Vector:
    vector = np.array(direction, dtype=float)
    size = float(np.linalg.norm(vector))
    if size < 1e-9:
        raise BadInput(f"{key}: {list(direction)} has no direction")
    return vector / size


def _largest_speed(w: WheelSettings, units: Units) -> float:
    """Return the lower of a wheel's two limits [rad/s]."""
    by_momentum = np.inf if w.momentum_limit is None else w.momentum_limit / w.inertia
    return float(min(by_momentum, np.inf if w.speed_limit is None else w.speed_limit))


def _axes(rows: Rows, key: str) -> Matrix:
    """Return direction cosines, refused unless orthonormal and right-handed."""
    e = np.array(rows, dtype=float)
    off = float(abs(e @ e.T - np.eye(3)).max())
    if off > 1e-6 or np.linalg.det(e) < 0.0:
        hand = "left-handed" if off <= 1e-6 else f"off by {off:.3g}"
        raise BadInput(f"{key}: {e.tolist()} is not orthonormal and right-handed: {hand}")
    return e


def _appendage(name: str, a: AppendageSettings, units: Units, key: str) -> Appendage:
    if a.shape is None and a.body is None:
        raise BadInput(f"{key}: has neither shape nor body; give one of them")
    shape = None if a.shape is None else _shape(a.shape, units, key)
    if shape is not None and a.only_modes is not None:
        if max(a.only_modes, default=0) > shape.modes:
            raise BadInput(
                f"{key}.only_modes: {max(a.only_modes)} is not allowed: 1 to {shape.modes}"
            )
        shape = chosen_modes(shape, [k - 1 for k in a.only_modes])
    n = 0 if shape is None else shape.modes
    integrals = _nothing(n) if shape is None else shape.integrals
    if a.body is not None:
        mass, first, inertia = _rigid(a.body, units, f"{key}.body")
        integrals = _joined(integrals, mass, first, second_of(inertia))
    h = a.hinge
    axes = _axes(h.axes, f"{key}.hinge.axes")
    if h.turned is not None:
        axes = turn(_unit(h.turned.axis, f"{key}.hinge.turned.axis"), h.turned.angle) @ axes
    axis = _unit(h.axis, f"{key}.hinge.axis")
    manoeuvres = _manoeuvres(h, axis, f"{key}.hinge")
    kind = h.kind or ("prescribed" if manoeuvres else "fixed")
    modal_mass = np.zeros(0) if shape is None else shape.mass
    stiffness = np.zeros(0) if shape is None else a.stiffness * shape.stiffness
    own = None if shape is None or shape.damping is None else shape.damping * a.stiffness**0.5
    return Appendage(
        name,
        integrals if a.second_order else integrals.first_order(),
        modal_mass,
        stiffness,
        _damping(a.damping, modal_mass, stiffness, own, f"{key}.damping"),
        np.array(h.place) * units.length,
        axes,
        _HINGES[kind],
        axis,
        h.spring * units.torque,
        h.damper * units.torque,
        a.second_order,
        manoeuvres,
        shape,
    )


def _nothing(n: int) -> Integrals:
    return Integrals(
        0.0,
        np.zeros(3),
        np.zeros((3, 3)),
        np.zeros((3, n)),
        np.zeros((3, n)),
        np.zeros((n, 3, 3)),
        np.zeros((n, n, 3, 3)),
        np.zeros((n, n, 3)),
    )


def _joined(i: Integrals, mass: float, first: Vector, second: Matrix) -> Integrals:
    """Return the sums with a rigid body at the root, which no mode moves."""
    return Integrals(
        i.mass + mass,
        i.first + first,
        i.second + second,
        i.translation,
        i.rotation,
        i.second_1,
        i.second_2,
        i.gyroscopic,
    )


def _damping(d: Damping, mass: Vector, stiffness: Vector, own: Matrix | None, key: str) -> Matrix:
    """Return the modal damping matrix, shape (n, n)."""
    ratios = np.broadcast_to(d.ratio, (len(mass),)) if np.ndim(d.ratio) == 0 else np.array(d.ratio)
    if len(ratios) != len(mass):
        raise BadInput(f"{key}.ratio: {len(ratios)} numbers for {len(mass)} modes")
    modal = 2.0 * ratios * np.sqrt(mass * stiffness)
    both: Matrix = np.diag(d.alpha * mass + d.beta * stiffness + modal)
    return both if own is None else both + own


def _manoeuvres(h: Hinge, axis: Vector, key: str) -> tuple[Manoeuvre, ...]:
    """Return the prescribed motions of a hinge, checked against its range and each other."""
    given = (h.motion,) if isinstance(h.motion, Motion) else (h.motion or ())
    found: list[Manoeuvre] = []
    angle, end = 0.0, 0.0
    for k, m in enumerate(sorted(given, key=lambda motion: motion.at)):
        if h.range is not None and not h.range[0] <= m.to <= h.range[1]:
            raise BadInput(
                f"{key}.motion.{k}.to: {m.to:g} rad is outside of the range {h.range[0]:g} to "
                f"{h.range[1]:g} rad"
            )
        if m.at < end - 1e-12:
            raise BadInput(
                f"{key}.motion.{k}.at: begins at {m.at:g} s, before the last one ends at {end:g} s"
            )
        about = axis if m.axis is None else _unit(m.axis, f"{key}.motion.{k}.axis")
        table = np.array(m.table, dtype=float).reshape(-1, 4)
        if m.profile == "table":
            _require_table(table, f"{key}.motion.{k}.table")
        found.append(Manoeuvre(m.at, m.duration, m.to - angle, about, _PROFILES[m.profile], table))
        angle, end = m.to, m.at + m.duration
    return tuple(found)


def _require_table(table: Matrix, key: str) -> None:
    """Check that a table runs from rest to rest over times 0 to 1 that rise."""
    ends = len(table) >= 2 and (table[0] == 0.0).all() and (table[-1] == (1.0, 1.0, 0.0, 0.0)).all()
    if not ends or not (np.diff(table[:, 0]) > 0.0).all():
        raise BadInput(
            f"{key}: must rise in its first column from the row [0, 0, 0, 0] to [1, 1, 0, 0]"
        )


def _shape(shape: object, units: Units, key: str) -> FlexibleShape:
    """Return a flexible shape in SI, in appendage axes."""
    if isinstance(shape, BeamSettings):
        return _beam(shape, units, f"{key}.shape")
    if isinstance(shape, MembraneSettings):
        return membrane(
            shape.radius * units.length,
            shape.density * units.mass / units.length**2,
            shape.wave_speed * units.length,
            shape.height * units.length,
            shape.waves,
            shape.rings,
        )
    found = modal_shape(shape.file)  # type: ignore[attr-defined]
    kept = shape.modes  # type: ignore[attr-defined]
    if kept is not None and kept > found.modes:
        raise BadInput(f"{key}.shape.modes: {kept} is not allowed: the file has {found.modes}")
    return found if kept is None else chosen_modes(found, list(range(kept)))


class _Chosen(NamedTuple):
    """Places along a shape of which some modes count."""

    along: Placed
    modes: list[int]

    def spot(self, s: float) -> Spot:
        """Return what these modes do at the distance s."""
        return _chosen(self.along.spot(s), self.modes)


def _chosen(spot: Spot, n: list[int]) -> Spot:
    return Spot(spot.place, spot.displacement[:, n], spot.turn[:, n], spot.curvature[:, n])


def chosen_modes(shape: FlexibleShape, n: list[int]) -> FlexibleShape:
    """Return a shape with some of its modes, counted from 0."""
    i = shape.integrals
    return FlexibleShape(
        Integrals(
            i.mass,
            i.first,
            i.second,
            i.translation[:, n],
            i.rotation[:, n],
            i.second_1[n],
            i.second_2[np.ix_(n, n)],
            i.gyroscopic[np.ix_(n, n)],
        ),
        shape.mass[n],
        shape.stiffness[n],
        _chosen(shape.tip, n),
        shape.line,
        shape.line_shape[:, :, n],
        None if shape.along is None else _Chosen(shape.along, n),
        None if shape.damping is None else shape.damping[np.ix_(n, n)],
    )


class _Turned(NamedTuple):
    """Places along a beam, in appendage axes."""

    axes: Matrix  # beam to appendage
    along: Placed

    def spot(self, s: float) -> Spot:
        """Return what the modes do at the distance s."""
        return turned_spot(self.axes, self.along.spot(s))


def turned_spot(r: Matrix, spot: Spot) -> Spot:
    """Return a spot in other axes."""
    return Spot(r @ spot.place, r @ spot.displacement, r @ spot.turn, spot.curvature)


def _beam(b: BeamSettings, units: Units, key: str) -> FlexibleShape:
    z, x = _unit(b.along, f"{key}.along"), _unit(b.across, f"{key}.across")
    if abs(float(z @ x)) > 1e-6:
        raise BadInput(
            f"{key}.across: {list(b.across)} is not orthonormal to along {list(b.along)}: "
            f"their cosine is {float(z @ x):.3g}"
        )
    r = np.column_stack((x, np.cross(z, x), z))  # beam to appendage axes
    ei = np.broadcast_to(b.bending_stiffness, (2,)) * units.torque * units.length
    numbers = Beam(
        b.length * units.length,
        b.linear_density * units.mass / units.length,
        float(ei[0]),
        float(ei[1]),
        b.torsion_stiffness * units.torque * units.length,
        b.polar_inertia * units.mass * units.length,
    )
    if b.torsion_stiffness and not b.polar_inertia:
        raise BadInput(f"{key}.polar_inertia: must be positive for a beam that twists")
    if b.method == "closed_form":
        if b.tip_body is not None:
            raise BadInput(f"{key}.tip_body: needs method finite_elements")
        if b.modes_twist and not b.torsion_stiffness:
            raise BadInput(f"{key}.modes_twist: needs a torsion_stiffness")
        shape = closed_form_beam(numbers, b.modes_across, b.modes_third, b.modes_twist)
    else:
        largest = b.elements * (5 if b.torsion_stiffness else 4)
        if not 1 <= b.modes <= largest:
            raise BadInput(f"{key}.modes: {b.modes} is not allowed: 1 to {largest}")
        tip = None if b.tip_body is None else _tip(b.tip_body, units, r, f"{key}.tip_body")
        shape = finite_element_beam(numbers, tip, b.elements, b.modes)
    return FlexibleShape(
        shape.integrals.seen_from(np.zeros(3), r.T),
        shape.mass,
        shape.stiffness,
        turned_spot(r, shape.tip),
        shape.line @ r.T,
        np.einsum("ab,kbn->kan", r, shape.line_shape),
        None if shape.along is None else _Turned(r, shape.along),
        None,
    )


def _tip(body: Body, units: Units, r: Matrix, key: str) -> TipBody:
    """Return a tip body in beam axes."""
    mass, inertia = body.mass * units.mass, _matrix(body.inertia) * units.torque
    require_physical(mass, np.zeros(3), inertia, key)
    return TipBody(mass, r.T @ inertia @ r, r.T @ np.array(body.centre) * units.length)


def _drives(described: Described, parts: tuple[Appendage, ...], units: Units) -> tuple[Drive, ...]:
    """Return the actuators as listed, then the hinges' motors, then the wheels'."""
    names = [a.name for a in parts]
    found = []
    for name, d in described.actuators.items():
        key = f"testbed.actuators.{name}"
        direction = _unit(d.direction, f"{key}.direction")
        limit = d.limit * (units.force if d.kind == "force" else units.torque)
        if d.appendage is None:
            what = at.FORCE if d.kind == "force" else at.TORQUE
            empty = np.zeros((3, 0))
            spot = Spot(np.array(d.place) * units.length, empty, empty, np.zeros((2, 0)))
            found.append(Drive(name, what, -1, direction, spot, limit))
            continue
        if d.appendage not in names:
            raise BadInput(
                f"{key}.appendage: {d.appendage} is no appendage; allowed: {', '.join(names)}"
            )
        index = names.index(d.appendage)
        what = at.POINT_FORCE if d.kind == "force" else at.TIP_TORQUE
        found.append(Drive(name, what, index, direction, _spot(parts[index], d, units, key), limit))
    hinges = [(k, a) for k, a in enumerate(parts) if a.hinge == at.DRIVEN]
    for k, a in hinges:
        limit = described.appendages[a.name].hinge.limit * units.torque
        found.append(Drive(f"{a.name}_hinge", at.HINGE, k, np.zeros(3), None, limit))
    for k, (name, w) in enumerate(described.wheels.items()):
        found.append(Drive(name, at.WHEEL, k, np.zeros(3), None, w.limit * units.torque))
    twice = sorted({d.name for d in found if sum(e.name == d.name for e in found) > 1})
    if twice:
        raise BadInput(f"testbed: two actuators are called {twice[0]}")
    return tuple(found)


def _spot(a: Appendage, d: ActuatorPlace, units: Units, key: str) -> Spot:
    """Return where an actuator sits on an appendage."""
    if a.shape is None:
        empty = np.zeros((3, 0))
        return Spot(np.array(d.place) * units.length, empty, empty, np.zeros((2, 0)))
    if d.at is None:
        return a.shape.tip
    if a.shape.along is None:
        raise BadInput(f"{key}.at: {a.name} is no beam; leave it out for the tip")
    return a.shape.along.spot(d.at * units.length)
