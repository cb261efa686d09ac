"""Responses of single oscillators to efforts that are held over every tick, exact at the ticks."""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from flexslew_plant.arrays import Matrix, Vector


@dataclass(frozen=True)
class Oscillator:
    """q'' + 2 zeta w q' + w^2 q = u."""

    frequency: float  # w, undamped [rad/s]
    damping_ratio: float  # zeta [-]

    def transition(self, h: float) -> Matrix:
        """Return exp(A h) of x = (q, q'), shape (2, 2)."""
        w, s = self.frequency, self.damping_ratio * self.frequency
        square = w * w - s * s
        if square > 0.0:
            wd = np.sqrt(square)
            c, n = np.cos(wd * h), np.sin(wd * h) / wd
        else:  # overdamped
            wd = np.sqrt(-square) if square < 0.0 else 1e-12
            c, n = np.cosh(wd * h), np.sinh(wd * h) / wd
        return np.array(
            np.exp(-s * h) * np.array([[c + s * n, n], [-w * w * n, c - s * n]]), dtype=np.float64
        )

    def forced(self, effort: Matrix, h: float) -> tuple[Matrix, Matrix]:
        """Return q and q' at the ticks from rest, each of shape (ticks + 1, inputs).

        Args:
            effort: held from tick to tick, shape (ticks, inputs).
            h: one tick [s].
        """
        step = self.transition(h)
        # (q, q') after a unit effort held over a tick: A^-1 (exp(A h) - 1) (0, 1)
        w = self.frequency
        gain = np.array([(1.0 - step[0, 0]) / w**2, step[0, 1]])
        trace, det = step[0, 0] + step[1, 1], step[0, 0] * step[1, 1] - step[0, 1] * step[1, 0]
        poles = np.array([1.0, -trace, det])
        cross = np.array(  # (z - A)^-1 b by its adjugate
            [
                -step[1, 1] * gain[0] + step[0, 1] * gain[1],
                step[1, 0] * gain[0] - step[0, 0] * gain[1],
            ]
        )
        held = np.vstack((effort, np.zeros(effort.shape[1])))
        q, rate = (lfilter(np.array([0.0, gain[k], cross[k]]), poles, held, axis=0) for k in (0, 1))
        return q, rate

    def free(self, ticks: int, h: float) -> tuple[Matrix, Matrix]:
        """Return q and q' at the ticks from (1, 0) and from (0, 1), each (ticks + 1, 2)."""
        t = h * np.arange(ticks + 1)
        w, s = self.frequency, self.damping_ratio * self.frequency
        wd = np.sqrt(max(w * w - s * s, 1e-24))
        decay = np.exp(-s * t)
        c, n = decay * np.cos(wd * t), decay * np.sin(wd * t) / wd
        q = np.column_stack((c + s * n, n))
        rate = np.column_stack((-w * w * n, c - s * n))
        return q, rate


def double_integral(effort: Matrix, h: float) -> tuple[Matrix, Matrix]:
    """Return position and rate of a unit inertia from rest, each (ticks + 1, inputs)."""
    start = np.zeros((1, effort.shape[1]))
    rate = np.vstack((start, h * np.cumsum(effort, axis=0)))
    moved = np.cumsum(h * rate[:-1] + 0.5 * h * h * effort, axis=0)
    return np.vstack((start, moved)), rate


def times(ticks: int, h: float) -> Vector:
    """Return the ticks' times from the first, (ticks + 1,) [s]."""
    return np.asarray(h * np.arange(ticks + 1, dtype=np.float64))
