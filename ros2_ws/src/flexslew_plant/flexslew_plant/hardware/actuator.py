"""The motors: torque limit, quantisation, slew rate, lag; see friction and thrusters, too."""

from collections.abc import Sequence
from math import expm1
from typing import Annotated, TypeAlias

import numpy as np
from pydantic import Discriminator, Tag

from flexslew_plant.arrays import Vector
from flexslew_plant.hardware.thrusters import Thrusters
from flexslew_plant.settings import NonNegative, Positive, section

# one number for all motors, or one by name
PerMotor: TypeAlias = Annotated[
    Annotated[NonNegative, Tag("all")] | Annotated[dict[str, NonNegative], Tag("by name")],
    Discriminator(lambda given: "by name" if isinstance(given, dict) else "all"),
]


@section
class ActuatorSettings:
    """The `actuator` section, the same for every joint; all off by default."""

    lag: NonNegative = 0.0  # time constant of the torque [s]; each tick applies its exact mean
    # largest change of the torque [N m/s or N/s]; 0: no limit; each tick applies the exact
    # mean of its ramp
    slew_rate: NonNegative = 0.0
    # the torques that slew rate and lag start from are multiples of it [N m or N]; 0: none
    quantisation: NonNegative = 0.0
    # shortest pulse of thrusters, which are on or off: of every actuator, or by name of actuators
    # [s]; at most one tick; 0: it pushes continuously
    shortest_pulse: PerMotor = 0.0
    # coefficient of viscous friction of every motor, or by name of motors [N m s/rad or N s/m]
    viscous_friction: PerMotor = 0.0
    # dry friction of every motor, or by name of motors [N m or N]
    coulomb_friction: PerMotor = 0.0
    # friction grows as tanh(v / coulomb_speed) [rad/s or m/s]; a joint that sticks creeps more
    # slowly than this
    coulomb_speed: Positive = 1e-4


IDEAL = ActuatorSettings()
WHOLE = 1.0 + 1e-12  # 0.3 / 0.1 is less than 3: a quotient but for rounding


class Actuator:
    """One motor per joint, with the demand held over a tick.

    The torque u follows the demand, a multiple of the quantum, at the slew rate; with a lag the
    motor's torque is z' = (u - z) / lag. Both vary within the tick; what is applied is their exact
    mean, so that the impulse over every tick is that of the continuous response.

    Args:
        settings: the `actuator` section.
        limit: largest |effort|, shape (joints,) [N m or N].
        period: one tick [s].
        thrusters: those that are on or off; None: all push continuously.
        one_way: which ones give nothing but a positive effort.
    """

    def __init__(
        self,
        settings: ActuatorSettings,
        limit: Vector,
        period: float,
        thrusters: Thrusters | None = None,
        one_way: Sequence[int] = (),
    ) -> None:
        self._thrusters = thrusters
        self._settings, self._limit = settings, limit
        self._least = -limit
        self._least[list(one_way)] = 0.0
        self._bounds: list[tuple[float, float]] = list(
            zip(self._least.tolist(), limit.tolist(), strict=True)
        )
        self._period = period
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
        self._ramped: Vector = np.zeros(self._limit.size)  # u at the end of the last tick
        self._lagged: Vector = np.zeros(self._limit.size)  # z at the end of the last tick
        self.saturated = False
        if self._thrusters is not None:
            self._thrusters.reset()

    def place(self, torque: Vector) -> None:
        """Go on from this torque, as if the demand had been it for long.

        Args:
            torque: shape (joints,) [N m or N].
        """
        self._ramped = self._lagged = torque

    def apply(self, demand: Vector) -> Vector:
        """Return the mean effort over the coming tick, shape (joints,) [N m or N]."""
        s = self._settings
        self.saturated, effort = False, demand
        # a Python loop over one or two joints takes a third of the time of NumPy's calls
        for value, (least, largest) in zip(demand.tolist(), self._bounds, strict=True):
            if not least <= value <= largest:
                self.saturated, effort = True, np.clip(demand, self._least, self._limit)
                break
        if s.quantisation:
            most = np.floor(self._limit / s.quantisation * WHOLE)
            effort = s.quantisation * np.clip(np.round(effort / s.quantisation), -most, most)
            effort = np.clip(effort, self._least, self._limit)  # 3 times 0.1 is more than 0.3
        if self._thrusters is not None:
            effort = self._thrusters.apply(effort)
        if s.slew_rate:
            self.effort = self._followed(effort)
            return self.effort
        self.effort = effort
        if s.lag:
            gap = effort - self._lagged
            self.effort = self._lagged + self._mean_rise * gap
            self._lagged = self._lagged + self._rise * gap
        return self.effort

    def _followed(self, demand: Vector) -> Vector:
        """Return the mean over the tick of a torque that ramps to the demand, then holds it.

        On the ramp z = u - rate lag + (z_0 - u_0 + rate lag) e^(-t/lag); the integral of z is that
        of u less lag times the change of z.
        """
        s, dt, start = self._settings, self._period, self._ramped
        gap = demand - start
        rising = np.minimum(abs(gap) / s.slew_rate, dt)  # how long each ramps [s]
        rate = s.slew_rate * np.sign(gap)
        end = np.where(rising < dt, demand, start + rate * dt)
        mean = end - 0.5 * rising / dt * (end - start)
        self._ramped = end
        if not s.lag:
            return mean
        behind = rate * s.lag  # of the torque, once the ramp has gone on for long
        z = end - behind + (self._lagged - start + behind) * np.exp(-rising / s.lag)
        z = end + (z - end) * np.exp(-(dt - rising) / s.lag)
        mean = mean - s.lag / dt * (z - self._lagged)
        self._lagged = z
        return mean
