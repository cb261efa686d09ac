"""Impulse responses of a slew's end conditions, c(tau) = C e^(A tau) B, on a grid of tau."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector

_ORDER = 4  # derivatives of c that are kept


@dataclass(frozen=True)
class ImpulseResponses:
    """c, its derivatives and its integral at tau = 0, h, 2 h, ..."""

    step: float  # h [s]
    values: Matrix  # c and its derivatives, shape (times, _ORDER, conditions)
    integral: Matrix  # of c from 0, shape (times, conditions)

    def integral_at(self, tau: Vector) -> Matrix:
        """Return the integral of c from 0 to every tau, shape (taus, conditions)."""
        k, shift = self._interval(tau)
        total, share = self.integral[k], np.ones_like(shift)
        for order in range(_ORDER):
            share = share * shift / (order + 1.0)
            total = total + share * self.values[k, order]
        return np.asarray(total)

    def at(self, tau: Vector, order: int = 0) -> Matrix:
        """Return c or a derivative of it at every tau, shape (taus, conditions)."""
        k, shift = self._interval(tau)
        return _series(self.values[k], shift, order)

    def _interval(self, tau: Vector) -> tuple[Indices, Matrix]:
        """Return the interval of every tau, shape (taus,), and tau after its begin, (taus, 1)."""
        k = np.minimum((tau / self.step).astype(np.int64), len(self.values) - 1)
        return k, (tau - self.step * k)[:, None]

    @np.errstate(divide="ignore", invalid="ignore")  # of a function that is nothing
    def zeros(self, mu: Vector, duration: float) -> Vector:
        """Return where mu . c changes its sign before tau = duration, rising [s].

        That can be twice in one interval, on either side of an extremum.

        Args:
            mu: multipliers, shape (conditions,).
            duration: T [s].
        """
        samples = self.values[: int(duration / self.step) + 2] @ mu  # mu . c and its derivatives
        f, h = samples[:-1], self.step
        signs, slopes = np.signbit(samples[:, 0]), np.signbit(samples[:, 1])
        once = np.flatnonzero(signs[1:] != signs[:-1])
        extrema = np.flatnonzero((signs[1:] == signs[:-1]) & (slopes[1:] != slopes[:-1]))
        top = -h * f[extrema, 1] / (samples[extrema + 1, 1] - f[extrema, 1])
        for _ in range(2):
            top = np.clip(top - _series(f[extrema], top, 1) / _series(f[extrema], top, 2), 0.0, h)
        height = np.where(signs[extrema], -1.0, 1.0) * _series(f[extrema], top)
        extrema, top, height = extrema[height < 0.0], top[height < 0.0], height[height < 0.0]
        half_width = np.sqrt(2.0 * np.abs(height / _series(f[extrema], top, 2)))
        k = np.concatenate((once, extrema, extrema))
        linear_root = -h * f[once, 0] / (samples[once + 1, 0] - f[once, 0])
        shift = np.concatenate((linear_root, top - half_width, top + half_width))
        for _ in range(4):
            shift = np.clip(shift - _series(f[k], shift) / _series(f[k], shift, 1), 0.0, h)
        tau = np.sort(h * k + shift)
        return np.asarray(tau[tau < duration])


def _series(f: Tensor, shift: Matrix, order: int = 0) -> Matrix:
    """Return Taylor's series from f and its derivatives, or from those of a higher order.

    Args:
        f: of every place, shape (places, _ORDER, ...).
        shift: from there, shape (places, ...) [s].
        order: of the derivative.
    """
    total, share = f[:, order], np.ones_like(shift)
    for more in range(order + 1, _ORDER):
        share = share * shift / float(more - order)
        total = total + share * f[:, more]
    return np.asarray(total)


def sampled(
    a: Matrix, b: Vector, conditions: Matrix, step: float, max_time: float
) -> ImpulseResponses:
    """Return the grid up to the longest tau."""
    size = b.size
    whole = np.zeros((2 * size, 2 * size))  # of e^(A tau) B and its integral
    whole[:size, :size], whole[size:, :size] = a, np.eye(size)
    shift = expm(whole * step)
    states = np.concatenate((b, np.zeros(size)))[None]
    while (len(states) - 3) * step < max_time:
        states = np.concatenate((states, states @ shift.T))
        shift = shift @ shift
    rows, orders = conditions, []
    for _ in range(_ORDER):
        orders.append(states[:, :size] @ rows.T)
        rows = rows @ a
    return ImpulseResponses(step, np.stack(orders, axis=1), states[:, size:] @ conditions.T)
