"""Appendages of a trial file in SI: hinge, flexible shape, rigid body, damping."""

from dataclasses import replace

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft.assembly.bodies import (
    orthonormal,
    rigid_body,
    rotation_matrix,
    unit_direction,
)
from flexslew_plant.testbeds.spacecraft.assembly.craft import Appendage, PrescribedRotation
from flexslew_plant.testbeds.spacecraft.assembly.flexible import flexible_shape
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.settings import (
    AppendageSettings,
    Damping,
    Hinge,
    Motion,
)
from flexslew_plant.testbeds.spacecraft.shapes.integrals import (
    Integrals,
    first_order_integrals,
    second_of,
)
from flexslew_plant.testbeds.spacecraft.shapes.selected import select_modes
from flexslew_plant.testbeds.spacecraft.units import Units

_PROFILES = {"smooth": at.SMOOTH, "bang_bang": at.BANG_BANG, "table": at.TABLE}

_HINGES = {
    "fixed": at.FIXED,
    "prescribed": at.PRESCRIBED,
    "driven": at.DRIVEN,
    "passive": at.DRIVEN,  # by spring and damper alone
}

_PLAIN = Hinge()
_NOTHING = first_order_integrals(0.0, np.zeros(3), np.zeros((3, 3)), *np.zeros((2, 3, 0)))

# keys of a hinge by which kinds have them; a retarget turns a fixed one
_ONLY = {
    "spring": ("driven", "passive"),
    "damper": ("driven", "passive"),
    "limit": ("driven",),
    "range": ("fixed", "prescribed"),
    "motion": ("prescribed",),
}

_POINTING_TOLERANCE = 1e-6  # between a target and where a hinge can point [rad]


def appendage_of(name: str, a: AppendageSettings, units: Units, key: str) -> Appendage:
    """Return an appendage in SI; BadInput, by its key, if it cannot exist."""
    if a.shape is None and a.body is None:
        raise BadInput(f"{key}: has neither shape nor body; give one of them")
    shape = None if a.shape is None else flexible_shape(a.shape, units, key)
    if shape is not None and a.only_modes is not None:
        if max(a.only_modes, default=0) > shape.modes:
            raise BadInput(f"1 to {shape.modes}", key=f"{key}.only_modes", value=max(a.only_modes))
        shape = select_modes(shape, [k - 1 for k in a.only_modes])
    integrals = _NOTHING if shape is None else shape.integrals
    _require_known(a, integrals, key)
    if a.geometric_stiffness is False:
        integrals = replace(integrals, shortening=None)
    if a.body is not None:
        mass, first, inertia = rigid_body(a.body, units, f"{key}.body")
        integrals = replace(
            integrals,
            mass=integrals.mass + mass,
            first=integrals.first + first,
            second=integrals.second + second_of(inertia),
        )
    h = a.hinge
    axes = orthonormal(h.axes, f"{key}.hinge.axes")
    if h.turned is not None:
        axes = (
            rotation_matrix(
                unit_direction(h.turned.axis, f"{key}.hinge.turned.axis"), h.turned.angle
            )
            @ axes
        )
    axis = unit_direction(h.axis, f"{key}.hinge.axis")
    manoeuvres = _manoeuvres(h, axis, axes, f"{key}.hinge")
    kind = h.kind or ("prescribed" if manoeuvres else "fixed")
    for part, kinds in _ONLY.items():
        if kind not in kinds and getattr(h, part) != getattr(_PLAIN, part):
            raise BadInput(
                f"{key}.hinge.{part}: a {kind} hinge has none; leave it out or use kind: "
                f"{' or '.join(kinds)}"
            )
    modal_mass = np.zeros(0) if shape is None else shape.mass
    stiffness = np.zeros(0) if shape is None else a.stiffness * shape.stiffness
    shape_damping = (
        None if shape is None or shape.damping is None else shape.damping * a.stiffness**0.5
    )
    return Appendage(
        name,
        integrals if a.second_order else integrals.first_order(),
        modal_mass,
        stiffness,
        _damping(a.damping, modal_mass, stiffness, shape_damping, f"{key}.damping"),
        np.array(h.place) * units.length,
        axes,
        _HINGES[kind],
        axis,
        h.spring * units.torque,
        h.damper * units.torque,
        a.second_order,
        manoeuvres,
        shape,
        a.damping.alpha,
        a.damping.beta,
    )


def _require_known(a: AppendageSettings, integrals: Integrals, key: str) -> None:
    """Check that a requested geometric stiffness is available."""
    if a.geometric_stiffness and not a.second_order:
        raise BadInput(f"{key}.geometric_stiffness: true is not allowed without second_order")
    if a.geometric_stiffness and integrals.shortening is None:
        raise BadInput(
            f"{key}.geometric_stiffness: true is not allowed: the modal data have no key "
            "geometric_stiffness; leave it out or add the matrices to the file"
        )


def _damping(
    d: Damping, mass: Vector, stiffness: Vector, shape_damping: Matrix | None, key: str
) -> Matrix:
    """Return the modal damping matrix, shape (n, n)."""
    ratios = np.broadcast_to(d.ratio, (len(mass),)) if np.ndim(d.ratio) == 0 else np.array(d.ratio)
    if len(ratios) != len(mass):
        raise BadInput(f"{key}.ratio: {len(ratios)} numbers for {len(mass)} modes")
    modal = 2.0 * ratios * np.sqrt(mass * stiffness)
    matrix: Matrix = np.diag(d.alpha * mass + d.beta * stiffness + modal)
    return matrix if shape_damping is None else matrix + shape_damping


def _manoeuvres(h: Hinge, axis: Vector, axes: Matrix, key: str) -> tuple[PrescribedRotation, ...]:
    """Return the prescribed motions of a hinge, checked against its range and each other."""
    given = (h.motion,) if isinstance(h.motion, Motion) else (h.motion or ())
    found: list[PrescribedRotation] = []
    angle, end = 0.0, 0.0
    for k, m in sorted(enumerate(given), key=lambda pair: pair[1].at):
        to = _target(m, axis, axes, f"{key}.motion.{k}")
        if h.range is not None and not h.range[0] <= to <= h.range[1]:
            raise BadInput(
                f"{key}.motion.{k}.to: {to:g} rad is outside of the range {h.range[0]:g} to "
                f"{h.range[1]:g} rad"
            )
        if m.at < end - 1e-12:
            raise BadInput(
                f"{key}.motion.{k}.at: begins at {m.at:g} s, before the last one ends at {end:g} s"
            )
        rotation_axis = axis if m.axis is None else unit_direction(m.axis, f"{key}.motion.{k}.axis")
        table = np.array(m.table, dtype=float).reshape(-1, 4)
        if m.profile == "table":
            _require_table(table, f"{key}.motion.{k}.table")
        found.append(
            PrescribedRotation(
                m.at, m.duration, to - angle, rotation_axis, _PROFILES[m.profile], table
            )
        )
        angle, end = to, m.at + m.duration
    return tuple(found)


def _target(m: Motion, axis: Vector, axes: Matrix, key: str) -> float:
    """Return the angle of a hinge at which its appendage points to the target [rad].

    Args:
        m: the motion.
        axis: of the hinge, in appendage axes, shape (3,).
        axes: body to appendage at angle zero, shape (3, 3).
        key: for an error.

    Raises:
        BadInput: there is not one target, or no angle of the hinge points there.
    """
    if (m.to is None) == (m.line_of_sight is None):
        raise BadInput(f"{key}: give one of to and line_of_sight")
    if m.to is not None:
        return m.to
    assert m.line_of_sight is not None
    requested = axes @ unit_direction(m.line_of_sight, f"{key}.line_of_sight")
    z = np.array([0.0, 0.0, 1.0])
    normal, target = z - (z @ axis) * axis, requested - (requested @ axis) * axis
    angle = float(np.arctan2(axis @ np.cross(normal, target), normal @ target))
    angle_error = float(
        np.arccos(np.clip(rotation_matrix(axis, angle).T @ z @ requested, -1.0, 1.0))
    )
    if angle_error > _POINTING_TOLERANCE:
        raise BadInput(
            f"the hinge turns about {axis.round(6).tolist()} and comes within {angle_error:.4g} "
            "rad of it at best",
            key=f"{key}.line_of_sight",
            value=list(m.line_of_sight),
        )
    return angle


def _require_table(table: Matrix, key: str) -> None:
    """Check that a table runs from rest to rest over times 0 to 1 that rise."""
    ends = len(table) >= 2 and (table[0] == 0.0).all() and (table[-1] == (1.0, 1.0, 0.0, 0.0)).all()
    if not ends or not (np.diff(table[:, 0]) > 0.0).all():
        raise BadInput(
            f"{key}: must rise in its first column from the row [0, 0, 0, 0] to [1, 1, 0, 0]"
        )
