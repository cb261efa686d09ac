"""The linear quadratic regulator for efforts that are held over a tick."""

from typing import Literal, TypeAlias

import numpy as np
from scipy.linalg import LinAlgError, expm

from flexslew_control.controllers.lqr import regulator
from flexslew_control.linear.riccati import discrete_riccati
from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput

Design: TypeAlias = Literal["continuous", "sampled"]
_HALVINGS = 14  # of a tick in the integral of the cost


def sampled_cost(
    a: Matrix, b: Matrix, q: Matrix, r: Matrix, period: float
) -> tuple[Matrix, Matrix, Matrix]:
    """Return F, G of x+ = F x + G u and the integral of the cost of (x, u) over a tick.

    Args:
        a: of x' = A x + B u, shape (k, k).
        b: shape (k, m).
        q: weight on x, shape (k, k).
        r: weight on u, shape (m, m).
        period: one tick [s].
    """
    k, m = b.shape
    augmented, weight = np.zeros((k + m, k + m)), np.zeros((k + m, k + m))
    augmented[:k, :k], augmented[:k, k:] = a, b
    weight[:k, :k], weight[k:, k:] = q, r
    step = period / 2**_HALVINGS
    transition = expm(augmented * step)
    cost = 0.5 * step * (weight + transition.T @ weight @ transition)
    for _ in range(_HALVINGS):  # twice the interval each time
        cost = cost + transition.T @ cost @ transition
        transition = transition @ transition
    return transition[:k, :k], transition[:k, k:], cost


def sampled_gain(
    a: Matrix, b: Matrix, q: Matrix, r: Matrix, period: float, design: Design
) -> Matrix:
    """Return K of u = -K x, shape (m, k), that is stable when u is held over a tick.

    Args:
        a: of x' = A x + B u, shape (k, k).
        b: shape (k, m).
        q: weight on x, shape (k, k).
        r: weight on u, shape (m, m).
        period: one tick [s].
        design: continuous: the gains of an effort that is not held; sampled: the best for one
            that is.

    Raises:
        BadInput: there is no regulator, or the continuous one is not stable at this period.
    """
    f, g, cost = sampled_cost(a, b, q, r, period)
    k = len(a)
    if design == "sampled":
        try:
            p = discrete_riccati(f, g, cost[:k, :k], cost[k:, k:], s=cost[:k, k:])
        except LinAlgError as error:
            raise BadInput(f"no optimal regulator: {error}; weigh every mode") from None
        gain = np.linalg.solve(cost[k:, k:] + g.T @ p @ g, g.T @ p @ f + cost[k:, :k])
        return np.asarray(gain)
    gain, _ = regulator(a, b, q, r)
    radius = float(abs(np.linalg.eigvals(f - g @ gain)).max())
    if radius > 1.0:
        largest_pole = float(abs(np.linalg.eigvals(a - b @ gain)).max())
        raise BadInput(
            f"design: continuous is not stable with efforts held for {period:g} s: its fastest "
            f"pole is {largest_pole:.5g} 1/s; take sampled, or a period below "
            f"{1.0 / largest_pole:.2g} s"
        )
    return gain
