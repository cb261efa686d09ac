"""Solutions of the algebraic Riccati equations, in any units of states, efforts and time.

SciPy's solver, which python-control calls, too, balances the states alone: where an effort or a
second is a small or a large number compared with them it loses digits, or finds no solution of a
problem that has one. It is called first; where that fails, it is called in other units.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.linalg import LinAlgError, solve_continuous_are, solve_discrete_are

from flexslew_plant.arrays import Matrix, Vector

_CLOSE = 1e-8  # of the terms of the equation, which must add up to zero


def continuous_riccati(
    a: Matrix, b: Matrix, q: Matrix, r: Matrix, s: Matrix | None = None
) -> Matrix:
    """Return P of 0 = A^T P + P A + Q - (P B + S) R^-1 (B^T P + S^T), the stabilising one.

    Args:
        a: shape (k, k).
        b: shape (k, m).
        q: weights of the states, shape (k, k).
        r: weights of the efforts, positive definite, shape (m, m).
        s: weights of both, shape (k, m); None: zero.

    Raises:
        LinAlgError: there is none.
    """
    cross = np.zeros_like(b) if s is None else s
    effort = 1.0 / np.sqrt(np.diag(r))

    def rate() -> float:
        """Return how fast the closed loop is, from the Hamiltonian matrix [1/s]."""
        gain = np.linalg.solve(r, np.hstack((cross.T, b.T)))
        k = len(a)
        drift = a - b @ gain[:, :k]
        matrix = np.block([[drift, -b @ gain[:, k:]], [-(q - cross @ gain[:, :k]), -drift.T]])
        return float(abs(np.linalg.eigvals(matrix)).max()) or 1.0

    def scaled() -> Matrix:
        time = 1.0 / rate()
        size = np.sqrt(time) * effort
        weight = effort[:, None] * r * effort
        return _solution(solve_continuous_are, time * a, b * size, time * q, weight, s=cross * size)

    def mismatch(p: Matrix) -> float:
        gain = p @ b + cross
        effort_term = gain @ np.linalg.solve(r, gain.T)
        return _mismatch(
            a.T @ p + p @ a + q - effort_term, 2.0 * abs(a.T) @ abs(p) + abs(q) + abs(effort_term)
        )

    return _best(lambda: _solution(solve_continuous_are, a, b, q, r, s=s), scaled, mismatch)


def discrete_riccati(f: Matrix, g: Matrix, q: Matrix, r: Matrix, s: Matrix | None = None) -> Matrix:
    """Return P of P = F^T P F + Q - (F^T P G + S) (R + G^T P G)^-1 (G^T P F + S^T).

    Args:
        f: shape (k, k).
        g: shape (k, m).
        q: weights of the states, shape (k, k).
        r: weights of the efforts, positive definite, shape (m, m).
        s: weights of both, shape (k, m); None: zero.

    Raises:
        LinAlgError: there is no stabilising one.
    """
    cross = np.zeros_like(g) if s is None else s
    effort = 1.0 / np.sqrt(np.diag(r))

    def scaled() -> Matrix:
        weight = effort[:, None] * r * effort
        return _solution(solve_discrete_are, f, g * effort, q, weight, s=cross * effort)

    def mismatch(p: Matrix) -> float:
        gain = f.T @ p @ g + cross
        effort_term = gain @ np.linalg.solve(r + g.T @ p @ g, gain.T)
        state_term = abs(f.T) @ abs(p) @ abs(f)
        return _mismatch(
            f.T @ p @ f - p + q - effort_term, state_term + abs(p) + abs(q) + abs(effort_term)
        )

    return _best(lambda: _solution(solve_discrete_are, f, g, q, r, s=s), scaled, mismatch)


def _solution(solve: Callable[..., Any], *matrices: Matrix, s: Matrix | None) -> Matrix:
    """Return SciPy's solution; what it calls a ValueError is no solution, too."""
    try:
        return np.asarray(solve(*matrices, s=s), dtype=np.float64)
    except ValueError as error:
        raise LinAlgError(str(error)) from None


def _mismatch(rest: Matrix, terms: Matrix) -> float:
    """Return the largest entry of what should be zero, in units in which the terms are one."""
    size: Vector = np.sqrt(np.maximum(np.diag(terms), np.finfo(float).tiny))
    return float(abs(rest / size / size[:, None]).max())


def _best(
    first: Callable[[], Matrix], scaled: Callable[[], Matrix], mismatch: Callable[[Matrix], float]
) -> Matrix:
    """Return the first solution if it is one, else the better of both."""
    found = []
    for solve in (first, scaled):
        try:
            p = solve()
        except LinAlgError as error:
            last = error
            continue
        found.append((mismatch(p), p))
        if found[-1][0] < _CLOSE:
            break
    if not found:
        raise last
    return min(found, key=lambda pair: pair[0])[1]
