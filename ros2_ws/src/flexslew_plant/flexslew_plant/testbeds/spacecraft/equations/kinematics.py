"""How positions follow velocities, q' = N(q) v, and the energy that positions hold."""

from flexslew_plant.arrays import Matrix, Vector, compiled, compiled_once
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.equations.frames import offsets
from flexslew_plant.testbeds.spacecraft.equations.geometry import (
    triple,
)


@compiled_once()
def potential(p: Vector, t: float, q: Vector) -> float:
    """Return the strain energy of appendages and sprung hinges [J]."""
    energy = 0.0
    platform_q = offsets(p)[0]
    mode_q = platform_q + int(p[at.HINGES]) + int(p[at.WHEELS])
    table = int(p[at.APPENDAGE_TABLE])
    for k in range(int(p[at.APPENDAGES])):
        b = int(p[table + k])
        n, first = int(p[b + at.COUNT]), mode_q + int(p[b + at.START])
        stiffness = b + at.SUMS + 3 * n + 9 * n * (n + 1) + n
        for i in range(n):
            energy += 0.5 * p[stiffness + i] * q[first + i] ** 2
        if p[b + at.KIND] == at.DRIVEN:
            angle = q[platform_q + int(p[b + at.HINGE_INDEX])]
            energy += 0.5 * p[b + at.HINGE_STIFFNESS] * angle * angle
    return energy


@compiled_once("rate")
def kinematics(p: Vector, t: float, x: Vector, rate: Vector) -> None:
    """Write q' = N(q) v, shape (nq,): R' = A V, quaternion' = quaternion (w, 0) / 2."""
    platform_q, platform_v, nq, nv = offsets(p)
    for i in range(nv - platform_v):
        rate[platform_q + i] = x[nq + platform_v + i]
    if p[at.MOTION] == at.PIVOT:
        rate[0] = x[nq]
    if p[at.MOTION] == at.FREE:
        a, b, c, d = x[3], x[4], x[5], x[6]
        vx, vy, vz = x[nq], x[nq + 1], x[nq + 2]
        wx, wy, wz = x[nq + 3], x[nq + 4], x[nq + 5]
        rate[0] = (d * d + a * a - b * b - c * c) * vx
        rate[0] += 2.0 * ((a * b - c * d) * vy + (a * c + b * d) * vz)
        rate[1] = (d * d - a * a + b * b - c * c) * vy
        rate[1] += 2.0 * ((a * b + c * d) * vx + (b * c - a * d) * vz)
        rate[2] = (d * d - a * a - b * b + c * c) * vz
        rate[2] += 2.0 * ((a * c - b * d) * vx + (b * c + a * d) * vy)
        rate[3] = 0.5 * (d * wx + b * wz - c * wy)
        rate[4] = 0.5 * (d * wy + c * wx - a * wz)
        rate[5] = 0.5 * (d * wz + a * wy - b * wx)
        rate[6] = -0.5 * (a * wx + b * wy + c * wz)


@compiled
def kinematics_jacobian(p: Vector, t: float, x: Vector, dq: Matrix, dv: Matrix) -> None:
    """Write d(N v)/dq, shape (nq, nq), and N, shape (nq, nv), of q' = N(q) v."""
    platform_q, platform_v, nq, nv = offsets(p)
    dq[:] = 0.0
    dv[:] = 0.0
    for i in range(nv - platform_v):
        dv[platform_q + i, platform_v + i] = 1.0
    if p[at.MOTION] == at.PIVOT:
        dv[0, 0] = 1.0
    if p[at.MOTION] != at.FREE:
        return
    a, b, c, d = x[3], x[4], x[5], x[6]
    v0, v1, v2 = triple(x, nq)
    w0, w1, w2 = triple(x, nq + 3)
    dv[0, 0], dv[0, 1], dv[0, 2] = (
        d * d + a * a - b * b - c * c,
        2.0 * (a * b - c * d),
        2.0 * (a * c + b * d),
    )
    dv[1, 0], dv[1, 1], dv[1, 2] = (
        2.0 * (a * b + c * d),
        d * d - a * a + b * b - c * c,
        2.0 * (b * c - a * d),
    )
    dv[2, 0], dv[2, 1], dv[2, 2] = (
        2.0 * (a * c - b * d),
        2.0 * (b * c + a * d),
        d * d - a * a - b * b + c * c,
    )
    dv[3, 3], dv[3, 4], dv[3, 5] = 0.5 * d, -0.5 * c, 0.5 * b
    dv[4, 3], dv[4, 4], dv[4, 5] = 0.5 * c, 0.5 * d, -0.5 * a
    dv[5, 3], dv[5, 4], dv[5, 5] = -0.5 * b, 0.5 * a, 0.5 * d
    dv[6, 3], dv[6, 4], dv[6, 5] = -0.5 * a, -0.5 * b, -0.5 * c
    dq[0, 3], dq[0, 4] = 2.0 * (a * v0 + b * v1 + c * v2), 2.0 * (a * v1 - b * v0 + d * v2)
    dq[0, 5], dq[0, 6] = 2.0 * (a * v2 - c * v0 - d * v1), 2.0 * (d * v0 - c * v1 + b * v2)
    dq[1, 3], dq[1, 4] = 2.0 * (b * v0 - a * v1 - d * v2), 2.0 * (a * v0 + b * v1 + c * v2)
    dq[1, 5], dq[1, 6] = 2.0 * (d * v0 - c * v1 + b * v2), 2.0 * (c * v0 + d * v1 - a * v2)
    dq[2, 3], dq[2, 4] = 2.0 * (c * v0 + d * v1 - a * v2), 2.0 * (c * v1 - d * v0 - b * v2)
    dq[2, 5], dq[2, 6] = 2.0 * (a * v0 + b * v1 + c * v2), 2.0 * (a * v1 - b * v0 + d * v2)
    dq[3, 4], dq[3, 5], dq[3, 6] = 0.5 * w2, -0.5 * w1, 0.5 * w0
    dq[4, 3], dq[4, 5], dq[4, 6] = -0.5 * w2, 0.5 * w0, 0.5 * w1
    dq[5, 3], dq[5, 4], dq[5, 6] = 0.5 * w1, -0.5 * w0, 0.5 * w2
    dq[6, 3], dq[6, 4], dq[6, 5] = -0.5 * w0, -0.5 * w1, -0.5 * w2
