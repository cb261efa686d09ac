"""Equations of motion of a platform with flexible appendages, Kane's form (Sung and Joo).

M(q, t) nu' + h(q, nu, t) = B u. Every appendage is worked in its own axes: with the velocity V_e
and rate w_e of its frame, s = sum m x, J the inertia and C = sum m x~ Phi at the deflected shape,
    r_V = m V' + w' x s + P q'' + w x s' + w x p_V,               p_V = m V + w x s + P q'
    r_w = s x V' + J w' + C q'' + s' x V + J' w + w x p_w + V x p_V, p_w = s x V + J w + C q'
    r_q = P^T V' + C^T w' + M_q q'' + 2 (q'^T G) w - P^T (V x w) - w^T D w / 2 + K q + D_q q',
then projected on the platform's velocities, the hinges' rates and the modes. Linear and angular
momentum and the energy are kept by this form exactly, for any integrals.

An appendage that bends shortens: x = r + Phi q + q^T s q / 2 with s of the shape. Then P and C are
those of Phi + s q, r_V gains q'^T S q' and r_w gains q'^T R q' with S = sum m s, R = sum m r x s,
and J its part of second order. The geometric stiffness of a base that spins or accelerates
(Kane, Ryan and Banerjee 1987) is what this adds to r_q: S . (V' - V x w) + R . w' - w^T J_s w / 2.
"""

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, compiled, compiled_once
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.equations.frames import (
    geometric_rate_terms,
    hinge_frame,
    offsets,
    platform_velocity,
    rotor,
    write_modal_sums,
)
from flexslew_plant.testbeds.spacecraft.equations.geometry import (
    apply,
    apply_transposed,
    cross,
    dot,
    plus,
    read_matrix3,
    scaled,
    symmetric,
    triple,
)
from flexslew_plant.testbeds.spacecraft.equations.rigid_block import (
    add_point_mass_row,
    inertia_at_origin,
    put,
)


@compiled
def free_platform_terms(
    p: Vector, t: float, x: Vector, mass: Matrix, coupling: Matrix, modal: Vector, bias: Vector
) -> None:
    """Write M and h for nu = (V, w, hinges, wheels, modes), as of a free platform.

    Args:
        p: packed spacecraft.
        t: time [s].
        x: state [q, v].
        mass: out, upper triangle of M without the modes, shape (r, r).
        coupling: out, M between these and the modes, shape (r, modes).
        modal: out, the modes' diagonal, shape (modes,).
        bias: out, shape (r + modes,).
    """
    hinges, wheels, modes = int(p[at.HINGES]), int(p[at.WHEELS]), int(p[at.MODES])
    platform_q, platform_v, nq, _ = offsets(p)
    mass[:] = 0.0
    coupling[:] = 0.0
    bias[:] = 0.0
    velocity, spin = platform_velocity(p, x, nq)
    hinge_q, hinge_v = platform_q, nq + platform_v
    mode_q, mode_v = platform_q + hinges + wheels, nq + platform_v + hinges + wheels
    mode_row = 6 + hinges + wheels
    # the rigid part
    m, s = p[at.MASS], triple(p, at.FIRST)
    j = (p[19], p[20], p[21], p[22], p[23], p[24])
    add_point_mass_row(mass, s, j, m)
    linear = plus(scaled(m, velocity), cross(spin, s))
    angular = plus(cross(s, velocity), symmetric(j, spin))
    table = int(p[at.WHEEL_TABLE])
    for k in range(wheels):
        axis, inertia = triple(p, table), p[table + at.WHEEL_INERTIA]
        row, rate = 6 + hinges + k, x[hinge_v + hinges + k]
        momentum = p[table + at.ROTOR_MOMENTUM]
        if momentum > 0.0:  # a gyro: its effort is h times the rate of its gimbal
            mass[row, row] = momentum
            angular = plus(angular, scaled(momentum, rotor(p, table, rate)[0]))
        else:
            platform_part = scaled(inertia, axis)
            mass[row, row] = inertia
            mass[3, row], mass[4, row], mass[5, row] = platform_part
            angular = plus(angular, scaled(rate, platform_part))
        table += at.WHEEL_SIZE
    put(bias, 0, cross(spin, linear))
    put(bias, 3, plus(cross(spin, angular), cross(velocity, linear)))
    work = np.empty(12 * modes)
    table = int(p[at.APPENDAGE_TABLE])
    for k in range(int(p[at.APPENDAGES])):
        b = int(p[table + k])
        n, first = int(p[b + at.COUNT]), int(p[b + at.START])
        q, v, row = mode_q + first, mode_v + first, mode_row + first
        fixed = p[b + at.KIND] == at.FIXED
        has_motor = p[b + at.KIND] == at.DRIVEN
        hinge = int(p[b + at.HINGE_INDEX])
        e = read_matrix3(p, b + at.AXES)
        frame_velocity, frame_spin = velocity, spin
        drift, angular_drift = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        place = triple(p, b + at.PLACE)
        if not fixed:
            angle, rate = 0.0, 0.0
            if has_motor:
                angle, rate = x[hinge_q + hinge], x[hinge_v + hinge]
            e, relative, relative_rate = hinge_frame(p, b, t, angle, rate)
            frame_velocity = apply(e, plus(velocity, cross(spin, place)))
            base_spin = apply(e, spin)
            frame_spin = plus(base_spin, relative)
            drift = cross(frame_velocity, relative)
            angular_drift = plus(relative_rate, cross(base_spin, relative))
        # sums at the deflected shape
        write_modal_sums(p, b, x, q, work)
        sums = b + at.SUMS
        base = sums + 3 * n
        rest = base + 9 * n * (n + 1)
        s, m = triple(p, b + at.BODY_FIRST), p[b + at.BODY_MASS]
        sx, sy, sz = s
        dx, dy, dz = 0.0, 0.0, 0.0
        o = b + at.BODY_INERTIA
        jxx, jyy, jzz, jxy, jxz, jyz = p[o], p[o + 1], p[o + 2], p[o + 3], p[o + 4], p[o + 5]
        ixx, iyy, izz, ixy, ixz, iyz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0  # dJ/dt
        cx, cy, cz = 0.0, 0.0, 0.0  # C q'
        for i in range(n):
            qi, vi = x[q + i], x[v + i]
            half = 0.5 * qi
            sx += half * (p[sums + i] + work[9 * n + i])
            sy += half * (p[sums + n + i] + work[10 * n + i])
            sz += half * (p[sums + 2 * n + i] + work[11 * n + i])
            dx += vi * work[9 * n + i]
            dy += vi * work[10 * n + i]
            dz += vi * work[11 * n + i]
            jxx += half * (p[base + i] + work[i])
            jyy += half * (p[base + n + i] + work[n + i])
            jzz += half * (p[base + 2 * n + i] + work[2 * n + i])
            jxy += half * (p[base + 3 * n + i] + work[3 * n + i])
            jxz += half * (p[base + 4 * n + i] + work[4 * n + i])
            jyz += half * (p[base + 5 * n + i] + work[5 * n + i])
            ixx += vi * work[i]
            iyy += vi * work[n + i]
            izz += vi * work[2 * n + i]
            ixy += vi * work[3 * n + i]
            ixz += vi * work[4 * n + i]
            iyz += vi * work[5 * n + i]
            cx += vi * work[6 * n + i]
            cy += vi * work[7 * n + i]
            cz += vi * work[8 * n + i]
        s, ds = (sx, sy, sz), (dx, dy, dz)
        j = (jxx, jyy, jzz, jxy, jxz, jyz)
        dj = (ixx, iyy, izz, ixy, ixz, iyz)
        linear = plus(plus(scaled(m, frame_velocity), cross(frame_spin, s)), ds)
        angular = plus(plus(cross(s, frame_velocity), symmetric(j, frame_spin)), (cx, cy, cz))
        force = plus(cross(frame_spin, ds), cross(frame_spin, linear))
        torque = plus(cross(ds, frame_velocity), symmetric(dj, frame_spin))
        torque = plus(torque, plus(cross(frame_spin, angular), cross(frame_velocity, linear)))
        rate_force, rate_torque = geometric_rate_terms(p, b, x, v)
        force, torque = plus(force, rate_force), plus(torque, rate_torque)
        cross_velocity = cross(frame_velocity, frame_spin)
        a, c, d = frame_spin
        if not fixed:  # accelerations of the frame itself
            force = plus(force, plus(scaled(m, drift), cross(angular_drift, s)))
            torque = plus(torque, plus(cross(s, drift), symmetric(j, angular_drift)))
        # the modes' rows: M_q and 2 (q'^T G) w - P^T (V x w) - w^T D w / 2 + K q + D_q q'
        for i in range(n):
            centrifugal = (
                work[i] * a * a
                + work[n + i] * c * c
                + work[2 * n + i] * d * d
                + 2.0 * (work[3 * n + i] * a * c + work[4 * n + i] * a * d)
                + 2.0 * work[5 * n + i] * c * d
            )
            velocity_term = (
                work[9 * n + i] * cross_velocity[0]
                + work[10 * n + i] * cross_velocity[1]
                + work[11 * n + i] * cross_velocity[2]
            )
            h = p[rest + n + i] * x[q + i] - 0.5 * centrifugal - velocity_term
            for k2 in range(n):
                h += p[rest + 2 * n + i * n + k2] * x[v + k2]
            if not fixed:
                h += work[9 * n + i] * drift[0] + work[10 * n + i] * drift[1]
                h += work[11 * n + i] * drift[2]
                h += work[6 * n + i] * angular_drift[0] + work[7 * n + i] * angular_drift[1]
                h += work[8 * n + i] * angular_drift[2]
            bias[row + i] += h
            modal[first + i] = p[rest + i]
        if p[b + at.SECOND_ORDER] > 0.5:
            g = base + 9 * n + 6 * n
            for k2 in range(n):
                va, vc, vd = 2.0 * x[v + k2] * a, 2.0 * x[v + k2] * c, 2.0 * x[v + k2] * d
                for i in range(n):
                    bias[row + i] += va * p[g + i] + vc * p[g + n + i] + vd * p[g + 2 * n + i]
                g += 9 * n
        if fixed:
            add_point_mass_row(mass, s, j, m)
            put(bias, 0, force)
            put(bias, 3, torque)
            for i in range(n):
                coupling[0, first + i] = work[9 * n + i]
                coupling[1, first + i] = work[10 * n + i]
                coupling[2, first + i] = work[11 * n + i]
                coupling[3, first + i] = work[6 * n + i]
                coupling[4, first + i] = work[7 * n + i]
                coupling[5, first + i] = work[8 * n + i]
            continue
        at_body, pull = apply_transposed(e, s), apply_transposed(e, force)
        put(bias, 0, pull)
        put(bias, 3, plus(cross(place, pull), apply_transposed(e, torque)))
        total = plus(at_body, scaled(m, place))
        add_point_mass_row(mass, total, inertia_at_origin(e, j, at_body, place, m), m)
        for i in range(n):
            along = apply_transposed(e, (work[9 * n + i], work[10 * n + i], work[11 * n + i]))
            moment_row = apply_transposed(e, (work[6 * n + i], work[7 * n + i], work[8 * n + i]))
            moment_row = plus(moment_row, cross(place, along))
            coupling[0, first + i], coupling[1, first + i], coupling[2, first + i] = along
            coupling[3, first + i], coupling[4, first + i], coupling[5, first + i] = moment_row
        if has_motor:
            axis, to = triple(p, b + at.AXIS), 6 + hinge
            hinge_force = apply_transposed(e, cross(axis, s))
            axis_inertia = symmetric(j, axis)
            mass[0, to], mass[1, to], mass[2, to] = hinge_force
            mass[3, to], mass[4, to], mass[5, to] = plus(
                apply_transposed(e, axis_inertia), cross(place, hinge_force)
            )
            mass[to, to] = dot(axis, axis_inertia)
            bias[to] = dot(axis, torque) + p[b + at.HINGE_STIFFNESS] * x[hinge_q + hinge]
            bias[to] += p[b + at.HINGE_DAMPING] * x[hinge_v + hinge]
            for i in range(n):
                coupling[to, first + i] = (
                    axis[0] * work[6 * n + i]
                    + axis[1] * work[7 * n + i]
                    + axis[2] * work[8 * n + i]
                )


@compiled_once("joints", "coupling", "modal", "bias")
def terms(
    p: Vector, t: float, x: Vector, joints: Matrix, coupling: Matrix, modal: Vector, bias: Vector
) -> None:
    """Write M(q, t) and h(q, v, t) of M v' + h = B u, the modes last.

    Args:
        p: packed spacecraft.
        t: time [s].
        x: state [q, v].
        joints: out, M of platform, hinges and wheels, shape (m, m).
        coupling: out, M between these and the modes, shape (m, modes).
        modal: out, the modes' diagonal of M, shape (modes,).
        bias: out, h, shape (m + modes,).
    """
    m, n = coupling.shape
    free = p[at.MOTION] == at.FREE
    platform_part = 1 if p[at.MOTION] == at.PIVOT else 0
    mass, full_coupling, h = joints, coupling, bias
    if not free:
        k = m + 6 - platform_part
        mass, full_coupling, h = np.empty((k, k)), np.empty((k, n)), np.empty(k + n)
    free_platform_terms(p, t, x, mass, full_coupling, modal, h)
    if free:
        for i in range(m):
            for j in range(i):
                joints[i, j] = joints[j, i]
        return
    k = m + 6 - platform_part
    for i in range(6, k + n):
        bias[i - 6 + platform_part] = h[i]
    for i in range(6, k):
        for j in range(n):
            coupling[i - 6 + platform_part, j] = full_coupling[i, j]
        for j in range(i, k):
            joints[i - 6 + platform_part, j - 6 + platform_part] = mass[i, j]
            joints[j - 6 + platform_part, i - 6 + platform_part] = mass[i, j]
    if platform_part == 1:
        joints[0] = 0.0
        coupling[0] = 0.0
        bias[0] = 0.0
        for i in range(6):
            a = p[at.PIVOT_AXES + i]
            bias[0] += a * h[i]
            joints[0, 0] += a * a * mass[i, i]
            for j in range(i + 1, 6):
                joints[0, 0] += 2.0 * a * p[at.PIVOT_AXES + j] * mass[i, j]
            for j in range(6, k):
                joints[0, j - 5] += a * mass[i, j]
            for j in range(n):
                coupling[0, j] += a * full_coupling[i, j]
        for j in range(1, m):
            joints[j, 0] = joints[0, j]
