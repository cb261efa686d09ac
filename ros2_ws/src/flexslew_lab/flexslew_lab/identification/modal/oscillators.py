"""Responses of single oscillators to efforts that are held over every tick, exact at the ticks."""

from dataclasses import dataclass

import numpy as np

from flexslew_control.analysis.loop import Complex
from flexslew_plant.arrays import Matrix, Vector, compiled_once


@dataclass(frozen=True)
class Oscillator:
    """q'' + 2 zeta w q' + w^2 q = u."""

    frequency: float  # w, undamped [rad/s]
    damping_ratio: float  # zeta [-]

    def transition(self, h: float | Vector) -> np.ndarray:
        """Return exp(A h) of x = (q, q'), shape (2, 2), or (ticks, 2, 2) of many lengths."""
        w, s = self.frequency, self.damping_ratio * self.frequency
        c, n = self._decay_terms(h)
        found = np.array([[c + s * n, n], [-w * w * n, c - s * n]])
        return np.moveaxis(np.asarray(found, dtype=np.float64), (0, 1), (-2, -1))

    def step_response(self, t: Matrix) -> tuple[Matrix, Matrix]:
        """Return w^2 q and w^2 q' at times t after a unit effort begins, from rest."""
        w, s = self.frequency, self.damping_ratio * self.frequency
        c, n = self._decay_terms(t)
        return 1.0 - c - s * n, w * w * n

    def _decay_terms(self, t: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return exp(-s t) cos(wd t) and exp(-s t) sin(wd t) / wd, also for an imaginary wd."""
        w, s = self.frequency, self.damping_ratio * self.frequency
        square = w * w - s * s
        if square > 0.0:
            wd, decay = np.sqrt(square), np.exp(-s * t)
            return decay * np.cos(wd * t), decay * (np.sin(wd * t) / wd)
        wd = np.sqrt(-square) if square < 0.0 else 1e-12  # overdamped
        slow = np.exp((wd - s) * t)
        return 0.5 * slow * (1.0 + np.exp(-2.0 * wd * t)), -0.5 * slow * np.expm1(
            -2.0 * wd * t
        ) / wd

    def responses(self, effort: Matrix, h: float | Vector, each: int = 1) -> tuple[Matrix, Matrix]:
        """Return q and q' at the ticks, forced by each input from rest, then from two starts.

        Forced ones are times w^2, and the starts are (1, 0) and (0, w): columns of one size. Each
        of shape (ticks + 1, inputs + 2); where `each` is more than 1, sums over as many ticks.

        Args:
            effort: held from tick to tick, shape (ticks, inputs).
            h: one tick, or the length of each, shape (ticks,) [s].
            each: ticks of a sum.
        """
        w = self.frequency
        step = np.ascontiguousarray(self.transition(h).reshape(-1, 2, 2))
        # (q, q') after a unit effort held over a tick: A^-1 (exp(A h) - 1) (0, 1)
        gain = np.column_stack((1.0 - step[:, 0, 0], step[:, 0, 1] * w * w))
        rows, inputs = (len(effort) + 1) // each, effort.shape[1]
        q, rate = np.zeros((2, rows, inputs + 2))
        _sweep(step, gain, w, np.ascontiguousarray(effort), each, q, rate)
        return q, rate


@compiled_once("q", "rate")
def _sweep(
    step: np.ndarray, gain: Matrix, w: float, effort: Matrix, each: int, q: Matrix, rate: Matrix
) -> None:
    """Write sums of what an oscillator does, column by column."""
    inputs = effort.shape[1]
    stride = 1 if step.shape[0] > 1 else 0  # transition of each tick, or one for all
    last = step.shape[0] - 1
    for column in range(inputs + 2):
        x = 1.0 if column == inputs else 0.0
        v = w if column == inputs + 1 else 0.0
        tick = 0
        for row in range(q.shape[0]):
            for _ in range(each):
                q[row, column] += x
                rate[row, column] += v
                k = min(stride * tick, last)  # behind the last tick nothing is read
                next_x = step[k, 0, 0] * x + step[k, 0, 1] * v
                v = step[k, 1, 0] * x + step[k, 1, 1] * v
                x = next_x
                if column < inputs and tick < effort.shape[0]:
                    x += gain[k, 0] * effort[tick, column]
                    v += gain[k, 1] * effort[tick, column]
                tick += 1


def oscillators_of(poles: Complex) -> tuple[Oscillator, ...]:
    """Return the oscillators of poles [rad/s], one of each pair, rising."""
    found = [Oscillator(float(abs(s)), float(-s.real / abs(s))) for s in poles if s.imag > 0.0]
    return tuple(sorted(found, key=lambda mode: mode.frequency))


def double_integral(effort: Matrix, h: float | Vector) -> tuple[Matrix, Matrix]:
    """Return position and rate of a unit inertia from rest, each (ticks + 1, inputs).

    Args:
        effort: held over every tick, shape (ticks, inputs).
        h: one tick, or the length of each, shape (ticks,) [s].
    """
    start = np.zeros((1, effort.shape[1]))
    h = np.reshape(h, (-1, 1))
    rate = np.vstack((start, np.cumsum(h * effort, axis=0)))
    position = np.cumsum(h * rate[:-1] + 0.5 * h * h * effort, axis=0)
    return np.vstack((start, position)), rate
