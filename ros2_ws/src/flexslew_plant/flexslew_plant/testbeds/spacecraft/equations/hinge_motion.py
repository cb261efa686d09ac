"""Prescribed hinge motions E(t), w_e and w_e' (Kwak 1989): smooth, bang-bang or from a table."""

import numpy as np

from flexslew_plant.arrays import Vector, called, compiled_once
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.equations.geometry import (
    Matrix3,
    Triple,
    read_matrix3,
    rotate_frame,
    scaled,
    triple,
)


@called
def share(p: Vector, m: int, s: float) -> tuple[float, float, float]:
    """Return how much of a manoeuvre's turn is done, and its first two derivatives in s.

    smooth: s - sin(2 pi s) / (2 pi), with one sine as its acceleration; bang_bang: full
    acceleration for one half, full deceleration for the other; table: quintic pieces through given
    shares, rates and accelerations, rows (s, share, d/ds, d2/ds2).

    Args:
        p: packed spacecraft.
        m: start of the manoeuvre in it.
        s: time since its begin, over its length, in 0..1.
    """
    if p[m + at.PROFILE] == at.SMOOTH:
        a = 2.0 * np.pi * s
        return s - np.sin(a) / (2.0 * np.pi), 1.0 - np.cos(a), 2.0 * np.pi * np.sin(a)
    if p[m + at.PROFILE] == at.BANG_BANG:
        if s < 0.5:
            return 2.0 * s * s, 4.0 * s, 4.0
        return 1.0 - 2.0 * (1.0 - s) ** 2, 4.0 * (1.0 - s), -4.0
    row, last = int(p[m + at.TABLE_AT]), int(p[m + at.ROWS]) - 1
    k = 0
    for later in range(1, last):
        if s >= p[row + 4 * later]:
            k = later
    r = row + 4 * k
    h = p[r + 4] - p[r]
    u = (s - p[r]) / h
    y0, d0, c0 = p[r + 1], h * p[r + 2], h * h * p[r + 3]
    y1, d1, c1 = p[r + 5], h * p[r + 6], h * h * p[r + 7]
    # the quintic with these values, slopes and curvatures at both ends
    e0 = y1 - y0 - d0 - 0.5 * c0
    e1 = d1 - d0 - c0
    e2 = c1 - c0
    a3 = 10.0 * e0 - 4.0 * e1 + 0.5 * e2
    a4 = -15.0 * e0 + 7.0 * e1 - e2
    a5 = 6.0 * e0 - 3.0 * e1 + 0.5 * e2
    value = y0 + u * (d0 + u * (0.5 * c0 + u * (a3 + u * (a4 + u * a5))))
    slope = d0 + u * (c0 + u * (3.0 * a3 + u * (4.0 * a4 + u * 5.0 * a5)))
    curve = c0 + u * (6.0 * a3 + u * (12.0 * a4 + u * 20.0 * a5))
    return value, slope / h, curve / (h * h)


@compiled_once()
def next_jump(p: Vector, t: float) -> float:
    """Return the first time after t at which the acceleration of a hinge jumps, or may [s].

    A turn in bang-bang does at its begin, middle and end, one from a table at begin and end.

    Args:
        p: packed spacecraft.
        t: time [s].
    """
    first_jump, table = np.inf, int(p[at.APPENDAGE_TABLE])
    for k in range(int(p[at.APPENDAGES])):
        b = int(p[table + k])
        for i in range(int(p[b + at.MANOEUVRES])):
            m = int(p[b + at.MOTION_AT]) + i * at.MANOEUVRE_SIZE
            if p[m + at.PROFILE] == at.SMOOTH:
                continue
            parts = 2 if p[m + at.PROFILE] == at.BANG_BANG else 1
            for half in range(parts + 1):
                jump = p[m + at.BEGIN] + p[m + at.LENGTH] * half / parts
                if t < jump < first_jump:
                    first_jump = jump
    return float(first_jump)


@called
def prescribed(p: Vector, b: int, t: float) -> tuple[Matrix3, Triple, Triple]:
    """Return E, w_e and w_e' of a prescribed hinge at time t; the rates in appendage axes.

    Args:
        p: packed spacecraft.
        b: start of the appendage's block.
        t: time [s].
    """
    count, m = int(p[b + at.MANOEUVRES]), int(p[b + at.MOTION_AT])
    last = -1
    for k in range(count):
        if t >= p[m + k * at.MANOEUVRE_SIZE + at.BEGIN]:
            last = k
    zero = (0.0, 0.0, 0.0)
    if last < 0:
        return read_matrix3(p, b + at.AXES), zero, zero
    m += last * at.MANOEUVRE_SIZE
    length, angle, axis = p[m + at.LENGTH], p[m + at.ANGLE], triple(p, m + at.ROTATION_AXIS)
    s = (t - p[m + at.BEGIN]) / length
    if s >= 1.0:
        done, rate, acceleration = 1.0, 0.0, 0.0
    else:
        done, rate, acceleration = share(p, m, s)
    e = rotate_frame(
        axis, np.cos(angle * done), np.sin(angle * done), read_matrix3(p, m + at.FROM_AXES)
    )
    return e, scaled(angle * rate / length, axis), scaled(angle * acceleration / length**2, axis)
