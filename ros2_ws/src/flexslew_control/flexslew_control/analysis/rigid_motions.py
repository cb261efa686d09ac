"""Rigid motions of a closed sampled loop that nothing returns: poles at z = 1 that joints show.

A displacement N with (A - I) N = 0 rests wherever it is left; where the rows L of L (A - I) = 0 are
orthogonal to it, it belongs to a drift and its pole is a double one. Both follow from singular
vectors, as eigenvalues of a double pole have half the digits only.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import matrix_balance

from flexslew_control.analysis.loop import ControlLoop
from flexslew_plant.arrays import Matrix

_ZERO = 1e-12  # singular value of the balanced A - I, of the largest
_ALONG = 1e-6  # product of unit vectors, of the largest reading of a joint [-]


class RigidModes(NamedTuple):
    """Rigid motions that a loop does not control."""

    joints: tuple[str, ...]  # that show them
    poles: int  # at z = 1


def free_rigid_modes(loop: ControlLoop) -> RigidModes:
    """Return the rigid motions that joints show and the closed loop does not return."""
    closed = loop.closed.a
    balanced, (scale, _) = matrix_balance(closed, permute=False, separate=True)
    pencil = balanced - np.eye(len(balanced))
    left, sizes, right = np.linalg.svd(pencil)
    is_zero = sizes <= _ZERO * sizes.max(initial=0.0)
    rigid, rows = right[is_zero].T, left[:, is_zero].T
    seen = loop.joint_positions * scale
    visible = seen @ rigid
    if not is_zero.any() or not visible.any():
        return RigidModes((), 0)
    largest = np.linalg.norm(seen, axis=1).max()
    drift = rigid @ _null(rows @ rigid)
    touched = np.linalg.norm(visible, axis=1) > _ALONG * largest
    names = tuple(n for n, flag in zip(loop.joint_names, touched, strict=True) if flag)
    return RigidModes(names, _rank(visible, largest) + _rank(seen @ drift, largest))


def _null(matrix: Matrix) -> Matrix:
    """Return an orthonormal basis of what a square matrix maps to zero."""
    _, sizes, right = np.linalg.svd(matrix)
    return np.asarray(right[sizes <= _ALONG].T)


def _rank(matrix: Matrix, largest: float) -> int:
    return int(np.linalg.matrix_rank(matrix, tol=_ALONG * largest)) if matrix.size else 0
