"""Sums over the modes of an appendage's packed integrals."""

from flexslew_plant.arrays import Vector, called
from flexslew_plant.testbeds.spacecraft.equations.geometry import (
    Triple,
)


@called
def symmetric_sums(a: Vector, n: int, q: Vector, at_q: int, row: int) -> tuple[float, ...]:
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
def three_sums(a: Vector, n: int, q: Vector, at_q: int, row: int) -> Triple:
    """Return sum_i q_i a[component n + i] for three components that begin at `row`."""
    x, y, z = 0.0, 0.0, 0.0
    for i in range(n):
        v = q[at_q + i]
        x += v * a[row + i]
        y += v * a[row + n + i]
        z += v * a[row + 2 * n + i]
    return x, y, z


@called
def row_of(a: Vector, n: int, row: int, i: int) -> Triple:
    """Return three components of entry i that begin at `row`."""
    return a[row + i], a[row + n + i], a[row + 2 * n + i]


@called
def symmetric_row(a: Vector, n: int, row: int, i: int) -> tuple[float, ...]:
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
def unit_vector(k: int) -> Triple:
    """Return the unit vector k."""
    return 1.0 * (k == 0), 1.0 * (k == 1), 1.0 * (k == 2)
