"""The inertia of a craft as its hinges stand, undeformed."""

from typing import TypeAlias

from flexslew_plant.arrays import Vector, called
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.equations.frames import hinge_frame, offsets
from flexslew_plant.testbeds.spacecraft.equations.geometry import (
    apply_transposed,
    dot,
    plus,
    scaled,
    triple,
)
from flexslew_plant.testbeds.spacecraft.equations.rigid_block import inertia_at_origin

SymmetricMatrix: TypeAlias = tuple[float, float, float, float, float, float]


@called
def inertia_of_whole(p: Vector, x: Vector, t: float) -> SymmetricMatrix:
    """Return the inertia about the centre of mass in body axes: xx, yy, zz, xy, xz, yz.

    Args:
        p: packed spacecraft.
        x: state [q, v].
        t: time [s].
    """
    hinges, _, _, _ = offsets(p)
    mass, first, total = p[at.MASS], triple(p, at.FIRST), _read_symmetric(p, at.INERTIA)
    for k in range(int(p[at.APPENDAGES])):
        b = int(p[int(p[at.APPENDAGE_TABLE]) + k])
        if p[b + at.KIND] != at.FIXED:
            angle = 0.0
            if p[b + at.KIND] == at.DRIVEN:
                angle = x[hinges + int(p[b + at.HINGE_INDEX])]
            e, _, _ = hinge_frame(p, b, t, angle, 0.0)
            m, place = p[b + at.BODY_MASS], triple(p, b + at.PLACE)
            arm = apply_transposed(e, triple(p, b + at.BODY_FIRST))
            part_inertia = inertia_at_origin(
                e, _read_symmetric(p, b + at.BODY_INERTIA), arm, place, m
            )
            mass, first = mass + m, plus(first, plus(arm, scaled(m, place)))
            total = _plus(total, part_inertia)
    centre = scaled(1.0 / mass, first)
    square = dot(first, centre)
    shift = (
        first[0] * centre[0] - square,
        first[1] * centre[1] - square,
        first[2] * centre[2] - square,
        first[0] * centre[1],
        first[0] * centre[2],
        first[1] * centre[2],
    )
    return _plus(total, shift)


@called
def _read_symmetric(p: Vector, at_: int) -> SymmetricMatrix:
    return p[at_], p[at_ + 1], p[at_ + 2], p[at_ + 3], p[at_ + 4], p[at_ + 5]


@called
def _plus(a: SymmetricMatrix, b: SymmetricMatrix) -> SymmetricMatrix:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]
