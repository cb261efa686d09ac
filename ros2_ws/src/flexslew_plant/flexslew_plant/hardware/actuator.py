"""The motors: torque limit, quantisation, slew rate, lag, pulses; see friction, too."""

from collections.abc import Sequence
from math import expm1
from operator import le
from typing import Annotated, TypeAlias

import numpy as np
from pydantic import Discriminator, Tag

from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.hardware.motor_step import SLEW_ROW, TORQUE_ROW, MotorNumbers, drive_motors
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


def motor_numbers(
    settings: ActuatorSettings,
    limit: Vector,
    period: float,
    impulse: Vector | None = None,
    one_way: Sequence[int] = (),
) -> MotorNumbers:
    """Return the constants of all motors.

    Args:
        settings: the `actuator` section.
        limit: largest |effort|, shape (joints,) [N m or N].
        period: one tick [s].
        impulse: of the shortest pulse of each thruster that is on or off, 0 of the others, shape
            (joints,) [N m s or N s]; None: all push continuously.
        one_way: which ones give nothing but a positive effort.
    """
    least = -limit
    least[list(one_way)] = 0.0
    s, ratio = settings, period / settings.lag if settings.lag else 0.0
    rise = -expm1(-ratio) if ratio else 1.0
    mean_rise = 1.0 - rise / ratio if ratio else 1.0
    minimum_pulse = np.zeros(limit.size) if impulse is None else impulse
    motors = s.quantisation, s.slew_rate, s.lag, rise, mean_rise, period
    return MotorNumbers(np.array(limit, dtype=float), least, minimum_pulse, *motors)


class Actuator:
    """One motor per joint, with the demand held over a tick; see motor_step.drive_motors.

    Its arguments are those of motor_numbers.
    """

    def __init__(
        self,
        settings: ActuatorSettings,
        limit: Vector,
        period: float,
        impulse: Vector | None = None,
        one_way: Sequence[int] = (),
    ) -> None:
        self._numbers = n = motor_numbers(settings, limit, period, impulse, one_way)
        self._bounds = n.least.tolist(), n.limit.tolist()
        self._ideal = not (n.quantum or n.slew_rate or n.lag or n.impulse.any())
        self.reset()
        if not self._ideal:
            self.apply(np.zeros(limit.size))  # compiled before tick 0

    def reset(self) -> None:
        """Forget the past: no torque."""
        self.effort: Vector = np.zeros(self._numbers.limit.size)  # really applied [N m or N]
        self._memory = np.zeros((3, self.effort.size))
        self.saturated = False

    def place(self, torque: Vector) -> None:
        """Go on from this torque, as if the demand had been it for long.

        Args:
            torque: shape (joints,) [N m or N].
        """
        self._memory[SLEW_ROW] = self._memory[TORQUE_ROW] = torque

    def apply(self, demand: Vector) -> Vector:
        """Return the mean effort over the coming tick, shape (joints,) [N m or N]."""
        if not self._ideal:
            self.effort = np.empty(demand.size)
            self.saturated = drive_motors(self._numbers, demand, self._memory, self.effort)
            return self.effort
        # Python's own numbers take a third of the time of NumPy's calls for one or two joints
        (least, largest), values = self._bounds, demand.tolist()
        self.saturated = not (all(map(le, least, values)) and all(map(le, values, largest)))
        self.effort = demand
        if self.saturated:
            self.effort = np.clip(demand, self._numbers.least, self._numbers.limit)
        return self.effort


def minimum_impulse(
    settings: ActuatorSettings, names: tuple[str, ...], limit: Vector, period: float
) -> Vector:
    """Return the impulse of each actuator's shortest pulse, shape (actuators,) [N m s or N s].

    It is 0 where an actuator pushes continuously.

    Args:
        settings: the `actuator` section.
        names: of the actuators.
        limit: of their efforts, shape (actuators,).
        period: one tick [s].

    Raises:
        BadInput: a name is no actuator, or a pulse is longer than a tick.
    """
    minimum_pulse = settings.shortest_pulse
    by_name = (
        minimum_pulse if isinstance(minimum_pulse, dict) else dict.fromkeys(names, minimum_pulse)
    )
    unknown = sorted(set(by_name) - set(names))
    if unknown:
        words = f"names of actuators: {', '.join(names)}"
        raise BadInput(words, "actuator", "shortest_pulse", unknown[0])
    widths = np.array([by_name.get(name, 0.0) for name in names])
    if (widths > period * (1.0 + 1e-9)).any():
        words = f"at most one tick, {period:g} s"
        raise BadInput(words, "actuator", "shortest_pulse", float(widths.max()))
    # a pulse of a tick may be longer by what is rounded, as 0.1 + 0.2 than 0.3
    impulse: Vector = np.minimum(widths, period) * limit
    return impulse
