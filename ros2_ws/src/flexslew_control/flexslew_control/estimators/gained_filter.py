"""A Kalman filter with gains known beforehand: no measurement changes its covariance."""

from typing import NamedTuple

import numpy as np

from flexslew_control.estimators.kalman import KalmanFilter
from flexslew_control.estimators.prediction import (
    error_transition,
    first_gain,
    gain_of,
    innovation_variance,
)
from flexslew_plant.arrays import Matrix, Tensor, Vector
from flexslew_plant.testbeds.model import Model


class GainFilter(NamedTuple):
    """A filter of k states and l outputs.

    x(0) = S y(0), and then x- = o + F (x - o) + G u, e = y - C x-, x = x- + K(tick) e.
    """

    start: Matrix  # S, (k, l)
    state: Matrix  # F, (k, k)
    effort: Matrix  # G, (k, joints)
    output: Matrix  # C, (l, k)
    origin: Vector  # o, (k,)
    gains: Tensor  # K, (ticks, k, l)
    variance: Matrix  # of e as it states it, (ticks, l)


def gain_filter(estimator: KalmanFilter, ticks: int) -> GainFilter | None:
    """Return a filter as matrices of each tick; None where its predictions are not linear.

    Args:
        estimator: the filter.
        ticks: how many, the first of a reset.
    """
    linear, model = estimator.settings.prediction == "linear", estimator.model
    if not linear and isinstance(model, Model):
        return None
    constants, period = estimator.matrices, estimator.period
    k, m, n = len(constants.origin), model.joints, model.coordinates
    d = k - 2 * n
    f, g, origin = constants.f, constants.g, constants.origin
    if not linear:
        f, g, origin = np.eye(k), np.zeros((k, m)), np.zeros(k)
        states, efforts = np.eye(k - d), np.eye(m)
        f[: k - d, : k - d] = np.array(
            [model.advance(x, 0.0 * efforts[0], period) for x in states]
        ).T
        g[: k - d] = np.array([model.advance(0.0 * states[0], u, period) for u in efforts]).T
        f[: k - d, k - d :] = g[: k - d, :d]
    dx, du = model.jacobian(np.zeros(k - d), np.zeros(m))
    transition = f if linear else error_transition(dx, du[:, :d], period)
    gains, p = np.zeros((ticks, k, len(constants.c))), constants.first
    variance = np.empty((ticks, len(constants.c)))
    variance[0] = innovation_variance(p, constants.c, constants.r)
    for tick in range(1, ticks):
        prior = transition @ p @ transition.T + constants.q
        gains[tick], after = gain_of(prior, constants.c, constants.r)
        variance[tick] = innovation_variance(prior, constants.c, constants.r)
        if np.array_equal(after, p):  # it is stationary
            gains[tick + 1 :], variance[tick + 1 :] = gains[tick], variance[tick]
            break
        p = after
    start = first_gain(len(constants.c), n, k)
    return GainFilter(start, f, g, constants.c, origin, gains, variance)
