"""Exact derivatives of the spacecraft's residual r = M(q, t) a + h(q, v, t) and of N(q) v."""

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, compiled_once
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.equations.appendage_jacobian import add_appendage
from flexslew_plant.testbeds.spacecraft.equations.frames import (
    offsets,
    platform_velocity,
    rotor,
)
from flexslew_plant.testbeds.spacecraft.equations.geometry import (
    cross,
    plus,
    scaled,
    symmetric,
    triple,
)
from flexslew_plant.testbeds.spacecraft.equations.sums import unit_vector


@compiled_once("dq", "dv")
def residual_jacobian(p: Vector, t: float, x: Vector, a: Vector, dq: Matrix, dv: Matrix) -> None:
    """Write dr/dq, shape (nv, nq), and dr/dv, shape (nv, nv), of r = M a + h at fixed a."""
    platform_q, platform_v, nq, nv = offsets(p)
    hinges, wheels = int(p[at.HINGES]), int(p[at.WHEELS])
    others = nv - platform_v
    size = 6 + others
    acceleration = np.zeros(size)
    for k in range(others):
        acceleration[6 + k] = a[platform_v + k]
    if p[at.MOTION] == at.FREE:
        for k in range(6):
            acceleration[k] = a[k]
    elif p[at.MOTION] == at.PIVOT:
        for c in range(6):
            acceleration[c] = a[0] * p[at.PIVOT_AXES + c]
    by_q, by_v = np.zeros((size, size)), np.zeros((size, size))
    velocity, spin = platform_velocity(p, x, nq)
    m, s = p[at.MASS], triple(p, at.FIRST)
    j = (p[19], p[20], p[21], p[22], p[23], p[24])
    linear = plus(scaled(m, velocity), cross(spin, s))
    angular = plus(cross(s, velocity), symmetric(j, spin))
    table = int(p[at.WHEEL_TABLE])
    for k in range(wheels):
        momentum_slope = scaled(p[table + at.WHEEL_INERTIA], triple(p, table))
        rate = x[nq + platform_v + hinges + k]
        momentum = p[table + at.ROTOR_MOMENTUM]
        if momentum > 0.0:
            spin_axis, torque_axis = rotor(p, table, rate)
            angular = plus(angular, scaled(momentum, spin_axis))
            momentum_slope = scaled(momentum, torque_axis)
        else:
            angular = plus(angular, scaled(rate, momentum_slope))
        gyro_torque = cross(spin, momentum_slope)
        for c in range(3):
            by_v[3 + c, 6 + hinges + k] += gyro_torque[c]
        table += at.WHEEL_SIZE
    for k in range(6):
        d_velocity, d_spin = unit_vector(k), unit_vector(k - 3)
        d_linear = plus(scaled(m, d_velocity), cross(d_spin, s))
        d_angular = plus(cross(s, d_velocity), symmetric(j, d_spin))
        force = plus(cross(d_spin, linear), cross(spin, d_linear))
        torque = plus(cross(d_spin, angular), cross(spin, d_angular))
        torque = plus(torque, plus(cross(d_velocity, linear), cross(velocity, d_linear)))
        for c in range(3):
            by_v[c, k] += force[c]
            by_v[3 + c, k] += torque[c]
    table = int(p[at.APPENDAGE_TABLE])
    for k in range(int(p[at.APPENDAGES])):
        add_appendage(p, t, x, acceleration, int(p[table + k]), by_q, by_v)
    dq[:] = 0.0
    for i in range(others):
        for k in range(others):
            dv[platform_v + i, platform_v + k] = by_v[6 + i, 6 + k]
            dq[platform_v + i, platform_q + k] = by_q[6 + i, 6 + k]
    if p[at.MOTION] == at.FREE:
        for i in range(6):
            for k in range(size):
                dv[i, k] = by_v[i, k]
            for k in range(others):
                dv[6 + k, i] = by_v[6 + k, i]
                dq[i, 7 + k] = by_q[i, 6 + k]
    elif p[at.MOTION] == at.PIVOT:
        dv[0] = 0.0
        dv[1:, 0] = 0.0
        for c in range(6):
            b = p[at.PIVOT_AXES + c]
            for k in range(others):
                dv[0, 1 + k] += b * by_v[c, 6 + k]
                dq[0, 1 + k] += b * by_q[c, 6 + k]
                dv[1 + k, 0] += b * by_v[6 + k, c]
            for d in range(6):
                dv[0, 0] += b * p[at.PIVOT_AXES + d] * by_v[c, d]
