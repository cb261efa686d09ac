"""Faults of the sensors."""

from typing import Literal, Protocol, TypeAlias

import numpy as np

from flexslew_plant.arrays import Vector, called
from flexslew_plant.faults.effects import FaultEntry, Names, Seed, Subject
from flexslew_plant.faults.steps import FaultAction, Where, entries
from flexslew_plant.settings import Probability, section

ChannelName: TypeAlias = Literal[
    "joint_position", "joint_velocity", "tip_deflection", "root_curvature"
]


class _OnChannel(Protocol):
    @property
    def channel(self) -> ChannelName:
        """Which kind of sensor."""

    @property
    def of(self) -> str | None:
        """Joint or appendage; None: every one of the channel."""


def _subject(fault: _OnChannel, names: Names) -> Subject | None:
    return None if fault.of is None else Subject("of", fault.of, names.of(fault.channel))


def _action(
    fault: _OnChannel, names: Names, numbers: tuple[float, ...] = (), memory: int = 0
) -> FaultAction:
    """Return the action on the chosen entries of a channel."""
    selected = entries(names.of(fault.channel), fault.of)
    return FaultAction(Where.READING, *selected, numbers, memory, fault.channel)


@called
def zero_reading(numbers: Vector, memory: Vector, since: int, value: float) -> float:
    """Return the reading of a sensor that drops out: 0."""
    return 0.0


@called
def bias_reading(numbers: Vector, memory: Vector, since: int, value: float) -> float:
    """Return a reading with a bias: y + b.

    Args:
        numbers: b, in the unit of the channel.
        memory: none.
        since: ticks since the fault began.
        value: y, in the unit of the channel.
    """
    return float(value + numbers[0])


@called
def freeze_reading(numbers: Vector, memory: Vector, since: int, value: float) -> float:
    """Return the first reading of the fault, y[k0], at all of its ticks.

    Args:
        numbers: none.
        memory: y[k0], in the unit of the channel.
        since: ticks since the fault began, k - k0.
        value: y[k], in the unit of the channel.
    """
    if since == 0:
        memory[0] = value
    return float(memory[0])


@called
def nan_reading(numbers: Vector, memory: Vector, since: int, value: float) -> float:
    """Return the reading of a sensor that gives no number: NaN."""
    return float(np.nan)


@section
class SensorDropout:
    """Sensors read zero, each tick with a probability."""

    kind: Literal["sensor_dropout"] = "sensor_dropout"
    channel: ChannelName  # which sensors
    of: str | None = None  # joint or appendage; null: every one of the channel
    probability: Probability = 1.0  # of each tick [-]
    seed: Seed = 0  # in addition to the trial's

    def subject(self, names: Names) -> Subject | None:
        """Return the joint or appendage."""
        return _subject(self, names)

    def action(self, names: Names) -> FaultAction:
        """Return the action on the readings."""
        return _action(self, names)._replace(probability=self.probability)


@section
class SensorBias:
    """Sensor readings have a constant bias."""

    kind: Literal["sensor_bias"] = "sensor_bias"
    channel: ChannelName  # which sensors
    of: str | None = None  # joint or appendage; null: every one of the channel
    bias: float  # in the unit of what the channel reads [rad or m, rad/s or m/s, 1/m]

    def subject(self, names: Names) -> Subject | None:
        """Return the joint or appendage."""
        return _subject(self, names)

    def action(self, names: Names) -> FaultAction:
        """Return the action on the readings."""
        return _action(self, names, (self.bias,))


@section
class SensorFreeze:
    """Sensors repeat what they read when the fault set in."""

    kind: Literal["sensor_freeze"] = "sensor_freeze"
    channel: ChannelName  # which sensors
    of: str | None = None  # joint or appendage; null: every one of the channel

    def subject(self, names: Names) -> Subject | None:
        """Return the joint or appendage."""
        return _subject(self, names)

    def action(self, names: Names) -> FaultAction:
        """Return the action on the readings."""
        return _action(self, names, memory=1)


@section
class SensorNan:
    """Sensors read NaN."""

    kind: Literal["sensor_nan"] = "sensor_nan"
    channel: ChannelName  # which sensors
    of: str | None = None  # joint or appendage; null: every one of the channel

    def subject(self, names: Names) -> Subject | None:
        """Return the joint or appendage."""
        return _subject(self, names)

    def action(self, names: Names) -> FaultAction:
        """Return the action on the readings."""
        return _action(self, names)


DROPOUT = FaultEntry(SensorDropout, step=zero_reading)
BIAS = FaultEntry(SensorBias, {"bias": 0.1}, bias_reading)
FREEZE = FaultEntry(SensorFreeze, step=freeze_reading)
NAN = FaultEntry(SensorNan, step=nan_reading)
