"""The matrix exponential for other machine code, where zero_order_hold would call Python."""

from math import ceil, log2

import numpy as np

from flexslew_plant.arrays import Matrix, Tensor, compiled_once

WORK = 6  # matrices
_TERMS = np.cumprod(np.concatenate(([1.0], 1.0 / np.arange(1.0, 17.0))))  # 1 / k!, up to 16
_REACH = 0.75  # norm up to which the terms left out are below 2^-55 of what is kept: x^17 / 17!


@compiled_once("a", "work")
def exponential(a: Matrix, work: Tensor) -> None:
    """Replace A by exp(A), its series up to A^16 of A / 2^s, squared s times.

    Four terms at a time (Paterson and Stockmeyer 1973, SIAM J. Comput. 2(1)), six products of
    matrices in all. A whose sizes differ much loses digits, as with any such method: balance it.

    Args:
        a: in and out, shape (k, k).
        work: of any content, shape (WORK, k, k).
    """
    k, norm = len(a), 0.0
    for j in range(k):
        column = 0.0
        for i in range(k):
            column += abs(a[i, j])
        norm = max(norm, column)
    halvings = 0 if norm <= _REACH else ceil(log2(norm / _REACH))
    scale = 0.5**halvings
    one, two, three, four = work[0], work[1], work[2], work[3]
    for i in range(k):
        for j in range(k):
            one[i, j] = scale * a[i, j]
    np.dot(one, one, two)
    np.dot(two, one, three)
    np.dot(two, two, four)
    now, then = work[4], work[5]
    for i in range(k):
        for j in range(k):
            now[i, j] = _TERMS[16] * four[i, j]
    for first in (12, 8, 4, 0):
        for i in range(k):
            for j in range(k):
                now[i, j] += _TERMS[first + 1] * one[i, j] + _TERMS[first + 2] * two[i, j]
                now[i, j] += _TERMS[first + 3] * three[i, j]
            now[i, i] += _TERMS[first]
        if first > 0:
            np.dot(four, now, then)
            now, then = then, now
    for _ in range(halvings):
        np.dot(now, now, then)
        now, then = then, now
    for i in range(k):
        for j in range(k):
            a[i, j] = now[i, j]

