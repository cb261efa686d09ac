"""Encoders, rate sensors, tip and root sensors: the truth with bias, noise and quantisation."""

from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import EMPTY, Matrix, Vector
from flexslew_plant.settings import NonNegative, section
from flexslew_plant.testbeds.appendages import InstrumentReader
from flexslew_plant.testbeds.model import Model


@section
class Channel:
    """Errors of one kind of sensor, in its own unit; all off by default."""

    noise: NonNegative = 0.0  # standard deviation of the noise of each tick [unit of the section]
    bias: float = 0.0  # added to every reading [unit of the section]
    quantisation: NonNegative = 0.0  # readings are multiples of it; 0: none [unit of the section]


@section
class SensorSettings:
    """The `sensors` section."""

    joint_position: Channel = Channel()  # encoders [rad or m]
    joint_velocity: Channel = Channel()  # rate sensors [rad/s or m/s]
    tip_deflection: Channel = Channel()  # tip sensors [m]
    root_curvature: Channel = Channel()  # strain gauges at the root [1/m]


class Readings(NamedTuple):
    """One reading of every sensor; see Measurement."""

    joint_position: Vector
    joint_velocity: Vector
    tip_deflection: Vector
    root_curvature: Vector


def exact_readings(model: Model, x: Vector, effort: Vector, t: float) -> Readings:
    """Return what sensors without errors read.

    Args:
        model: what stands on the bench.
        x: its state.
        effort: held during the last tick, disturbances included, shape (efforts,) [N m or N].
        t: [s].
    """
    position, velocity = model.joint_state(x)
    modes, rates = model.modal_state(x)
    tip = model.appendages.reading(modes, rates)
    if model.appendages.exact_reading is not None:
        tip = tip + model.appendages.exact_reading(x, model.derivative(x, effort, t), t)
    return Readings(position, velocity, tip, model.appendages.curvature.dot(modes))


class Sensors:
    """Turn the truth into readings. The same seed gives the same noise."""

    def __init__(
        self,
        settings: SensorSettings,
        rng: np.random.Generator,
        tips: Matrix | None = None,
        instruments: InstrumentReader | None = None,
    ) -> None:
        """Take the errors.

        Args:
            settings: settings of every kind of sensor.
            rng: generator of the noise.
            tips: noise, bias and quantisation of each tip reading, in its own unit and on top of
                those of its kind, shape (3, tips); None if unused.
            instruments: readings of these replace theirs among the tips; None if unused.
        """
        self._channels = (
            settings.joint_position,
            settings.joint_velocity,
            settings.tip_deflection,
            settings.root_curvature,
        )
        self._ideal = all(channel == Channel() for channel in self._channels)
        self._rng = rng
        self._tips = None if tips is None or not tips.any() else tips
        self._instruments = instruments

    def read(self, truth: Readings, x: Vector = EMPTY) -> Readings:
        """Return the sensor readings; a perfect set returns the truth itself.

        Args:
            truth: readings without errors.
            x: state of the testbed, for instruments.
        """
        readings = self._with_errors(truth)
        if self._instruments is None:
            return readings
        return readings._replace(tip_deflection=self._instruments(x, readings.tip_deflection))

    def _with_errors(self, truth: Readings) -> Readings:
        """Return the readings of all sensors but the instruments."""
        if not self._ideal:
            truth = Readings(*map(self._reading, self._channels, truth))
        if self._tips is None:
            return truth
        noise, bias, step = self._tips
        tip = truth.tip_deflection + bias + noise * self._rng.standard_normal(bias.size)
        rounded = step * np.round(tip / np.where(step > 0.0, step, 1.0))
        return truth._replace(tip_deflection=np.where(step > 0.0, rounded, tip))

    def _reading(self, channel: Channel, value: Vector) -> Vector:
        reading = value + channel.bias
        if channel.noise:
            reading = reading + channel.noise * self._rng.standard_normal(value.size)
        if channel.quantisation:
            reading = channel.quantisation * np.round(reading / channel.quantisation)
        return reading


def exact_sensors(model: Model, period: float) -> Sensors:
    """Return sensors without errors, but with the delays and gaps of instruments.

    Args:
        model: what stands on the bench.
        period: one tick [s].
    """
    instruments = model.appendages.started(period)
    return Sensors(SensorSettings(), np.random.default_rng(0), instruments=instruments)
