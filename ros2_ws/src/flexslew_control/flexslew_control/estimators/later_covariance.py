"""The covariance of a Kalman filter a long time later, without its ticks in between."""

import numpy as np

from flexslew_control.estimators.prediction import measurement_update
from flexslew_plant.arrays import Matrix, Vector


def later_covariance(
    f: Matrix, q: Matrix, c: Matrix, r: Vector, prior: Matrix, doublings: int
) -> tuple[Matrix, Matrix]:
    """Return the predicted covariance 2^doublings ticks later, and that after its measurement.

    One tick is P -> H + A^T P (I + G P)^-1 A with A = F^T, G = C^T R^-1 C and H = Q; two ticks
    are a map of the same form: structure-preserving doubling (E. K.-W. Chu, H.-Y. Fan, W.-W. Lin
    and C.-S. Wang, Structure-preserving algorithms for periodic discrete-time algebraic Riccati
    equations, 2004). Unlike the solution of the stationary equation it is defined where a mode
    without process noise lets the filter forget it by and by.

    Args:
        f: of the errors in a tick, shape (k, k).
        q: noise of a tick, shape (k, k).
        c: of the outputs, shape (l, k).
        r: variances of the sensors, shape (l,).
        prior: predicted covariance now, shape (k, k).
        doublings: of one tick.
    """
    eye = np.eye(len(f))
    a, g, h = f.T, c.T @ (c / r[:, None]), q
    for _ in range(doublings):
        inverse = np.linalg.inv(eye + g @ h)
        a, g, h = (
            a @ inverse @ a,
            g + _symmetric(a @ inverse @ g @ a.T),
            h + _symmetric(a.T @ h @ inverse @ a),
        )
    later = h + _symmetric(a.T @ prior @ np.linalg.solve(eye + g @ prior, a))
    return later, measurement_update(np.zeros(len(f)), later, np.zeros(len(c)), c, r)[1]


def _symmetric(p: Matrix) -> Matrix:
    return np.asarray(0.5 * (p + p.T), dtype=np.float64)
