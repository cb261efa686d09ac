"""Reaction wheels that their motors drive up to a speed, and no further."""

from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Indices, Vector, compiled_once
from flexslew_plant.hardware.motor_step import speed_limited_effort
from flexslew_plant.testbeds.model import Model


class WheelLimits(NamedTuple):
    """The constants of the wheels that have a largest speed."""

    efforts: Indices  # which effort drives each, (wheels,)
    rates: Indices  # which entry of the state is the speed of each, (wheels,)
    share: Vector  # inertia over a tick, (wheels,) [N m s/rad]
    fastest: Vector  # (wheels,) [rad/s]


class SpinLimits:
    """What motors of wheels near their largest speed give over a tick; see speed_limited_effort.

    Args:
        model: of the testbed.
        period: one tick [s].
    """

    def __init__(self, model: Model, period: float) -> None:
        wheels, fast = model.spins, np.isfinite(model.spins.fastest)
        share = wheels.inertia[fast] / period
        self._limits = WheelLimits(
            wheels.efforts[fast], wheels.rate[fast], share, wheels.fastest[fast]
        )
        zero_state = np.zeros(int(wheels.rate.max()) + 1)
        self.apply(np.zeros(model.joints), zero_state)  # compiled before tick 0

    def apply(self, effort: Vector, x: Vector) -> Vector:
        """Return the mean effort over the coming tick, shape (joints,) [N m or N].

        Args:
            effort: that the motors would give, shape (joints,) [N m or N].
            x: state at the tick, [q, v].
        """
        out = effort.copy()
        bound_wheels(self._limits, x, out)
        return out


@compiled_once("effort")
def bound_wheels(n: WheelLimits, x: Vector, effort: Vector) -> None:
    """Bound the efforts of wheels near their largest speed.

    Args:
        n: constants.
        x: state at the tick, [q, v].
        effort: that the motors would give, shape (joints,), changed [N m or N].
    """
    for k in range(n.efforts.size):
        i = n.efforts[k]
        effort[i] = speed_limited_effort(effort[i], x[n.rates[k]], n.share[k], n.fastest[k])


def spin_limits_of(model: Model, period: float) -> SpinLimits | None:
    """Return the limits of the wheels of a model; None: they have none."""
    return SpinLimits(model, period) if np.isfinite(model.spins.fastest).any() else None
