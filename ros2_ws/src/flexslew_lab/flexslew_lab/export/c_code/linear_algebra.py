"""Linear equations as loops, which the evaluator writes out where a step calls NumPy's LAPACK."""

import numpy as np

from flexslew_plant.arrays import Matrix, Vector


def inverse(a: Matrix) -> Matrix:
    """Return a^-1, shape (n, n)."""
    return solve_rows(a, np.eye(len(a)))


def solve_vector(a: Matrix, b: Vector) -> Vector:
    """Return a^-1 b, shape (n,)."""
    return solve_rows(a, b.reshape((len(a), 1))).reshape((len(a),))


def solve_rows(a: Matrix, b: Matrix) -> Matrix:
    """Return a^-1 b by Gauss's elimination with the largest pivot of each column, shape (n, m).

    Args:
        a: shape (n, n).
        b: right-hand sides, shape (n, m).
    """
    left, right = a.copy(), b.copy()
    n, m = right.shape
    for j in range(n):
        pivot = j
        for i in range(j + 1, n):
            pivot = i if abs(left[i, j]) > abs(left[pivot, j]) else pivot
        for k in range(n):
            kept = left[j, k] * 1.0
            left[j, k] = left[pivot, k]
            left[pivot, k] = kept
        for k in range(m):
            kept = right[j, k] * 1.0
            right[j, k] = right[pivot, k]
            right[pivot, k] = kept
        for i in range(j + 1, n):
            factor = left[i, j] / left[j, j]
            for k in range(n):
                left[i, k] -= factor * left[j, k]
            for k in range(m):
                right[i, k] -= factor * right[j, k]
    for i in range(n - 1, -1, -1):
        for k in range(m):
            for j in range(i + 1, n):
                right[i, k] -= left[i, j] * right[j, k]
            right[i, k] /= left[i, i]
    return right


def determinant(a: Matrix) -> float:
    """Return the determinant of a, shape (n, n), by the same elimination."""
    left, n, found = a.copy(), len(a), 1.0
    for j in range(n):
        pivot = j
        for i in range(j + 1, n):
            pivot = i if abs(left[i, j]) > abs(left[pivot, j]) else pivot
        found *= left[pivot, j] if pivot == j else -left[pivot, j]
        for k in range(n):
            kept = left[j, k] * 1.0
            left[j, k] = left[pivot, k]
            left[pivot, k] = kept
        for i in range(j + 1, n):
            factor = left[i, j] / left[j, j] if left[j, j] != 0.0 else 0.0
            for k in range(n):
                left[i, k] -= factor * left[j, k]
    return found
