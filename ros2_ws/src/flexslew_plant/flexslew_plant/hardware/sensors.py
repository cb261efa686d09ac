"""Encoders, rate sensors, tip and root sensors: the truth with bias, noise and quantisation."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import EMPTY, Vector
from flexslew_plant.hardware.sensor_step import SensorNumbers, add_errors
from flexslew_plant.settings import NonNegative, section
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
    appendages = model.appendages
    position, velocity = model.joint_state(x)
    tip, curvature = model.deflections(x)
    if appendages.rate is not None:
        tip = tip + appendages.rate.dot(model.modal_state(x)[1])
    if appendages.exact_reading is not None:
        tip = tip + appendages.exact_reading(x, model.derivative(x, effort, t), t)
    return Readings(position, velocity, tip, curvature)


def channel_bounds(joints: int, tips: int) -> list[int]:
    """Return where each channel of Readings begins among all readings, and where the last ends."""
    return [0, joints, 2 * joints, 2 * joints + tips, 2 * (joints + tips)]


def sensor_numbers(settings: SensorSettings, model: Model) -> SensorNumbers:
    """Return the errors of all sensors of a testbed: of their kinds, then those of single tips."""
    bounds, own = channel_bounds(model.joints, len(model.appendages.names)), model.appendages.errors
    place, errors = np.arange(bounds[-1]), np.zeros((3, 0))
    if settings == SensorSettings():
        place = place[:0]
    else:
        channels = [getattr(settings, name) for name in Readings._fields]
        each = [(channel.noise, channel.bias, channel.quantisation) for channel in channels]
        errors = np.repeat(np.array(each).T, np.diff(bounds), axis=1)
    drawn = errors[0] > 0.0
    if own is not None and own.any():  # noise is drawn for all tips, also where it is 0
        place = np.concatenate((place, np.arange(bounds[2], bounds[3])))
        errors, drawn = np.hstack((errors, own)), np.append(drawn, np.full(own.shape[1], True))
    column = np.where(drawn, np.cumsum(drawn) - 1, -1)
    noise, bias, quantum = np.ascontiguousarray(errors)
    return SensorNumbers(place, bias, quantum, column, noise[drawn])


class Sensors:
    """Turn the truth into readings. The same seed gives the same noise.

    Args:
        settings: errors of every kind of sensor.
        model: what stands on the bench; its instruments replace their readings among the tips.
        period: one tick [s].
        seed: of all noises; None: no errors, but the delays and gaps of instruments.
    """

    def __init__(
        self, settings: SensorSettings, model: Model, period: float, seed: list[int] | None = None
    ) -> None:
        self._rng = np.random.default_rng(seed or 0)
        numbers = sensor_numbers(settings, model)
        self._numbers = numbers if seed is not None and numbers.place.size else None
        bounds = channel_bounds(model.joints, len(model.appendages.names))
        self._channels = [slice(*pair) for pair in pairwise(bounds)]
        self._instruments = model.appendages.started(period, seed)

    def read(self, truth: Readings, x: Vector = EMPTY) -> Readings:
        """Return the sensor readings; a perfect set returns the truth itself.

        Args:
            truth: readings without errors.
            x: state of the testbed, for instruments.
        """
        readings = truth
        if self._numbers is not None:
            values = np.concatenate(truth)
            add_errors(self._numbers, self._numbers.draw(self._rng, 1)[0], values)
            readings = Readings(*(values[channel] for channel in self._channels))
        if self._instruments is None:
            return readings
        return readings._replace(tip_deflection=self._instruments(x, readings.tip_deflection))
