"""A spacecraft packed into the vector that the kernels read."""

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds.spacecraft.assembly.bodies import rotation_matrix
from flexslew_plant.testbeds.spacecraft.assembly.craft import (
    Appendage,
    Spacecraft,
    SpacecraftActuator,
)
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.shapes.integrals import (
    SYMMETRIC_ENTRIES,
    Integrals,
    inertia_of,
)
from flexslew_plant.testbeds.spacecraft.shapes.shape import AppendagePoint


def packed(spacecraft: Spacecraft) -> Vector:
    """Return the numbers of a spacecraft in the order of layout.

    Raises:
        BadInput: an appendage is heavier in motion than it is as a whole: its modal masses and
            participation are not positive definite with the platform.
    """
    mass, first, inertia = spacecraft.mass, spacecraft.first.copy(), spacecraft.inertia.copy()
    blocks: list[Vector] = []
    hinge = start = 0
    for a in spacecraft.appendages:
        i = a.integrals
        if a.hinge == at.FIXED:  # in body axes once and for all
            i = i.seen_from(a.place, a.axes)
            mass, first, inertia = mass + i.mass, first + i.first, inertia + i.inertia
        blocks.append(_block(a, i, start, hinge))
        start += a.modes
        hinge += a.hinge == at.DRIVEN
    head = np.zeros(at.HEAD)
    head[at.MOTION], head[at.HINGES] = spacecraft.motion, hinge
    head[at.WHEELS], head[at.MODES] = len(spacecraft.wheels) + len(spacecraft.gyros), start
    head[at.APPENDAGES], head[at.ACTUATORS] = len(blocks), len(spacecraft.drives)
    axis = spacecraft.pivot_axis
    head[at.PIVOT_AXES : at.PIVOT_AXES + 6] = [*np.cross(spacecraft.pivot_place, axis), *axis]
    head[at.MASS], head[at.FIRST : at.FIRST + 3] = mass, first
    head[at.INERTIA : at.INERTIA + 6] = [inertia[k] for k in SYMMETRIC_ENTRIES]
    wheels = [np.array([*w.axis, w.inertia, 0.0, 0.0, 0.0, 0.0]) for w in spacecraft.wheels]
    wheels += [np.array([*g.axis, 0.0, g.momentum, *g.rotor]) for g in spacecraft.gyros]
    # tables first, then what they point to
    head[at.APPENDAGE_TABLE] = at.HEAD
    head[at.ACTUATOR_TABLE] = at.HEAD + len(blocks)
    head[at.WHEEL_TABLE] = head[at.ACTUATOR_TABLE] + len(spacecraft.drives)
    position = int(head[at.WHEEL_TABLE]) + at.WHEEL_SIZE * len(wheels)
    places = []
    for block, a in zip(blocks, spacecraft.appendages, strict=True):
        places.append(position)
        _place_manoeuvres(block, a, position)
        position += len(block)
    actuator_blocks = [_actuator_block(spacecraft, d, places) for d in spacecraft.drives]
    ends = np.cumsum([position, *map(len, actuator_blocks)])
    tables = np.array([*places, *ends[:-1]], dtype=float)
    p: Vector = np.concatenate((head, tables, *wheels, *blocks, *actuator_blocks))
    return p


def _block(a: Appendage, i: Integrals, start: int, hinge: int) -> Vector:
    """Return the block of an appendage, its manoeuvres' place still relative to it."""
    n = a.modes
    head = np.zeros(at.SUMS)
    head[at.KIND], head[at.COUNT], head[at.START] = a.hinge, n, start
    head[at.HINGE_INDEX], head[at.SECOND_ORDER] = hinge, a.second_order and n > 0
    head[at.GEOMETRIC] = i.shortening is not None and n > 0
    head[at.PLACE : at.PLACE + 3] = a.place
    head[at.AXES : at.AXES + 9] = a.axes.ravel()
    head[at.AXIS : at.AXIS + 3] = a.axis
    head[at.HINGE_STIFFNESS], head[at.HINGE_DAMPING] = a.spring, a.damper
    if a.hinge != at.FIXED:
        head[at.BODY_MASS], head[at.BODY_FIRST : at.BODY_FIRST + 3] = i.mass, i.first
        head[at.BODY_INERTIA : at.BODY_INERTIA + 6] = [i.inertia[k] for k in SYMMETRIC_ENTRIES]
    one, two = inertia_of(i.second_1), inertia_of(i.second_2)
    extra: tuple[Vector, ...] = ()
    if i.shortening is not None:
        two = two + i.shortening.inertia
        parts = (i.shortening.first, i.shortening.rotation)
        columns = [part[:, :, k] for part in parts for k in range(3)]
        extra = (np.concatenate(columns, axis=1).ravel(),)
    base = np.concatenate([*(one[:, r, c] for r, c in SYMMETRIC_ENTRIES), *i.rotation]).reshape(
        9 * n
    )
    rows = np.concatenate(
        [
            *(two[:, :, r, c] for r, c in SYMMETRIC_ENTRIES),
            *(i.gyroscopic[:, :, k] for k in range(3)),
        ],
        axis=1,
    )
    if not a.second_order:
        rows = np.zeros_like(rows)
    sums = (i.translation.ravel(), base, rows.ravel(), a.mass, a.stiffness, a.damping.ravel())
    return np.concatenate((head, *sums, *extra, *_manoeuvres(a)))


def _manoeuvres(a: Appendage) -> list[Vector]:
    """Return the manoeuvres of a hinge, each from the axes where the last one ended."""
    axes, rows = a.axes, []
    for m in a.manoeuvres:
        row = np.zeros(at.MANOEUVRE_SIZE)
        row[: at.ROTATION_AXIS] = m.begin, m.duration, m.angle, m.profile, 0.0, len(m.table)
        row[at.ROTATION_AXIS : at.ROTATION_AXIS + 3] = m.axis
        row[at.FROM_AXES :] = axes.ravel()
        axes = rotation_matrix(m.axis, m.angle) @ axes
        rows.append(row)
    return rows + [m.table.ravel() for m in a.manoeuvres]


def _place_manoeuvres(block: Vector, a: Appendage, position: int) -> None:
    """Write where the manoeuvres and their tables are once the block is at `position`."""
    tables = sum(m.table.size for m in a.manoeuvres)
    begin = len(block) - tables - at.MANOEUVRE_SIZE * len(a.manoeuvres)
    block[at.MOTION_AT], block[at.MANOEUVRES] = position + begin, len(a.manoeuvres)
    table = position + len(block) - tables
    for k, m in enumerate(a.manoeuvres):
        block[begin + k * at.MANOEUVRE_SIZE + at.TABLE_AT] = table
        table += m.table.size


def _actuator_block(spacecraft: Spacecraft, d: SpacecraftActuator, places: list[int]) -> Vector:
    """Return the block of an actuator; see layout."""
    head = np.zeros(at.SHAPES)
    direction = np.asarray(d.direction, dtype=float)
    point = d.point
    head[at.WHAT], head[at.OWNER_BLOCK] = d.what, -1
    if d.what == at.WHEEL:
        head[at.INDEX], direction = d.owner, spacecraft.wheels[d.owner].axis
    elif d.what == at.GYRO:
        head[at.INDEX] = len(spacecraft.wheels) + d.owner
        direction = spacecraft.gyros[d.owner].across
    elif d.what == at.HINGE:
        before = spacecraft.appendages[: d.owner]
        head[at.INDEX] = sum(a.hinge == at.DRIVEN for a in before)
    elif point is not None and d.owner >= 0:
        a = spacecraft.appendages[d.owner]
        head[at.OWNER_BLOCK] = places[d.owner]
        if a.hinge == at.FIXED:  # its numbers are in body axes
            r = a.axes.T
            direction = r @ direction
            point = AppendagePoint(
                a.place + r @ point.place, r @ point.displacement, r @ point.turn, point.curvature
            )
    if point is not None:
        head[at.AT : at.AT + 3] = point.place
    head[at.DIRECTION : at.DIRECTION + 3] = direction
    if point is None or d.owner < 0 or d.what in (at.WHEEL, at.GYRO, at.HINGE):
        return head
    if d.what == at.MODAL and d.point is not None:
        a, share = spacecraft.appendages[d.owner], d.point.displacement[0]
        i = a.integrals.seen_from(a.place, a.axes) if a.hinge == at.FIXED else a.integrals
        head[at.DIRECTION : at.DIRECTION + 3] = i.translation @ share
        head[at.AT : at.AT + 3] = i.rotation @ share
        return np.concatenate((head, np.zeros(3 * share.size), share))
    effort_rows = point.turn if d.what == at.TIP_TORQUE else point.displacement
    return np.concatenate((head, point.displacement.ravel(), effort_rows.T @ direction))


def scale_stiffness(spacecraft: Spacecraft, p: Vector, factor: float) -> Vector:
    """Return packed numbers with the modes' stiffness times factor.

    Damping ratios are kept, and so are alpha and beta of damping by alpha M + beta K.
    """
    out = p.copy()
    table = int(p[at.APPENDAGE_TABLE])
    for k, a in enumerate(spacecraft.appendages):
        b = int(p[table + k])
        n = int(p[b + at.COUNT])
        rest = b + at.SUMS + 3 * n + 9 * n * (n + 1)
        mass, stiffness = p[rest : rest + n], p[rest + n : rest + 2 * n]
        damping = p[rest + 2 * n : rest + 2 * n + n * n].reshape(n, n)
        by_mass, by_stiffness = np.diag(a.alpha * mass), np.diag(a.beta * stiffness)
        kept = np.sqrt(factor) * (damping - by_mass - by_stiffness)
        out[rest + n : rest + 2 * n] *= factor
        out[rest + 2 * n : rest + 2 * n + n * n] = (kept + by_mass + factor * by_stiffness).ravel()
    return out


def shift_time(spacecraft: Spacecraft, p: Vector, time: float) -> Vector:
    """Return packed numbers with their time zero at this time [s]: hinges turn so much earlier."""
    out = p.copy()
    table = int(p[at.APPENDAGE_TABLE])
    for k in range(len(spacecraft.appendages)):
        b = int(p[table + k])
        first = int(p[b + at.MOTION_AT])
        for m in range(int(p[b + at.MANOEUVRES])):
            out[first + m * at.MANOEUVRE_SIZE + at.BEGIN] -= time
    return out
