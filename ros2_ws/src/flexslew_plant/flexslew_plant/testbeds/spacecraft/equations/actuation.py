"""Generalised forces B(q, t) u of a spacecraft's actuators; of gyros B depends on gimbal angles."""

from flexslew_plant.arrays import Vector, called, compiled_once
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.equations.frames import hinge_frame, offsets, rotor
from flexslew_plant.testbeds.spacecraft.equations.geometry import (
    Triple,
    apply_transposed,
    cross,
    dot,
    plus,
    scaled,
    triple,
)
from flexslew_plant.testbeds.spacecraft.equations.rigid_block import put


@called
def _platform_force(
    p: Vector, t: float, x: Vector, d: int, u: float, platform_q: int, platform_v: int, nq: int
) -> tuple[Triple, Triple, float]:
    """Return force and moment on the platform in body axes and the moment about the hinge.

    Args:
        p, t, x: packed spacecraft, time, state.
        d: start of the actuator's block.
        u: effort of the actuator.
        own_q, own_v, nq: see frames.offsets.
    """
    direction, place = scaled(u, triple(p, d + at.DIRECTION)), triple(p, d + at.AT)
    what, b = p[d + at.WHAT], int(p[d + at.OWNER_BLOCK])
    none = (0.0, 0.0, 0.0)
    if what == at.FORCE or what == at.THRUSTER:
        return direction, cross(place, direction), 0.0
    if what == at.TORQUE:
        return none, direction, 0.0
    if what == at.MODAL:  # its resultant, and its moment about the hinge or the body origin
        force, moment = direction, scaled(u, place)
        if p[b + at.KIND] == at.FIXED:
            return force, moment, 0.0
        e, _, _ = hinge_frame(p, b, t, 0.0, 0.0)
        pull = apply_transposed(e, force)
        arm = cross(triple(p, b + at.PLACE), pull)
        return pull, plus(arm, apply_transposed(e, moment)), 0.0
    n = int(p[b + at.COUNT])
    q = platform_q + int(p[at.HINGES]) + int(p[at.WHEELS]) + int(p[b + at.START])
    shape = d + at.SHAPES
    force, moment = none, direction
    if what == at.POINT_FORCE:
        for i in range(n):
            mode_column = (p[shape + i], p[shape + n + i], p[shape + 2 * n + i])
            place = plus(place, scaled(x[q + i], mode_column))
        force, moment = direction, cross(place, direction)
    if p[b + at.KIND] == at.FIXED:
        return force, moment, 0.0
    angle, rate = 0.0, 0.0
    if p[b + at.KIND] == at.DRIVEN:
        angle = x[platform_q + int(p[b + at.HINGE_INDEX])]
    e, _, _ = hinge_frame(p, b, t, angle, rate)
    pull = apply_transposed(e, force)
    arm = cross(triple(p, b + at.PLACE), pull)
    return pull, plus(arm, apply_transposed(e, moment)), dot(triple(p, b + at.AXIS), moment)


@called
def _platform_share(p: Vector, force: Triple, moment: Triple, out: Vector) -> None:
    """Add a force and a moment on the platform to the generalised forces."""
    if p[at.MOTION] == at.FREE:
        put(out, 0, force)
        put(out, 3, moment)
    elif p[at.MOTION] == at.PIVOT:
        out[0] += dot(triple(p, at.PIVOT_AXES), force)
        out[0] += dot(triple(p, at.PIVOT_AXES + 3), moment)


@compiled_once("out")
def actuation(p: Vector, t: float, x: Vector, effort: Vector, out: Vector) -> None:
    """Add B(q, t) u to the generalised forces `out`, shape (nv,)."""
    platform_q, platform_v, nq, _ = offsets(p)
    hinges, wheels = int(p[at.HINGES]), int(p[at.WHEELS])
    mode = platform_v + hinges + wheels
    table = int(p[at.ACTUATOR_TABLE])
    for k in range(int(p[at.ACTUATORS])):
        u = effort[k]
        if u == 0.0:
            continue
        d = int(p[table + k])
        index = int(p[d + at.INDEX])
        if p[d + at.WHAT] == at.HINGE:
            out[platform_v + index] += u
            continue
        if p[d + at.WHAT] == at.WHEEL:
            out[platform_v + hinges + index] -= u
            continue
        if p[d + at.WHAT] == at.GYRO:
            gimbal = platform_v + hinges + index
            out[gimbal] -= u
            row = int(p[at.WHEEL_TABLE]) + at.WHEEL_SIZE * index
            torque_axis = rotor(p, row, x[nq + gimbal])[1]
            _platform_share(p, (0.0, 0.0, 0.0), scaled(u, torque_axis), out)
            continue
        force, moment, hinge_moment = _platform_force(p, t, x, d, u, platform_q, platform_v, nq)
        _platform_share(p, force, moment, out)
        b = int(p[d + at.OWNER_BLOCK])
        if b < 0:
            continue
        n, first = int(p[b + at.COUNT]), mode + int(p[b + at.START])
        share = d + at.SHAPES + 3 * n
        for i in range(n):
            out[first + i] += u * p[share + i]
        if p[b + at.KIND] == at.DRIVEN:
            out[platform_v + int(p[b + at.HINGE_INDEX])] += hinge_moment
