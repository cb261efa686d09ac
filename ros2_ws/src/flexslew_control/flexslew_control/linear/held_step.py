"""The zero-order hold for other machine code, where zero_order_hold would call Python."""

from math import ceil, log2

import numpy as np

from flexslew_plant.arrays import Matrix, called, compiled_once

_TERMS = np.cumprod(np.concatenate(([1.0], 1.0 / np.arange(1.0, 17.0))))  # 1 / k!, up to 16
_REACH = 0.75  # norm up to which the terms left out, x^17 / 17! and on, are below 2^-55


@compiled_once("both")
def exponential_step(both: Matrix) -> None:
    """Replace [A B] h by [F G] of zero_order_hold: the top of exp([[A, B], [0, 0]] h).

    The series up to the 16th power of a 2^s-th of the matrix, four terms at a time (Paterson and
    Stockmeyer 1973, SIAM J. Comput. 2(1)), is squared s times. Where states are of different sizes
    that loses digits: balance them.

    Args:
        both: in and out, shape (k, k + m).
    """
    k, columns, norm = len(both), both.shape[1], 0.0
    for j in range(columns):
        column = 0.0
        for i in range(k):
            column += abs(both[i, j])
        norm = max(norm, column)
    halvings = 0 if norm <= _REACH else ceil(log2(norm / _REACH))
    left, one = np.empty((k, k)), both * 0.5**halvings
    two, three, four = np.empty((k, columns)), np.empty((k, columns)), np.empty((k, columns))
    _multiply(one, one, 0.0, left, two)
    _multiply(one, two, 0.0, left, three)
    _multiply(two, two, 0.0, left, four)
    now, then = _TERMS[16] * four, np.empty((k, columns))
    for first in (12, 8, 4, 0):
        for i in range(k):
            for j in range(columns):
                now[i, j] += _TERMS[first + 1] * one[i, j] + _TERMS[first + 2] * two[i, j]
                now[i, j] += _TERMS[first + 3] * three[i, j]
            now[i, i] += _TERMS[first]
        if first > 0:
            _multiply(four, now, _TERMS[first], left, then)
            now, then = then, now
    for _ in range(halvings):
        _multiply(now, now, 1.0, left, then)
        now, then = then, now
    for i in range(k):
        for j in range(columns):
            both[i, j] = now[i, j]


@called
def _multiply(a: Matrix, b: Matrix, below: float, left: Matrix, out: Matrix) -> None:
    """Write the top of a product of two matrices from their tops, shapes (k, k + m).

    Args:
        a: the top of the first.
        b: the top of the second.
        below: what stands on the diagonal below that of b.
        left: of any content, shape (k, k).
        out: shape (k, k + m).
    """
    k = len(a)
    for i in range(k):
        for j in range(k):
            left[i, j] = a[i, j]
    np.dot(left, b, out)
    if below != 0.0:
        for i in range(k):
            for j in range(k, a.shape[1]):
                out[i, j] += below * a[i, j]
