"""Encoders, rate sensors, tip and root sensors: the truth with bias, noise and quantisation."""

from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.settings import NonNegative, section


@section
class Channel:
    """Errors of one kind of sensor, in its own unit; all off by default."""

    noise: NonNegative = 0.0  # standard deviation of white noise, each tick
    bias: float = 0.0  # added to every reading
    quantisation: NonNegative = 0.0  # readings are multiples of it; 0: none


@section
class SensorSettings:
    """The `sensors` section."""

    joint_position: Channel = Channel()  # [rad or m]
    joint_velocity: Channel = Channel()  # [rad/s or m/s]
    tip_deflection: Channel = Channel()  # [m]
    root_curvature: Channel = Channel()  # [1/m]


class Readings(NamedTuple):
    """One reading of every sensor; see Measurement."""

    joint_position: Vector
    joint_velocity: Vector
    tip_deflection: Vector
    root_curvature: Vector


class Sensors:
    """Turn the truth into readings. The same seed gives the same noise."""

    def __init__(self, settings: SensorSettings, rng: np.random.Generator) -> None:
        self._channels = (
            settings.joint_position,
            settings.joint_velocity,
            settings.tip_deflection,
            settings.root_curvature,
        )
        self._perfect = all(channel == Channel() for channel in self._channels)
        self._rng = rng

    def read(self, truth: Readings) -> Readings:
        """Return what the sensors say; a perfect set returns the truth itself."""
        if self._perfect:
            return truth
        return Readings(*map(self._reading, self._channels, truth))

    def _reading(self, channel: Channel, value: Vector) -> Vector:
        reading = value + channel.bias
        if channel.noise:
            reading = reading + channel.noise * self._rng.standard_normal(value.size)
        if channel.quantisation:
            reading = channel.quantisation * np.round(reading / channel.quantisation)
        return reading
