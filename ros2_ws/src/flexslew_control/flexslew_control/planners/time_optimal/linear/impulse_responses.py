"""Impulse responses of a slew's end conditions, c(tau) = C e^(A tau) B, on a grid of tau."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import expm

from flexslew_plant.arrays import Matrix, Vector

_ORDER = 4  # derivatives of c that are kept


@dataclass(frozen=True)
class ImpulseResponses:
    """c, its derivatives and its integral at tau = 0, h, 2 h, ..."""

    step: float  # h [s]
    values: Matrix  # c and its derivatives, shape (times, _ORDER, conditions)
    integral: Matrix  # of c from 0, shape (times, conditions)

    @cached_property
    def end(self) -> float:
        """Last tau [s]."""
        return self.step * (len(self.values) - 1)

    def integrated(self, tau: Vector) -> Matrix:
        """Return the integral of c from 0 to every tau, shape (taus, conditions)."""
        k = np.minimum((tau / self.step).astype(np.int64), len(self.values) - 1)
        ahead, total = tau - self.step * k, self.integral[k]
        share = np.ones(tau.size)
        for order in range(_ORDER):
            share = share * ahead / (order + 1.0)
            total = total + share[:, None] * self.values[k, order]
        return np.asarray(total)

    def at(self, tau: Vector, order: int = 0) -> Matrix:
        """Return c or a derivative of it at every tau, shape (taus, conditions)."""
        k = np.minimum((tau / self.step).astype(np.int64), len(self.values) - 1)
        ahead, total = tau - self.step * k, self.values[k, order]
        share = np.ones(tau.size)
        for more in range(order + 1, _ORDER):
            share = share * ahead / float(more - order)
            total = total + share[:, None] * self.values[k, more]
        return np.asarray(total)

    @np.errstate(divide="ignore", invalid="ignore")  # of a function that is nothing
    def zeros(self, mu: Vector, duration: float, touching: float = 0.0) -> Vector:
        """Return where mu . c changes its sign before tau = duration, rising [s].

        That can be twice in one interval, on either side of an extremum.

        Args:
            mu: multipliers, shape (conditions,).
            duration: T [s].
            touching: extrema so near to zero, relative to the largest, count as beyond it.
        """
        samples = self.values[: int(duration / self.step) + 2] @ mu  # mu . c and its derivatives
        f, h = samples[:-1], self.step
        signs, slopes = np.signbit(samples[:, 0]), np.signbit(samples[:, 1])
        once = np.flatnonzero(signs[1:] != signs[:-1])
        bent = np.flatnonzero((signs[1:] == signs[:-1]) & (slopes[1:] != slopes[:-1]))
        top = -h * f[bent, 1] / (samples[bent + 1, 1] - f[bent, 1])
        for _ in range(2):
            top = np.clip(top - _series(f[bent], top, 1) / _series(f[bent], top, 2), 0.0, h)
        near = touching * float(np.abs(samples[:, 0]).max())
        height = np.where(signs[bent], -1.0, 1.0) * _series(f[bent], top) - near
        bent, top, height = bent[height < 0.0], top[height < 0.0], height[height < 0.0]
        apart = np.sqrt(2.0 * np.abs(height / _series(f[bent], top, 2)))
        k = np.concatenate((once, bent, bent))
        straight = -h * f[once, 0] / (samples[once + 1, 0] - f[once, 0])
        ahead = np.concatenate((straight, top - apart, top + apart))
        for _ in range(4 if touching == 0.0 else 0):
            ahead = np.clip(ahead - _series(f[k], ahead) / _series(f[k], ahead, 1), 0.0, h)
        tau = np.sort(h * k + ahead)
        return np.asarray(tau[tau < duration])


def _series(f: Matrix, ahead: Vector, order: int = 0) -> Vector:
    """Return Taylor's series from f and its derivatives, or from those of a higher order."""
    total, share = f[:, order], np.ones(ahead.size)
    for more in range(order + 1, _ORDER):
        share = share * ahead / float(more - order)
        total = total + share * f[:, more]
    return np.asarray(total)


def sampled(
    a: Matrix, b: Vector, conditions: Matrix, step: float, longest: float
) -> ImpulseResponses:
    """Return the grid up to the longest tau."""
    size = b.size
    whole = np.zeros((2 * size, 2 * size))  # of e^(A tau) B and its integral
    whole[:size, :size], whole[size:, :size] = a, np.eye(size)
    ahead = expm(whole * step)
    states = np.concatenate((b, np.zeros(size)))[None]
    while (len(states) - 3) * step < longest:
        states = np.concatenate((states, states @ ahead.T))
        ahead = ahead @ ahead
    rows, orders = conditions, []
    for _ in range(_ORDER):
        orders.append(states[:, :size] @ rows.T)
        rows = rows @ a
    return ImpulseResponses(step, np.stack(orders, axis=1), states[:, size:] @ conditions.T)
