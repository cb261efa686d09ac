"""Where the platform and the frames of its appendages are, and how the modes deform them."""

import numpy as np

from flexslew_plant.arrays import Vector, called
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.equations.geometry import (
    Nine,
    Triple,
    nine,
    scaled,
    triple,
    turned,
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
    still = (0.0, 0.0, 0.0)
    if p[at.MOTION] == at.HELD:
        return still, still
    rate = x[v]
    return (
        scaled(rate, triple(p, at.PIVOT_AXES)),
        scaled(rate, triple(p, at.PIVOT_AXES + 3)),
    )


@called
def hinge_frame(
    p: Vector, b: int, t: float, angle: float, rate: float
) -> tuple[Nine, Triple, Triple]:
    """Return E, the relative rate and its derivative without the hinge's own acceleration.

    Args:
        p: packed spacecraft.
        b: where the appendage's block lies.
        t: time [s].
        angle: of a driven hinge [rad].
        rate: of a driven hinge [rad/s].
    """
    if p[b + at.KIND] == at.DRIVEN:
        axis = triple(p, b + at.AXIS)
        e = turned(axis, np.cos(angle), np.sin(angle), nine(p, b + at.AXES))
        return e, scaled(rate, axis), (0.0, 0.0, 0.0)
    return prescribed(p, b, t)


@called
def deflected(p: Vector, b: int, x: Vector, q: int, w: Vector) -> None:
    """Write [D, C] of an appendage at the deflected shape, component by component, (9 n,).

    D_j = dJ/dq_j in the order xx, yy, zz, xy, xz, yz; C = sum m x~ Phi.

    Args:
        p: packed spacecraft.
        b: where the appendage's block lies.
        x: state.
        q: where its modal coordinates begin in x.
        w: out, at least 9 n long.
    """
    n = int(p[b + at.COUNT])
    base = b + at.SUMS + 3 * n
    for c in range(9 * n):
        w[c] = p[base + c]
    if p[b + at.SECOND_ORDER] > 0.5:
        row = base + 9 * n
        for i in range(n):
            qi = x[q + i]
            for c in range(9 * n):
                w[c] += qi * p[row + c]
            row += 9 * n
