"""Faults of the sensors."""

from collections.abc import Callable
from typing import Literal, Protocol, TypeAlias

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.faults.effects import Effect, FaultContext, FaultEntry, Names, Seed, Subject
from flexslew_plant.hardware.sensors import Readings
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


def _reading(fault: _OnChannel, names: Names, wrong: Callable[[Vector], Vector]) -> Effect:
    """Return the effect that replaces the chosen entries of a channel by those of `wrong`."""
    chosen = slice(None)
    if fault.of is not None:
        k = names.of(fault.channel).index(fault.of)
        chosen = slice(k, k + 1)

    def read(readings: Readings) -> Readings:
        reading: Vector = getattr(readings, fault.channel)
        changed = reading.copy()
        changed[chosen] = wrong(reading)[chosen]
        return readings._replace(**{fault.channel: changed})

    return Effect(read=read)


@section
class SensorDropout:
    """Sensors read zero, each tick with a probability."""

    kind: Literal["sensor_dropout"] = "sensor_dropout"
    channel: ChannelName  # which sensors
    of: str | None = None  # joint or appendage; null: every one of the channel
    probability: Probability = 1.0  # of each tick
    seed: Seed = 0  # beside the trial's

    def subject(self, names: Names) -> Subject | None:
        """Return the joint or appendage."""
        return _subject(self, names)

    def begin(self, context: FaultContext) -> Effect:
        """Return the effect on the readings."""

        def wrong(reading: Vector) -> Vector:
            return np.zeros_like(reading) if context.happens(self.probability) else reading

        return _reading(self, context.names, wrong)


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

    def begin(self, context: FaultContext) -> Effect:
        """Return the effect on the readings."""
        return _reading(self, context.names, lambda reading: reading + self.bias)


@section
class SensorFreeze:
    """Sensors repeat what they read when the fault set in."""

    kind: Literal["sensor_freeze"] = "sensor_freeze"
    channel: ChannelName  # which sensors
    of: str | None = None  # joint or appendage; null: every one of the channel

    def subject(self, names: Names) -> Subject | None:
        """Return the joint or appendage."""
        return _subject(self, names)

    def begin(self, context: FaultContext) -> Effect:
        """Return the effect on the readings."""
        first: list[Vector] = []

        def wrong(reading: Vector) -> Vector:
            if not first:
                first.append(reading)
            return first[0]

        return _reading(self, context.names, wrong)


@section
class SensorNan:
    """Sensors read NaN."""

    kind: Literal["sensor_nan"] = "sensor_nan"
    channel: ChannelName  # which sensors
    of: str | None = None  # joint or appendage; null: every one of the channel

    def subject(self, names: Names) -> Subject | None:
        """Return the joint or appendage."""
        return _subject(self, names)

    def begin(self, context: FaultContext) -> Effect:
        """Return the effect on the readings."""
        return _reading(self, context.names, lambda reading: np.full_like(reading, np.nan))


DROPOUT = FaultEntry(SensorDropout)
BIAS = FaultEntry(SensorBias, {"bias": 0.1})
FREEZE = FaultEntry(SensorFreeze)
NAN = FaultEntry(SensorNan)
