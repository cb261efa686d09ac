"""A real matrix as independent blocks: its real and slow poles together, then pairs of poles.

A = R diag(S, [s_k, w_k; -w_k, s_k], ...) L with L R = 1. Poles that are zero come in chains (a
rigid motion: x' = v, v' = 0), which no diagonal form has; they stay together in the first block.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import eig, matrix_balance, schur, solve_sylvester

from flexslew_plant.arrays import Matrix, Vector

_SLOW = 1e-6  # of the fastest pole: what a double pole at zero is computed as
_LARGEST_CONDITION = 1e6  # of eigenvectors, above which poles stay in one block
_MOST_DOUBLINGS = 8  # of a scale


class Blocks(NamedTuple):
    """A matrix of size n in blocks."""

    first: Matrix  # S, (k, k)
    damping: Vector  # s_k, real parts of the poles of the pairs [1/s]
    frequency: Vector  # w_k, their imaginary parts, above zero [rad/s]
    left: Matrix  # L, (n, n)
    right: Matrix  # R, (n, n)


def blocks(a: Matrix) -> Blocks:
    """Return the blocks of a matrix; those of one with nearly equal eigenvectors are one."""
    scaled, scale = balanced(a)
    found = _separated(scaled)
    if np.linalg.cond(found.right) > _LARGEST_CONDITION:
        found = Blocks(scaled, np.zeros(0), np.zeros(0), np.eye(len(a)), np.eye(len(a)))
    return found._replace(left=found.left / scale, right=scale[:, None] * found.right)


def balanced(a: Matrix) -> tuple[Matrix, Vector]:
    """Return S^-1 a S of rows and columns of like size, and the diagonal of S.

    S is limited: a rigid motion with zeros that rounding has left its traces in has no balance.
    """
    with np.errstate(invalid="ignore"):  # SciPy takes the scale for places, too
        _, (scale, _) = matrix_balance(a, permute=False, separate=True)
    power = np.log2(scale)
    scale = 2.0 ** np.clip(np.round(power - np.median(power)), -_MOST_DOUBLINGS, _MOST_DOUBLINGS)
    return a / scale[:, None] * scale, scale


def _separated(a: Matrix) -> Blocks:
    slow = _SLOW * float(np.abs(np.linalg.eigvals(a)).max(initial=0.0))

    def first(real: float, imaginary: float) -> bool:
        return imaginary == 0.0 or np.hypot(real, imaginary) <= slow

    t, z, k = schur(a, output="real", sort=first)
    coupling = solve_sylvester(t[:k, :k], -t[k:, k:], -t[:k, k:])
    values, vectors = eig(t[k:, k:])
    upper = values.imag > 0.0
    values, vectors = values[upper], vectors[:, upper]
    pairs = np.empty((len(t) - k, 2 * len(values)))
    pairs[:, ::2], pairs[:, 1::2] = vectors.real, vectors.imag
    joined = np.block(
        [[np.eye(k), coupling @ pairs], [np.zeros((len(pairs), k)), pairs]]
    )  # fmt: skip
    right = z @ joined
    scale = np.linalg.norm(right, axis=0)
    scale[k::2] = scale[k + 1 :: 2] = np.maximum(scale[k::2], scale[k + 1 :: 2])
    right = right / scale
    return Blocks(t[:k, :k] * scale[:k] / scale[:k, None], values.real, values.imag,
                  np.linalg.inv(right), right)  # fmt: skip
