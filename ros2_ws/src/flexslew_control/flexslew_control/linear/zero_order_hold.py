"""The zero-order hold of every design and filter."""

import numpy as np
from scipy.linalg import expm

from flexslew_plant.arrays import Matrix


def zero_order_hold(a: Matrix, b: Matrix, period: float) -> tuple[Matrix, Matrix]:
    """Return F and G of x+ = F x + G u, exact for x' = A x + B u with u held over a period.

    exp([[A, B], [0, 0]] h) = [[F, G], [0, I]], as `control.c2d` and `scipy.signal.cont2discrete`
    compute it, too; neither is called, as a node that flies would wait for them: python-control
    takes more than a second to load, scipy.signal a third.

    Args:
        a: shape (k, k).
        b: shape (k, m).
        period: h [s].

    Returns:
        of shapes (k, k) and (k, m).
    """
    k, m = b.shape
    block = np.zeros((k + m, k + m))
    block[:k, :k], block[:k, k:] = a, b
    step = expm(block * period)
    return step[:k, :k], step[:k, k:]
