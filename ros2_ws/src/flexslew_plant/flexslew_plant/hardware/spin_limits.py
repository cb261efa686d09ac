"""Reaction wheels that their motors drive up to a speed, and no further."""

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds.model import Model


class SpinLimits:
    """What motors of wheels near their largest speed give over a tick.

    An effort u on the platform takes the speed W of a wheel with I W' = -u, so the impulse that
    takes it to its limit bounds the mean over a tick dt:
        -I (W_max - W) / dt <= u <= I (W_max + W) / dt.
    A wheel that is beyond gets nothing that way: the platform's turn, too, changes its speed.

    Args:
        model: of the testbed.
        period: one tick [s].
    """

    def __init__(self, model: Model, period: float) -> None:
        spins = model.spins
        limited = np.isfinite(spins.fastest)
        self._efforts, self._rates = spins.efforts[limited], spins.rate[limited]
        self._share, self._fastest = spins.inertia[limited] / period, spins.fastest[limited]

    def apply(self, effort: Vector, x: Vector) -> Vector:
        """Return the mean effort over the coming tick, shape (joints,) [N m or N].

        Args:
            effort: that the motors would give, shape (joints,) [N m or N].
            x: state at the tick, [q, v].
        """
        speed, asked = x[self._rates], effort[self._efforts]
        most = np.maximum(self._share * (self._fastest + speed), 0.0)
        least = np.minimum(self._share * (speed - self._fastest), 0.0)
        given = np.clip(asked, least, most)
        if (given == asked).all():
            return effort
        held = effort.copy()
        held[self._efforts] = given
        return held


def spin_limits_of(model: Model, period: float) -> SpinLimits | None:
    """Return the limits of the wheels of a model; None: they have none."""
    return SpinLimits(model, period) if np.isfinite(model.spins.fastest).any() else None
