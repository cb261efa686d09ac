"""Gains about the body axes as gains of single joints, for planners that count with those."""

import numpy as np
from scipy.optimize import nnls

from flexslew_control.allocation.allocation import Allocation
from flexslew_control.law import per_joint
from flexslew_plant.arrays import Matrix

_AXES = ("x", "y", "z")


def joint_gains(
    allocation: Allocation | None, key: str, gains: tuple[float, ...], axes: Matrix
) -> tuple[float, ...]:
    """Return the g >= 0 for which the sum of g a a^T is nearest to the gains on the diagonal.

    Args:
        allocation: the law's allocation; None: the gains are those of the joints already.
        key: key of the gains, for an error.
        gains: about x, y, z, or one for all.
        axes: axes a, along which each joint reads the turn, shape (joints, 3).

    Raises:
        BadInput: if the gains are neither one nor three.
    """
    if allocation is None:
        return gains
    wanted = np.diag(per_joint(key, gains, _AXES))
    columns = np.array([np.outer(a, a).ravel() for a in axes]).T
    found, _ = nnls(columns, wanted.ravel())
    return tuple(found.tolist())
