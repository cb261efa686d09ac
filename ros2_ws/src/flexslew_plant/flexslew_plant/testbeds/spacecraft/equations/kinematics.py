"""How positions follow velocities, q' = N(q) v, and the energy that positions hold."""

from flexslew_plant.arrays import Vector, compiled_once
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.equations.frames import offsets


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
