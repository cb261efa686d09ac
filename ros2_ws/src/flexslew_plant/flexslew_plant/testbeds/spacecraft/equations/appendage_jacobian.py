"""Exact derivatives of one appendage's part of the residual r = M(q, t) a + h(q, v, t)."""

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, called, compiled
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.equations.frames import (
    deflected,
    hinge_frame,
    offsets,
    platform_velocity,
    shortening,
    shortening_rates,
)
from flexslew_plant.testbeds.spacecraft.equations.geometry import (
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
from flexslew_plant.testbeds.spacecraft.equations.sums import (
    row_of,
    six_of_row,
    six_sums,
    three_sums,
    unit_vector,
)


@compiled
def add_appendage(
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
        b: start of the appendage's block.
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
    w = np.empty(12 * n)
    deflected(p, b, x, q, w)
    sums = b + at.SUMS
    base = sums + 3 * n
    rows, rest = base + 9 * n, base + 9 * n * (n + 1)
    second, shortens = p[b + at.SECOND_ORDER] > 0.5, p[b + at.GEOMETRIC] > 0.5
    short = shortening(b, n)
    m = p[b + at.OWN_MASS]
    twice = plus(three_sums(p, n, x, q, sums), three_sums(w, n, x, q, 9 * n))
    s = plus(triple(p, b + at.OWN_FIRST), scaled(0.5, twice))
    ds = three_sums(w, n, x, v, 9 * n)
    half_1, half_2 = six_sums(p, n, x, q, base), six_sums(w, n, x, q, 0)
    o = b + at.OWN_INERTIA
    j = (
        p[o] + 0.5 * (half_1[0] + half_2[0]),
        p[o + 1] + 0.5 * (half_1[1] + half_2[1]),
        p[o + 2] + 0.5 * (half_1[2] + half_2[2]),
        p[o + 3] + 0.5 * (half_1[3] + half_2[3]),
        p[o + 4] + 0.5 * (half_1[4] + half_2[4]),
        p[o + 5] + 0.5 * (half_1[5] + half_2[5]),
    )
    dj = six_sums(w, n, x, v, 0)
    linear = plus(plus(scaled(m, velocity), cross(spin, s)), ds)
    angular = plus(plus(cross(s, velocity), symmetric(j, spin)), three_sums(w, n, x, v, 6 * n))
    # one column a variable; the last 6 + n entries of work hold dr_V, dr_w, dr_q
    out = np.empty(6 + n)
    for k in range(8):
        if k >= 6 and not driven:
            break
        d_velocity, d_spin, d_push, d_turning = none, none, none, none
        if k < 3:
            d_velocity = unit_vector(k)
            if not fixed:
                d_velocity = apply(e, d_velocity)
                d_push = cross(d_velocity, relative)
        elif k < 6:
            d_spin = unit_vector(k - 3)
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
            along, about = row_of(w, n, 9 * n, i), row_of(w, n, 6 * n, i)
            out[6 + i] = dot(along, d_push) + dot(about, d_turning) - dot(along, swept)
            out[6 + i] -= dot(spin, symmetric(six_of_row(w, n, 0, i), d_spin))
        if second:
            for k2 in range(n):
                rate_2 = 2.0 * x[v + k2]
                for i in range(n):
                    g = row_of(p, n, rows + 9 * n * k2 + 6 * n, i)
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
        along, about = row_of(w, n, 9 * n, k), row_of(w, n, 6 * n, k)
        grown = symmetric(six_of_row(w, n, 0, k), spin)
        force = scaled(2.0, cross(spin, along))
        torque = plus(grown, cross(spin, about))
        own = short + 6 * n * k
        if shortens:
            force = plus(force, scaled(2.0, three_sums(p, n, x, v, own)))
            torque = plus(torque, scaled(2.0, three_sums(p, n, x, v, own + 3 * n)))
        for i in range(n):
            out[6 + i] = p[rest + 2 * n + i * n + k]
            if second:
                out[6 + i] += 2.0 * dot(row_of(p, n, rows + 9 * n * k + 6 * n, i), spin)
        _place(p, b, e, fixed, force, torque, dv, row + k, out, row, n)
        # modal coordinate k
        force = plus(cross(turning, along), cross(spin, cross(spin, along)))
        inner = plus(cross(along, velocity), grown)
        torque = plus(cross(along, push), symmetric(six_of_row(w, n, 0, k), turning))
        out[6:] = 0.0
        if second:
            t_row = rows + 9 * n * k
            torque = plus(torque, three_sums(p, n, a, row, t_row + 6 * n))
            torque = plus(torque, symmetric(six_sums(p, n, x, v, t_row), spin))
            inner = plus(inner, three_sums(p, n, x, v, t_row + 6 * n))
            for i in range(n):
                out[6 + i] = dot(row_of(p, n, t_row + 6 * n, i), turning)
                out[6 + i] -= 0.5 * dot(spin, symmetric(six_of_row(p, n, t_row, i), spin))
        if shortens:
            drawn_in = three_sums(p, n, x, v, own)
            force = plus(force, three_sums(p, n, a, row, own))
            force = plus(force, scaled(2.0, cross(spin, drawn_in)))
            torque = plus(torque, three_sums(p, n, a, row, own + 3 * n))
            inner = plus(inner, three_sums(p, n, x, v, own + 3 * n))
            felt_here = plus(push, cross(spin, velocity))
            for i in range(n):
                out[6 + i] += dot(row_of(p, n, own, i), felt_here)
                out[6 + i] += dot(row_of(p, n, own + 3 * n, i), turning)
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
    force = plus(plus(scaled(m, push), cross(turning, s)), three_sums(w, n, a, row, 9 * n))
    force = plus(force, plus(cross(spin, ds), cross(spin, linear)))
    torque = plus(cross(s, push), symmetric(j, turning))
    torque = plus(torque, three_sums(w, n, a, row, 6 * n))
    torque = plus(torque, plus(cross(ds, velocity), symmetric(dj, spin)))
    torque = plus(torque, plus(cross(spin, angular), cross(velocity, linear)))
    pulled_in, turned_in = shortening_rates(p, b, x, v)
    return plus(force, pulled_in), plus(torque, turned_in)


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
