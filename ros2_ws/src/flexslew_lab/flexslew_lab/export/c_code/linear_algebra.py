"""Linear equations as loops, which the evaluator writes out where a step calls NumPy's LAPACK."""

import numpy as np

from flexslew_plant.arrays import Matrix, Vector

_SWEEPS = 10  # of Jacobi rotations, which converge quadratically
_ORTHOGONAL = 1e-31  # squared cosine of columns that count as orthogonal


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
    _eliminate(left, right)
    for i in range(n - 1, -1, -1):
        for k in range(m):
            for j in range(i + 1, n):
                right[i, k] -= left[i, j] * right[j, k]
            right[i, k] /= left[i, i]
    return right


def determinant(a: Matrix) -> float:
    """Return the determinant of a, shape (n, n), by the same elimination."""
    left = a.copy()
    found = _eliminate(left, np.zeros((len(a), 0)))
    for j in range(len(a)):
        found *= left[j, j]
    return found


def _eliminate(left: Matrix, right: Matrix) -> float:
    """Make a matrix upper triangular by row operations; return the sign of its row exchanges.

    Args:
        left: shape (n, n); overwritten.
        right: to which the same operations apply, shape (n, m); overwritten.
    """
    n, m = right.shape
    sign = 1.0
    for j in range(n):
        pivot = j
        for i in range(j + 1, n):
            pivot = i if abs(left[i, j]) > abs(left[pivot, j]) else pivot
        sign = sign if pivot == j else -sign
        for k in range(n):
            kept = left[j, k] * 1.0
            left[j, k] = left[pivot, k]
            left[pivot, k] = kept
        for k in range(m):
            kept = right[j, k] * 1.0
            right[j, k] = right[pivot, k]
            right[pivot, k] = kept
        for i in range(j + 1, n):
            factor = left[i, j] / left[j, j] if left[j, j] != 0.0 else 0.0
            for k in range(n):
                left[i, k] -= factor * left[j, k]
            for k in range(m):
                right[i, k] -= factor * right[j, k]
    return sign


def pseudo_inverse(a: Matrix, cutoff: float) -> Matrix:
    """Return the pseudo-inverse of a, shape (n, m), by Jacobi rotations of its rows.

    Rotations V make the columns of W = a^T V orthogonal (Hestenes 1958). Their lengths are the
    singular values, and a^+ = W S^-2 V^T.

    Args:
        a: shape (m, n).
        cutoff: singular values below this share of the largest count as 0.
    """
    m, n = a.shape
    w, v = a.T.copy(), np.eye(m)
    for _ in range(_SWEEPS):
        for i in range(m - 1):
            for j in range(i + 1, m):
                alpha, beta, gamma = 0.0, 0.0, 0.0
                for k in range(n):
                    alpha += w[k, i] * w[k, i]
                    beta += w[k, j] * w[k, j]
                    gamma += w[k, i] * w[k, j]
                cosine, sine = 1.0, 0.0
                if gamma * gamma > _ORTHOGONAL * alpha * beta:
                    zeta = (beta - alpha) / (2.0 * gamma)
                    tangent = 1.0 / (abs(zeta) + np.sqrt(1.0 + zeta * zeta))
                    tangent = tangent if zeta >= 0.0 else -tangent
                    cosine = 1.0 / np.sqrt(1.0 + tangent * tangent)
                    sine = cosine * tangent
                for k in range(n):
                    kept = w[k, i] * 1.0
                    w[k, i] = cosine * kept - sine * w[k, j]
                    w[k, j] = sine * kept + cosine * w[k, j]
                for k in range(m):
                    kept = v[k, i] * 1.0
                    v[k, i] = cosine * kept - sine * v[k, j]
                    v[k, j] = sine * kept + cosine * v[k, j]
    squares = np.zeros(m)
    largest = 0.0
    for i in range(m):
        for k in range(n):
            squares[i] += w[k, i] * w[k, i]
        largest = max(largest, squares[i])
    found = np.zeros((n, m))
    for i in range(m):
        share = 1.0 / squares[i] if squares[i] > cutoff * cutoff * largest else 0.0
        for k in range(n):
            for j in range(m):
                found[k, j] += w[k, i] * share * v[j, i]
    return found
