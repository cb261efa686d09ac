"""Exact derivatives of the spacecraft's residual r = M(q, t) a + h(q, v, t) and of N(q) v."""

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, called, compiled
from flexslew_plant.testbeds.spacecraft import layout as at
from flexslew_plant.testbeds.spacecraft.geometry import (
    Nine,
    Triple,
    apply,
    apply_transposed,
    cross,
    dot,
    nine,
    plus,
    scaled,
    symmetric,
    triple,
)
from flexslew_plant.testbeds.spacecraft.kernels import (
    deflected,
    hinge_frame,
    offsets,
    platform_velocity,
)


@called
def _six(a: Vector, n: int, q: Vector, at_q: int, row: int) -> tuple[float, ...]:
    """Return sum_i q_i a[component n + i] for six components that begin at `row`."""
    xx, yy, zz, xy, xz, yz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        v = q[at_q + i]
        xx += v * a[row + i]
        yy += v * a[row + n + i]
        zz += v * a[row + 2 * n + i]
        xy += v * a[row + 3 * n + i]
        xz += v * a[row + 4 * n + i]
        yz += v * a[row + 5 * n + i]
    return xx, yy, zz, xy, xz, yz


@called
def _three(a: Vector, n: int, q: Vector, at_q: int, row: int) -> Triple:
    """Return sum_i q_i a[component n + i] for three components that begin at `row`."""
    x, y, z = 0.0, 0.0, 0.0
    for i in range(n):
        v = q[at_q + i]
        x += v * a[row + i]
        y += v * a[row + n + i]
        z += v * a[row + 2 * n + i]
    return x, y, z


@called
def _row(a: Vector, n: int, row: int, i: int) -> Triple:
    """Return three components of entry i that begin at `row`."""
    return a[row + i], a[row + n + i], a[row + 2 * n + i]


@called
def _row_six(a: Vector, n: int, row: int, i: int) -> tuple[float, ...]:
    """Return six components of entry i that begin at `row`."""
    return (
        a[row + i],
        a[row + n + i],
        a[row + 2 * n + i],
        a[row + 3 * n + i],
        a[row + 4 * n + i],
        a[row + 5 * n + i],
    )


@called
def _minus(a: Triple, b: Triple) -> Triple:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@called
def _unit(k: int) -> Triple:
    """Return the unit vector k."""
    return 1.0 * (k == 0), 1.0 * (k == 1), 1.0 * (k == 2)


@compiled
def _appendage(
    p: Vector,
    t: float,
    x: Vector,
    a: Vector,
    b: int,
    dx: Matrix,
    dv: Matrix,
) -> None:
    """Add one appendage's derivatives; rows and columns as of a free platform.

    Args:
        p, t, x: packed spacecraft, time, state.
        a: accelerations of (V, w, hinges, wheels, modes), shape (6 + others,).
        b: where the appendage's block lies.
        dx: in and out, columns of (R, attitude as six, hinges, wheels, modes).
        dv: in and out, columns of (V, w, hinges, wheels, modes).
    """
    own_q, own_v, nq, _ = offsets(p)
    before = int(p[at.HINGES]) + int(p[at.WHEELS])
    n, first = int(p[b + at.COUNT]), int(p[b + at.START])
    q, v, row = own_q + before + first, nq + own_v + before + first, 6 + before + first
    fixed, driven = p[b + at.KIND] == at.FIXED, p[b + at.KIND] == at.DRIVEN
    hinge = int(p[b + at.HINGE_INDEX])
    body_velocity, body_spin = platform_velocity(p, x, nq)
    body_push, body_turn = triple(a, 0), triple(a, 3)
    place, axis, e = triple(p, b + at.PLACE), triple(p, b + at.AXIS), nine(p, b + at.AXES)
    none = (0.0, 0.0, 0.0)
    velocity, spin, push, turning = body_velocity, body_spin, body_push, body_turn
    relative, carried, felt = none, none, none
    if not fixed:
        angle, rate = 0.0, 0.0
        if driven:
            angle, rate = x[own_q + hinge], x[nq + own_v + hinge]
        e, relative, relative_rate = hinge_frame(p, b, t, angle, rate)
        if driven:
            relative_rate = scaled(a[6 + hinge], axis)
        velocity = apply(e, plus(body_velocity, cross(body_spin, place)))
        carried = apply(e, body_spin)
        spin = plus(carried, relative)
        felt = apply(e, plus(body_push, cross(body_turn, place)))
        push = plus(felt, cross(velocity, relative))
        turning = plus(plus(apply(e, body_turn), relative_rate), cross(carried, relative))
    w = np.empty(9 * n)
    deflected(p, b, x, q, w)
    sums = b + at.SUMS
    base = sums + 3 * n
    rows, rest = base + 9 * n, base + 9 * n * (n + 1)
    second = p[b + at.SECOND_ORDER] > 0.5
    m = p[b + at.OWN_MASS]
    s = plus(triple(p, b + at.OWN_FIRST), _three(p, n, x, q, sums))
    ds = _three(p, n, x, v, sums)
    half_1, half_2 = _six(p, n, x, q, base), _six(w, n, x, q, 0)
    o = b + at.OWN_INERTIA
    j = (
        p[o] + 0.5 * (half_1[0] + half_2[0]),
        p[o + 1] + 0.5 * (half_1[1] + half_2[1]),
        p[o + 2] + 0.5 * (half_1[2] + half_2[2]),
        p[o + 3] + 0.5 * (half_1[3] + half_2[3]),
        p[o + 4] + 0.5 * (half_1[4] + half_2[4]),
        p[o + 5] + 0.5 * (half_1[5] + half_2[5]),
    )
    dj = _six(w, n, x, v, 0)
    linear = plus(plus(scaled(m, velocity), cross(spin, s)), ds)
    angular = plus(plus(cross(s, velocity), symmetric(j, spin)), _three(w, n, x, v, 6 * n))
    # one column a variable; the last 6 + n entries of work hold dr_V, dr_w, dr_q
    out = np.empty(6 + n)
    for k in range(8):
        if k >= 6 and not driven:
            break
        d_velocity, d_spin, d_push, d_turning = none, none, none, none
        if k < 3:
            d_velocity = _unit(k)
            if not fixed:
                d_velocity = apply(e, d_velocity)
                d_push = cross(d_velocity, relative)
        elif k < 6:
            d_spin = _unit(k - 3)
            if not fixed:
                d_velocity = apply(e, cross(d_spin, place))
                d_spin = apply(e, d_spin)
                d_push = cross(d_velocity, relative)
                d_turning = cross(d_spin, relative)
        elif k == 6:  # the angle
            d_velocity = cross(velocity, axis)
            d_spin = cross(carried, axis)
            d_push = plus(cross(felt, axis), cross(d_velocity, relative))
            d_turning = plus(cross(apply(e, body_turn), axis), cross(d_spin, relative))
        else:  # the rate
            d_spin = axis
            d_push = cross(velocity, axis)
            d_turning = cross(carried, axis)
        d_linear = plus(scaled(m, d_velocity), cross(d_spin, s))
        d_angular = plus(cross(s, d_velocity), symmetric(j, d_spin))
        force = plus(scaled(m, d_push), cross(d_turning, s))
        force = plus(force, plus(cross(d_spin, ds), cross(d_spin, linear)))
        force = plus(force, cross(spin, d_linear))
        torque = plus(cross(s, d_push), symmetric(j, d_turning))
        torque = plus(torque, plus(cross(ds, d_velocity), symmetric(dj, d_spin)))
        torque = plus(torque, plus(cross(d_spin, angular), cross(spin, d_angular)))
        torque = plus(torque, plus(cross(d_velocity, linear), cross(velocity, d_linear)))
        swept = plus(cross(d_velocity, spin), cross(velocity, d_spin))
        for i in range(n):
            along, about = _row(p, n, sums, i), _row(w, n, 6 * n, i)
            out[6 + i] = dot(along, d_push) + dot(about, d_turning) - dot(along, swept)
            out[6 + i] -= dot(spin, symmetric(_row_six(w, n, 0, i), d_spin))
        if second:
            for k2 in range(n):
                rate_2 = 2.0 * x[v + k2]
                for i in range(n):
                    g = _row(p, n, rows + 9 * n * k2 + 6 * n, i)
                    out[6 + i] += rate_2 * dot(g, d_spin)
        if k < 6:
            _place(p, b, e, fixed, force, torque, dv, k, out, row, n)
        elif k == 7:
            _place(p, b, e, fixed, force, torque, dv, 6 + hinge, out, row, n)
        else:
            _place(p, b, e, fixed, force, torque, dx, 6 + hinge, out, row, n)
            # the axes in which force and torque are given turn too
            all_force, all_torque = _residual(
                p,
                b,
                x,
                a,
                q,
                v,
                row,
                w,
                m,
                s,
                ds,
                j,
                dj,
                linear,
                angular,
                velocity,
                spin,
                push,
                turning,
            )
            pull = apply_transposed(e, cross(axis, all_force))
            about_body = plus(cross(place, pull), apply_transposed(e, cross(axis, all_torque)))
            for c in range(3):
                dx[c, 6 + hinge] += pull[c]
                dx[3 + c, 6 + hinge] += about_body[c]
    for k in range(n):
        # modal rate k
        along, about = _row(p, n, sums, k), _row(w, n, 6 * n, k)
        grown = symmetric(_row_six(w, n, 0, k), spin)
        force = scaled(2.0, cross(spin, along))
        torque = plus(grown, cross(spin, about))
        for i in range(n):
            out[6 + i] = p[rest + 2 * n + i * n + k]
            if second:
                out[6 + i] += 2.0 * dot(_row(p, n, rows + 9 * n * k + 6 * n, i), spin)
        _place(p, b, e, fixed, force, torque, dv, row + k, out, row, n)
        # modal coordinate k
        force = plus(cross(turning, along), cross(spin, cross(spin, along)))
        inner = plus(cross(along, velocity), grown)
        torque = plus(cross(along, push), symmetric(_row_six(w, n, 0, k), turning))
        out[6:] = 0.0
        if second:
            t_row = rows + 9 * n * k
            torque = plus(torque, _three(p, n, a, row, t_row + 6 * n))
            torque = plus(torque, symmetric(_six(p, n, x, v, t_row), spin))
            inner = plus(inner, _three(p, n, x, v, t_row + 6 * n))
            for i in range(n):
                out[6 + i] = dot(_row(p, n, t_row + 6 * n, i), turning)
                out[6 + i] -= 0.5 * dot(spin, symmetric(_row_six(p, n, t_row, i), spin))
        out[6 + k] += p[rest + n + k]
        torque = plus(torque, cross(spin, inner))
        torque = plus(torque, cross(velocity, cross(spin, along)))
        _place(p, b, e, fixed, force, torque, dx, row + k, out, row, n)
    if driven:
        dx[6 + hinge, 6 + hinge] += p[b + at.HINGE_STIFFNESS]
        dv[6 + hinge, 6 + hinge] += p[b + at.HINGE_DAMPING]


@called
def _residual(
    p: Vector,
    b: int,
    x: Vector,
    a: Vector,
    q: int,
    v: int,
    row: int,
    w: Vector,
    m: float,
    s: Triple,
    ds: Triple,
    j: tuple[float, ...],
    dj: tuple[float, ...],
    linear: Triple,
    angular: Triple,
    velocity: Triple,
    spin: Triple,
    push: Triple,
    turning: Triple,
) -> tuple[Triple, Triple]:
    """Return r_V and r_w of an appendage in its own axes."""
    n = int(p[b + at.COUNT])
    force = plus(plus(scaled(m, push), cross(turning, s)), _three(p, n, a, row, b + at.SUMS))
    force = plus(force, plus(cross(spin, ds), cross(spin, linear)))
    torque = plus(cross(s, push), symmetric(j, turning))
    torque = plus(torque, _three(w, n, a, row, 6 * n))
    torque = plus(torque, plus(cross(ds, velocity), symmetric(dj, spin)))
    return force, plus(torque, plus(cross(spin, angular), cross(velocity, linear)))


@called
def _place(
    p: Vector,
    b: int,
    e: Nine,
    fixed: bool,
    force: Triple,
    torque: Triple,
    to: Matrix,
    column: int,
    out: Vector,
    row: int,
    n: int,
) -> None:
    """Add one derivative, given in appendage axes, to a column of the spacecraft's."""
    if p[b + at.KIND] == at.DRIVEN:
        to[6 + int(p[b + at.HINGE_INDEX]), column] += dot(triple(p, b + at.AXIS), torque)
    if not fixed:
        force = apply_transposed(e, force)
        torque = plus(apply_transposed(e, torque), cross(triple(p, b + at.PLACE), force))
    for c in range(3):
        to[c, column] += force[c]
        to[3 + c, column] += torque[c]
    for i in range(n):
        to[row + i, column] += out[6 + i]


@compiled
def residual_jacobian(p: Vector, t: float, x: Vector, a: Vector, dq: Matrix, dv: Matrix) -> None:
    """Write dr/dq, shape (nv, nq), and dr/dv, shape (nv, nv), of r = M a + h at fixed a."""
    own_q, own_v, nq, nv = offsets(p)
    hinges, wheels = int(p[at.HINGES]), int(p[at.WHEELS])
    others = nv - own_v
    size = 6 + others
    acceleration = np.zeros(size)
    acceleration[6:] = a[own_v:]
    if p[at.MOTION] == at.FREE:
        acceleration[:6] = a[:6]
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
        own = scaled(p[table + at.WHEEL_INERTIA], triple(p, table))
        angular = plus(angular, scaled(x[nq + own_v + hinges + k], own))
        turned_by = cross(spin, own)
        for c in range(3):
            by_v[3 + c, 6 + hinges + k] += turned_by[c]
        table += at.WHEEL_SIZE
    for k in range(6):
        d_velocity, d_spin = _unit(k), _unit(k - 3)
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
        _appendage(p, t, x, acceleration, int(p[table + k]), by_q, by_v)
    dq[:] = 0.0
    dv[own_v:, own_v:] = by_v[6:, 6:]
    dq[own_v:, own_q:] = by_q[6:, 6:]
    if p[at.MOTION] == at.FREE:
        dv[:6] = by_v[:6]
        dv[6:, :6] = by_v[6:, :6]
        dq[:6, 7:] = by_q[:6, 6:]
    elif p[at.MOTION] == at.PIVOT:
        dv[0] = 0.0
        dv[1:, 0] = 0.0
        for c in range(6):
            b = p[at.PIVOT_AXES + c]
            dv[0, 1:] += b * by_v[c, 6:]
            dq[0, 1:] += b * by_q[c, 6:]
            dv[1:, 0] += b * by_v[6:, c]
            for d in range(6):
                dv[0, 0] += b * p[at.PIVOT_AXES + d] * by_v[c, d]


@compiled
def kinematics_jacobian(p: Vector, t: float, x: Vector, dq: Matrix, dv: Matrix) -> None:
    """Write d(N v)/dq, shape (nq, nq), and N, shape (nq, nv), of q' = N(q) v."""
    own_q, own_v, nq, nv = offsets(p)
    dq[:] = 0.0
    dv[:] = 0.0
    for i in range(nv - own_v):
        dv[own_q + i, own_v + i] = 1.0
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
