"""Thrusters that are on or off: pulses of a width, none shorter than the valves can."""

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput


class Thrusters:
    """Pulse-width modulation, once a tick.

    A thruster pushes with its limit F for a time w of the tick T; what is applied is the mean of
    the tick, F w / T, whose impulse is exact. With d the demand and c what was owed,
    w = |d T + c| / F, at most T; below the shortest pulse it is 0, and its impulse is owed: small
    demands come as rare pulses with the right mean. No more than one shortest pulse is ever owed.

    Args:
        shortest: pulse of each actuator; 0: it pushes continuously, shape (actuators,) [s].
        limit: F, shape (actuators,) [N m or N].
        period: one tick T [s].

    Attributes:
        least_impulse: of the shortest pulses, shape (actuators,) [N m s or N s].
    """

    def __init__(self, shortest: Vector, limit: Vector, period: float) -> None:
        self._pulsed = shortest > 0.0
        # a pulse of a tick may be longer by what is rounded, as 0.1 + 0.2 than 0.3
        self.least_impulse = np.minimum(shortest, period) * limit
        self._most, self._period = limit * period, period
        self.reset()

    def reset(self) -> None:
        """Owe nothing."""
        self._owed: Vector = np.zeros(self.least_impulse.size)

    def apply(self, demand: Vector) -> Vector:
        """Return the mean effort of the coming tick, shape (actuators,) [N m or N]."""
        asked = demand * self._period + self._owed
        impulse = np.clip(asked, -self._most, self._most)
        impulse = np.where(np.abs(impulse) < self.least_impulse, 0.0, impulse)
        self._owed = np.where(
            self._pulsed, np.clip(asked - impulse, -self.least_impulse, self.least_impulse), 0.0
        )
        effort: Vector = np.where(self._pulsed, impulse / self._period, demand)
        return effort


def thrusters_of(
    shortest: float | dict[str, float], names: tuple[str, ...], limit: Vector, period: float
) -> Thrusters | None:
    """Return the thrusters among the actuators; None: all push continuously.

    Args:
        shortest: pulse of all, or by name of an actuator [s].
        names: of the actuators.
        limit: of their efforts, shape (actuators,).
        period: one tick [s].

    Raises:
        BadInput: a name is no actuator, or a pulse is longer than a tick.
    """
    by_name = shortest if isinstance(shortest, dict) else dict.fromkeys(names, shortest)
    unknown = sorted(set(by_name) - set(names))
    if unknown:
        words = f"names of actuators: {', '.join(names)}"
        raise BadInput(words, "actuator", "shortest_pulse", unknown[0])
    widths = np.array([by_name.get(name, 0.0) for name in names])
    if (widths > period * (1.0 + 1e-9)).any():
        words = f"at most one tick, {period:g} s"
        raise BadInput(words, "actuator", "shortest_pulse", float(widths.max()))
    return Thrusters(widths, limit, period) if widths.any() else None
