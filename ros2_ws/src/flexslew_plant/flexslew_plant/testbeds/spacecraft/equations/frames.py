"""Where the platform and the frames of its appendages are, and how the modes deform them."""

import numpy as np

from flexslew_plant.arrays import Vector, called
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.equations.geometry import (
    Matrix3,
    Triple,
    cross,
    plus,
    read_matrix3,
    rotate_frame,
    scaled,
    triple,
)
from flexslew_plant.testbeds.spacecraft.equations.hinge_motion import prescribed


@called
def offsets(p: Vector) -> tuple[int, int, int, int]:
    """Return how many positions and velocities the platform has, and q and v altogether."""
    others = int(p[at.HINGES]) + int(p[at.WHEELS]) + int(p[at.MODES])
    if p[at.MOTION] == at.FREE:
        return 7, 6, 7 + others, 6 + others
    if p[at.MOTION] == at.HELD:
        return 0, 0, others, others
    return 1, 1, 1 + others, 1 + others


@called
def platform_velocity(p: Vector, x: Vector, v: int) -> tuple[Triple, Triple]:
    """Return V and w along body axes; v is where the velocities begin."""
    if p[at.MOTION] == at.FREE:
        return triple(x, v), triple(x, v + 3)
    rest = (0.0, 0.0, 0.0)
    if p[at.MOTION] == at.HELD:
        return rest, rest
    rate = x[v]
    return (
        scaled(rate, triple(p, at.PIVOT_AXES)),
        scaled(rate, triple(p, at.PIVOT_AXES + 3)),
    )


@called
def rotor(p: Vector, table: int, angle: float) -> tuple[Triple, Triple]:
    """Return where the rotor of a control moment gyro points, and g x that: where its torque does.

    Args:
        p: packed spacecraft.
        table: where its numbers lie.
        angle: of its gimbal [rad].
    """
    axis, rest = triple(p, table), triple(p, table + at.ROTOR_AXIS)
    normal = cross(axis, rest)
    c, s = np.cos(angle), np.sin(angle)
    return plus(scaled(c, rest), scaled(s, normal)), plus(scaled(c, normal), scaled(-s, rest))


@called
def hinge_frame(
    p: Vector, b: int, t: float, angle: float, rate: float
) -> tuple[Matrix3, Triple, Triple]:
    """Return E, the relative rate and its derivative without the hinge's own acceleration.

    Args:
        p: packed spacecraft.
        b: start of the appendage's block.
        t: time [s].
        angle: angle of a driven hinge [rad].
        rate: rate of a driven hinge [rad/s].
    """
    if p[b + at.KIND] == at.DRIVEN:
        axis = triple(p, b + at.AXIS)
        e = rotate_frame(axis, np.cos(angle), np.sin(angle), read_matrix3(p, b + at.AXES))
        return e, scaled(rate, axis), (0.0, 0.0, 0.0)
    return prescribed(p, b, t)


@called
def write_modal_sums(p: Vector, b: int, x: Vector, q: int, w: Vector) -> None:
    """Write [D, C, P] of an appendage at the deflected shape, component by component, (12 n,).

    D_j = dJ/dq_j in the order xx, yy, zz, xy, xz, yz; C = sum m x~ Phi; P = sum m Phi. Where the
    appendage shortens as it bends, Phi is what a mode moves the points at the deflected shape.

    Args:
        p: packed spacecraft.
        b: start of the appendage's block.
        x: state.
        q: index of its first modal coordinate in x.
        w: out, at least 12 n long.
    """
    n = int(p[b + at.COUNT])
    base = b + at.SUMS + 3 * n
    for c in range(9 * n):
        w[c] = p[base + c]
    for c in range(3 * n):
        w[9 * n + c] = p[base - 3 * n + c]
    if p[b + at.SECOND_ORDER] > 0.5:
        row = base + 9 * n
        for i in range(n):
            qi = x[q + i]
            for c in range(9 * n):
                w[c] += qi * p[row + c]
            row += 9 * n
    if p[b + at.GEOMETRIC] > 0.5:
        row = geometric_rows(b, n)
        for i in range(n):
            qi = x[q + i]
            for c in range(3 * n):
                w[9 * n + c] += qi * p[row + c]
                w[6 * n + c] += qi * p[row + 3 * n + c]
            row += 6 * n


@called
def geometric_rows(b: int, n: int) -> int:
    """Return where the rows [S_i (3 n), R_i (3 n)] of an appendage begin.

    S_ij = sum m s_ij and R_ij = sum m r x s_ij, with s_ij the displacement of second order.
    """
    return b + at.SUMS + 3 * n + 9 * n * (n + 1) + 2 * n + n * n


@called
def geometric_rate_terms(p: Vector, b: int, x: Vector, v: int) -> tuple[Triple, Triple]:
    """Return sum q'_i q'_j S_ij and sum q'_i q'_j R_ij, (0, 0, 0) where nothing shortens."""
    fx, fy, fz, tx, ty, tz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if p[b + at.GEOMETRIC] > 0.5:
        n = int(p[b + at.COUNT])
        row = geometric_rows(b, n)
        for i in range(n):
            for j in range(n):
                square = x[v + i] * x[v + j]
                fx += square * p[row + j]
                fy += square * p[row + n + j]
                fz += square * p[row + 2 * n + j]
                tx += square * p[row + 3 * n + j]
                ty += square * p[row + 4 * n + j]
                tz += square * p[row + 5 * n + j]
            row += 6 * n
    return (fx, fy, fz), (tx, ty, tz)
