"""A linear system as the sum of two, of which one has all poles of a kind."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import schur, solve_sylvester

from flexslew_plant.arrays import Matrix


class LinearPart(NamedTuple):
    """A, B and C of a part."""

    a: Matrix
    b: Matrix
    c: Matrix


def separated_parts(
    part: LinearPart, is_first: Callable[[complex], bool]
) -> tuple[LinearPart, LinearPart]:
    """Return the parts with the poles of a kind and with all others, whose sum is the system.

    A real Schur form puts the others last, and Sylvester's equation separates them.

    Args:
        part: the system.
        is_first: whether a pole belongs to the first part.
    """

    def select(real: float, imaginary: float = 0.0) -> bool:  # scipy gives one number, or two
        return is_first(complex(real, imaginary))

    a, basis, n = schur(part.a, sort=select)
    b, c = basis.T @ part.b, part.c @ basis
    if 0 < n < len(a):
        coupling = solve_sylvester(a[:n, :n], -a[n:, n:], -a[:n, n:])
        b, c = b.copy(), c.copy()
        c[:, n:] += c[:, :n] @ coupling
        b[:n] -= coupling @ b[n:]
    return LinearPart(a[:n, :n], b[:n], c[:, :n]), LinearPart(
        a[n:, n:], np.asarray(b[n:]), c[:, n:]
    )
