"""Exact derivatives of one appendage's part of the residual r = M(q, t) a + h(q, v, t)."""

from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, called, compiled
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.equations.frames import (
    geometric_rate_terms,
    geometric_rows,
    hinge_frame,
    offsets,
    platform_velocity,
    write_modal_sums,
)
from flexslew_plant.testbeds.spacecraft.equations.geometry import (
    Matrix3,
    Triple,
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
from flexslew_plant.testbeds.spacecraft.equations.sums import (
    row_of,
    symmetric_row,
    symmetric_sums,
    three_sums,
    unit_vector,
)


class _Moments(NamedTuple):
    """The mass of a deflected appendage about its hinge, in its own axes."""

    mass: float  # [kg]
    first: Triple  # [kg m]
    first_rate: Triple  # seen from the axes [kg m/s]
    inertia: tuple[float, ...]  # six entries [kg m^2]
    inertia_rate: tuple[float, ...]  # [kg m^2/s]


class _Motion(NamedTuple):
    """The motion of an appendage's hinge and axes, in its own axes, and its momenta."""

    velocity: Triple  # [m/s]
    spin: Triple  # [rad/s]
    push: Triple  # acceleration of the hinge, seen from the axes [m/s^2]
    alpha: Triple  # the same of the spin [rad/s^2]
    linear: Triple  # momentum [kg m/s]
    angular: Triple  # momentum about the hinge [N m s]


class _Modes(NamedTuple):
    """Where the modes of an appendage stand, and their sums."""

    v: int  # first rate in the state
    row: int  # first row of the residual
    sums: Vector  # as write_modal_sums leaves them


class _Derivative(NamedTuple):
    """The derivative of an appendage's residual by one variable, in its own axes."""

    force: Triple
    torque: Triple
    modal: Vector  # of its modes


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
    platform_q, platform_v, nq, _ = offsets(p)
    before = int(p[at.HINGES]) + int(p[at.WHEELS])
    n, first = int(p[b + at.COUNT]), int(p[b + at.START])
    q, v, row = platform_q + before + first, nq + platform_v + before + first, 6 + before + first
    fixed, has_motor = p[b + at.KIND] == at.FIXED, p[b + at.KIND] == at.DRIVEN
    hinge = int(p[b + at.HINGE_INDEX])
    body_velocity, body_spin = platform_velocity(p, x, nq)
    body_push, body_alpha = triple(a, 0), triple(a, 3)
    place, axis, e = triple(p, b + at.PLACE), triple(p, b + at.AXIS), read_matrix3(p, b + at.AXES)
    none = (0.0, 0.0, 0.0)
    velocity, spin, push, alpha = body_velocity, body_spin, body_push, body_alpha
    relative, base_spin, hinge_push = none, none, none
    if not fixed:
        angle, rate = 0.0, 0.0
        if has_motor:
            angle, rate = x[platform_q + hinge], x[nq + platform_v + hinge]
        e, relative, relative_rate = hinge_frame(p, b, t, angle, rate)
        if has_motor:
            relative_rate = scaled(a[6 + hinge], axis)
        velocity = apply(e, plus(body_velocity, cross(body_spin, place)))
        base_spin = apply(e, body_spin)
        spin = plus(base_spin, relative)
        hinge_push = apply(e, plus(body_push, cross(body_alpha, place)))
        push = plus(hinge_push, cross(velocity, relative))
        alpha = plus(plus(apply(e, body_alpha), relative_rate), cross(base_spin, relative))
    w = np.empty(12 * n)
    write_modal_sums(p, b, x, q, w)
    sums = b + at.SUMS
    base = sums + 3 * n
    rows, rest = base + 9 * n, base + 9 * n * (n + 1)
    second, has_geometric = p[b + at.SECOND_ORDER] > 0.5, p[b + at.GEOMETRIC] > 0.5
    short = geometric_rows(b, n)
    m = p[b + at.BODY_MASS]
    double_sum = plus(three_sums(p, n, x, q, sums), three_sums(w, n, x, q, 9 * n))
    s = plus(triple(p, b + at.BODY_FIRST), scaled(0.5, double_sum))
    ds = three_sums(w, n, x, v, 9 * n)
    half_1, half_2 = symmetric_sums(p, n, x, q, base), symmetric_sums(w, n, x, q, 0)
    o = b + at.BODY_INERTIA
    j = (
        p[o] + 0.5 * (half_1[0] + half_2[0]),
        p[o + 1] + 0.5 * (half_1[1] + half_2[1]),
        p[o + 2] + 0.5 * (half_1[2] + half_2[2]),
        p[o + 3] + 0.5 * (half_1[3] + half_2[3]),
        p[o + 4] + 0.5 * (half_1[4] + half_2[4]),
        p[o + 5] + 0.5 * (half_1[5] + half_2[5]),
    )
    dj = symmetric_sums(w, n, x, v, 0)
    linear = plus(plus(scaled(m, velocity), cross(spin, s)), ds)
    angular = plus(plus(cross(s, velocity), symmetric(j, spin)), three_sums(w, n, x, v, 6 * n))
    # one column a variable; out holds dr_q
    out = np.empty(n)
    for k in range(8):
        if k >= 6 and not has_motor:
            break
        d_velocity, d_spin, d_push, d_alpha = none, none, none, none
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
                d_alpha = cross(d_spin, relative)
        elif k == 6:  # the angle
            d_velocity = cross(velocity, axis)
            d_spin = cross(base_spin, axis)
            d_push = plus(cross(hinge_push, axis), cross(d_velocity, relative))
            d_alpha = plus(cross(apply(e, body_alpha), axis), cross(d_spin, relative))
        else:  # the rate
            d_spin = axis
            d_push = cross(velocity, axis)
            d_alpha = cross(base_spin, axis)
        d_linear = plus(scaled(m, d_velocity), cross(d_spin, s))
        d_angular = plus(cross(s, d_velocity), symmetric(j, d_spin))
        force = plus(scaled(m, d_push), cross(d_alpha, s))
        force = plus(force, plus(cross(d_spin, ds), cross(d_spin, linear)))
        force = plus(force, cross(spin, d_linear))
        torque = plus(cross(s, d_push), symmetric(j, d_alpha))
        torque = plus(torque, plus(cross(ds, d_velocity), symmetric(dj, d_spin)))
        torque = plus(torque, plus(cross(d_spin, angular), cross(spin, d_angular)))
        torque = plus(torque, plus(cross(d_velocity, linear), cross(velocity, d_linear)))
        cross_velocity = plus(cross(d_velocity, spin), cross(velocity, d_spin))
        for i in range(n):
            along, moment_row = row_of(w, n, 9 * n, i), row_of(w, n, 6 * n, i)
            out[i] = dot(along, d_push) + dot(moment_row, d_alpha) - dot(along, cross_velocity)
            out[i] -= dot(spin, symmetric(symmetric_row(w, n, 0, i), d_spin))
        if second:
            for k2 in range(n):
                rate_2 = 2.0 * x[v + k2]
                for i in range(n):
                    g = row_of(p, n, rows + 9 * n * k2 + 6 * n, i)
                    out[i] += rate_2 * dot(g, d_spin)
        if k < 6:
            _add_column(p, b, e, row, _Derivative(force, torque, out), dv, k)
        elif k == 7:
            _add_column(p, b, e, row, _Derivative(force, torque, out), dv, 6 + hinge)
        else:
            _add_column(p, b, e, row, _Derivative(force, torque, out), dx, 6 + hinge)
            # the axes in which force and torque are given turn too
            moments = _Moments(m, s, ds, j, dj)
            motion = _Motion(velocity, spin, push, alpha, linear, angular)
            all_force, all_torque = _residual(p, b, x, a, _Modes(v, row, w), moments, motion)
            pull = apply_transposed(e, cross(axis, all_force))
            body_torque = plus(cross(place, pull), apply_transposed(e, cross(axis, all_torque)))
            for c in range(3):
                dx[c, 6 + hinge] += pull[c]
                dx[3 + c, 6 + hinge] += body_torque[c]
    for k in range(n):
        # modal rate k
        along, moment_row = row_of(w, n, 9 * n, k), row_of(w, n, 6 * n, k)
        inertia_term = symmetric(symmetric_row(w, n, 0, k), spin)
        force = scaled(2.0, cross(spin, along))
        torque = plus(inertia_term, cross(spin, moment_row))
        mode_start = short + 6 * n * k
        if has_geometric:
            force = plus(force, scaled(2.0, three_sums(p, n, x, v, mode_start)))
            torque = plus(torque, scaled(2.0, three_sums(p, n, x, v, mode_start + 3 * n)))
        for i in range(n):
            out[i] = p[rest + 2 * n + i * n + k]
            if second:
                out[i] += 2.0 * dot(row_of(p, n, rows + 9 * n * k + 6 * n, i), spin)
        _add_column(p, b, e, row, _Derivative(force, torque, out), dv, row + k)
        # modal coordinate k
        force = plus(cross(alpha, along), cross(spin, cross(spin, along)))
        inner = plus(cross(along, velocity), inertia_term)
        torque = plus(cross(along, push), symmetric(symmetric_row(w, n, 0, k), alpha))
        out[:] = 0.0
        if second:
            t_row = rows + 9 * n * k
            torque = plus(torque, three_sums(p, n, a, row, t_row + 6 * n))
            torque = plus(torque, symmetric(symmetric_sums(p, n, x, v, t_row), spin))
            inner = plus(inner, three_sums(p, n, x, v, t_row + 6 * n))
            for i in range(n):
                out[i] = dot(row_of(p, n, t_row + 6 * n, i), alpha)
                out[i] -= 0.5 * dot(spin, symmetric(symmetric_row(p, n, t_row, i), spin))
        if has_geometric:
            geometric_velocity = three_sums(p, n, x, v, mode_start)
            force = plus(force, three_sums(p, n, a, row, mode_start))
            force = plus(force, scaled(2.0, cross(spin, geometric_velocity)))
            torque = plus(torque, three_sums(p, n, a, row, mode_start + 3 * n))
            inner = plus(inner, three_sums(p, n, x, v, mode_start + 3 * n))
            frame_acceleration = plus(push, cross(spin, velocity))
            for i in range(n):
                out[i] += dot(row_of(p, n, mode_start, i), frame_acceleration)
                out[i] += dot(row_of(p, n, mode_start + 3 * n, i), alpha)
        out[k] += p[rest + n + k]
        torque = plus(torque, cross(spin, inner))
        torque = plus(torque, cross(velocity, cross(spin, along)))
        _add_column(p, b, e, row, _Derivative(force, torque, out), dx, row + k)
    if has_motor:
        dx[6 + hinge, 6 + hinge] += p[b + at.HINGE_STIFFNESS]
        dv[6 + hinge, 6 + hinge] += p[b + at.HINGE_DAMPING]


@called
def _residual(
    p: Vector, b: int, x: Vector, a: Vector, modes: _Modes, moments: _Moments, motion: _Motion
) -> tuple[Triple, Triple]:
    """Return r_V and r_w of an appendage in its own axes."""
    m, s, ds, j, dj = moments
    velocity, spin, push, alpha, linear, angular = motion
    n, row, w = int(p[b + at.COUNT]), modes.row, modes.sums
    force = plus(plus(scaled(m, push), cross(alpha, s)), three_sums(w, n, a, row, 9 * n))
    force = plus(force, plus(cross(spin, ds), cross(spin, linear)))
    torque = plus(cross(s, push), symmetric(j, alpha))
    torque = plus(torque, three_sums(w, n, a, row, 6 * n))
    torque = plus(torque, plus(cross(ds, velocity), symmetric(dj, spin)))
    torque = plus(torque, plus(cross(spin, angular), cross(velocity, linear)))
    rate_force, rate_torque = geometric_rate_terms(p, b, x, modes.v)
    return plus(force, rate_force), plus(torque, rate_torque)


@called
def _add_column(
    p: Vector, b: int, e: Matrix3, row: int, derivative: _Derivative, to: Matrix, column: int
) -> None:
    """Add one derivative, given in appendage axes e, to a column of the spacecraft's."""
    force, torque, modal = derivative
    if p[b + at.KIND] == at.DRIVEN:
        to[6 + int(p[b + at.HINGE_INDEX]), column] += dot(triple(p, b + at.AXIS), torque)
    if p[b + at.KIND] != at.FIXED:
        force = apply_transposed(e, force)
        torque = plus(apply_transposed(e, torque), cross(triple(p, b + at.PLACE), force))
    for c in range(3):
        to[c, column] += force[c]
        to[3 + c, column] += torque[c]
    for i in range(modal.size):
        to[row + i, column] += modal[i]
