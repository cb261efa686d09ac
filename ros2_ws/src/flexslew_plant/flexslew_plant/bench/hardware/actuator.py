"""The motors: torque limit, slew rate, quantisation and first-order lag; see friction, too."""

from math import expm1

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.settings import NonNegative, Positive, section


@section
class ActuatorSettings:
    """The `actuator` section, the same for every joint; all off by default."""

    lag: NonNegative = 0.0  # time constant of the torque [s]
    slew_rate: NonNegative = 0.0  # largest change of the torque [N m/s]; 0: no limit
    quantisation: NonNegative = 0.0  # torques are multiples of it [N m]; 0: none
    viscous_friction: NonNegative = 0.0  # [N m s/rad]
    coulomb_friction: NonNegative = 0.0  # [N m]
    coulomb_speed: Positive = 1e-4  # friction grows as tanh(v / coulomb_speed) [rad/s]


class Actuator:
    """One motor per joint, with the demand held over a tick.

    With a lag z' = (demand - z) / lag the torque varies within the tick; what is applied is its
    exact mean, so that the impulse over every tick is that of the continuous response.

    Args:
        settings: the `actuator` section.
        limit: largest |effort|, shape (joints,) [N m or N].
        period: one tick [s].
    """

    def __init__(self, settings: ActuatorSettings, limit: Vector, period: float) -> None:
        self._settings, self._limit = settings, limit
        self._bounds: list[float] = limit.tolist()
        self._largest_change = settings.slew_rate * period
        ratio = period / settings.lag if settings.lag else 0.0
        self._rise = -expm1(-ratio)  # of z over a tick, in parts of demand - z
        self._mean_rise = 1.0 - self._rise / ratio if ratio else 1.0
        self.reset()

    @property
    def rises(self) -> tuple[float, float]:
        """Parts of a step that the torque has gone at the end of a tick, and in its mean [-]."""
        return (self._rise, self._mean_rise) if self._settings.lag else (1.0, 1.0)

    def reset(self) -> None:
        """Forget the past: no torque."""
        self.effort: Vector = np.zeros(self._limit.size)  # really applied [N m or N]
        self._demand: Vector = np.zeros(self._limit.size)
        self._lagged: Vector = np.zeros(self._limit.size)  # z at the end of the last tick
        self.saturated = False

    def apply(self, demand: Vector) -> Vector:
        """Return the mean effort over the coming tick, shape (joints,) [N m or N]."""
        s = self._settings
        # a Python loop over one or two joints takes a third of the time of NumPy's calls
        within = zip(demand.tolist(), self._bounds, strict=True)
        self.saturated = not all(-most <= value <= most for value, most in within)
        effort = np.clip(demand, -self._limit, self._limit) if self.saturated else demand
        if self._largest_change:
            change = np.clip(effort - self._demand, -self._largest_change, self._largest_change)
            effort = self._demand + change
        self._demand = effort  # before quantisation: a ramp slower than a quantum a tick goes on
        if s.quantisation:
            most = np.floor(self._limit / s.quantisation)
            effort = s.quantisation * np.clip(np.round(effort / s.quantisation), -most, most)
        self.effort = effort
        if s.lag:
            gap = effort - self._lagged
            self.effort = self._lagged + self._mean_rise * gap
            self._lagged = self._lagged + self._rise * gap
        return self.effort
