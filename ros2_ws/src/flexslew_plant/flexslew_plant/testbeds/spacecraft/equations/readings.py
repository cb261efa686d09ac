"""What sensors read: position and rate along each effort, the attitude, and a hinge's motion."""

import numpy as np

from flexslew_plant.arrays import Vector, called, compiled_once
from flexslew_plant.testbeds.kernels import select
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.equations.frames import (
    hinge_frame,
    offsets,
    platform_velocity,
)
from flexslew_plant.testbeds.spacecraft.equations.geometry import (
    Matrix3,
    Triple,
    cross,
    dot,
    plus,
    scaled,
    triple,
)


@called
def rotation_vector(p: Vector, x: Vector) -> Triple:
    """Return the platform's turn as axis times angle along body axes [rad].

    It grows without a jump through 180 deg, up to a whole turn, as the quaternion does.
    """
    if p[at.MOTION] == at.HELD:
        return 0.0, 0.0, 0.0
    if p[at.MOTION] == at.PIVOT:
        a = triple(p, at.PIVOT_AXES + 3)
        return x[0] * a[0], x[0] * a[1], x[0] * a[2]
    size = np.sqrt(x[3] * x[3] + x[4] * x[4] + x[5] * x[5])
    ratio = select(size > 1e-9, 2.0 * np.arctan2(size, x[6]) / size, 2.0)
    return ratio * x[3], ratio * x[4], ratio * x[5]


@called
def _place(p: Vector, x: Vector) -> Triple:
    """Return the body origin's place R along body axes [m]."""
    if p[at.MOTION] == at.HELD:
        return 0.0, 0.0, 0.0
    if p[at.MOTION] == at.PIVOT:
        return scaled(x[0], triple(p, at.PIVOT_AXES))
    r, v, w = triple(x, 0), triple(x, 3), x[6]
    # A^T R = R - 2 w v x R + 2 v x (v x R)
    once = cross(v, r)
    double_cross = cross(v, once)
    return (
        r[0] - 2.0 * w * once[0] + 2.0 * double_cross[0],
        r[1] - 2.0 * w * once[1] + 2.0 * double_cross[1],
        r[2] - 2.0 * w * once[2] + 2.0 * double_cross[2],
    )


@compiled_once("position", "velocity")
def read(p: Vector, x: Vector, position: Vector, velocity: Vector) -> None:
    """Write where each actuator stands and how fast it moves, both along its effort.

    A force on the platform: place R + turn x arm and velocity along it [m, m/s]; a torque, a wheel
    or, along its torque at angle zero, a gyro: the platform's turn and rate [rad, rad/s]; a
    thruster: these times its lever r x d about the body origin [m, m/s]; a hinge: its angle and
    rate; a force or a torque on an appendage: its elastic displacement or turn there and its rate.

    Args:
        p: packed spacecraft.
        x: state [q, v].
        position: out, shape (actuators,).
        velocity: out, shape (actuators,).
    """
    platform_q, platform_v, nq, _ = offsets(p)
    before = int(p[at.HINGES]) + int(p[at.WHEELS])
    speed, spin = platform_velocity(p, x, nq)
    rotation, place = rotation_vector(p, x), _place(p, x)
    table = int(p[at.ACTUATOR_TABLE])
    for k in range(int(p[at.ACTUATORS])):
        d = int(p[table + k])
        what, direction = p[d + at.WHAT], triple(p, d + at.DIRECTION)
        if what == at.FORCE:
            arm = triple(p, d + at.AT)
            position[k] = dot(direction, plus(place, cross(rotation, arm)))
            velocity[k] = dot(direction, plus(speed, cross(spin, arm)))
        elif what == at.THRUSTER:
            torque_arm = cross(triple(p, d + at.AT), direction)
            position[k] = dot(torque_arm, rotation)
            velocity[k] = dot(torque_arm, spin)
        elif what == at.TORQUE or what == at.WHEEL or what == at.GYRO:
            position[k] = dot(direction, rotation)
            velocity[k] = dot(direction, spin)
        elif what == at.HINGE:
            index = int(p[d + at.INDEX])
            position[k], velocity[k] = x[platform_q + index], x[nq + platform_v + index]
        else:
            b = int(p[d + at.OWNER_BLOCK])
            n, first = int(p[b + at.COUNT]), int(p[b + at.START])
            share = d + at.SHAPES + 3 * n
            q, v = 0.0, 0.0
            for i in range(n):
                q += p[share + i] * x[platform_q + before + first + i]
                v += p[share + i] * x[nq + platform_v + before + first + i]
            position[k], velocity[k] = q, v


@compiled_once()
def hinge_state(
    p: Vector, k: int, x: Vector, slope: Vector, t: float
) -> tuple[Matrix3, Triple, Triple]:
    """Return E of an appendage, its rate relative to the platform, and the rate's derivative.

    Args:
        p: packed spacecraft.
        k: which appendage.
        x: state [q, v].
        slope: its derivative.
        t: time [s].
    """
    platform_q, platform_v, nq, _ = offsets(p)
    b = int(p[int(p[at.APPENDAGE_TABLE]) + k])
    if p[b + at.KIND] != at.DRIVEN:
        return hinge_frame(p, b, t, 0.0, 0.0)
    hinge = int(p[b + at.HINGE_INDEX])
    rate = nq + platform_v + hinge
    e, relative, _ = hinge_frame(p, b, t, x[platform_q + hinge], x[rate])
    return e, relative, scaled(slope[rate], triple(p, b + at.AXIS))
