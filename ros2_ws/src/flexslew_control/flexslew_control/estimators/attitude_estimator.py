"""The attitude and rates of a platform from its gyro, star trackers and Sun sensors."""

from collections import deque
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from flexslew_control.estimators.attitude_filter import (
    Correction,
    GyroNoise,
    RigidFilter,
)
from flexslew_control.estimators.flexible_attitude_filter import (
    AppendageModesSettings,
    flexible_filter,
)
from flexslew_control.law import Estimate, Estimator, MeasuredJoints, PlantDescription, Reference
from flexslew_plant.arrays import EMPTY, Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds.attitude import AttitudeJoints, rotation_vector
from flexslew_plant.testbeds.instruments import Gyro, StarTracker, SunSensor
from flexslew_plant.testbeds.instruments.instrument import channels

LEAST = 1e-9  # sigma of a sensor that states none [rad]
PRESENT = 0.5  # size of a reading from which on it is one: zeros mean that there is none


@section
class AttitudeFilterSettings:
    """The `attitude` section of a law that takes the attitude from sensors alone."""

    gyro: str | None = None  # name of the gyro; null: the only one
    noise_factor: Positive = 1.0  # on all noises that the sensors state [-]
    initial_attitude: NonNegative = 1.0  # standard deviation until the first reading [rad]
    initial_bias: NonNegative = 1e-3  # of the gyro's bias at the start [rad/s]
    modes: AppendageModesSettings | None = None  # with appendages' modes; null: by the gyro alone


class AttitudeFilter(Protocol):
    """A filter of attitude, bias and perhaps more; beliefs are its own."""

    @property
    def noise(self) -> GyroNoise:
        """Noise of the gyro."""

    @property
    def channels(self) -> int:
        """Number of the gyro's innovations."""

    def begin(self, attitude: Vector, reading: Vector, sigmas: tuple[float, float]) -> Any:
        """Return the first belief; sigmas are of attitude [rad] and bias [rad/s]."""

    def propagate(self, estimate: Any, reading: Vector, effort: Vector) -> Correction:
        """Return the belief a tick later, of the gyro's reading and the efforts of that tick."""

    def update_attitude(self, estimate: Any, measured: Vector, noise: Matrix) -> Correction:
        """Return the belief after a measured attitude."""

    def update_direction(
        self, estimate: Any, measured: Vector, inertial: Vector, sigma: float
    ) -> Correction:
        """Return the belief after a measured direction."""

    def initialize_attitude(self, estimate: Any, measured: Vector, noise: Matrix) -> Any:
        """Return the belief in the first measured attitude."""

    def rate(self, estimate: Any, reading: Vector) -> Vector:
        """Return the rate in body axes, shape (3,) [rad/s]."""

    def covariance(self, estimate: Any) -> Matrix:
        """Return the covariance of small turn and bias, then of the other states."""


@dataclass
class AttitudeEstimator:
    """The readings of joints that turn the platform, estimated by a filter of attitude and bias.

    The filter stands as far in the past as the latest reading is late. Its belief is carried to
    the present with the gyro's readings since, so that a late reading counts for its own time.
    Its first attitude is the first that a star tracker reads; until then it takes the reference
    for the attitude. All other joints are as measured. The covariance is of the small turn in
    body axes [rad], then of the bias [rad/s]; innovations without a reading are zero.

    Args:
        joints: joints that read the attitude.
        gyro: source of the rates.
        trackers, suns: sensors that correct them.
        settings: noises and initial deviations.        period: one tick [s].
        filter: filter of attitude, bias and perhaps modes.
    """

    joints: AttitudeJoints
    gyro: Gyro
    trackers: tuple[StarTracker, ...]
    sun_sensors: tuple[SunSensor, ...]
    settings: AttitudeFilterSettings
    period: float
    filter: AttitudeFilter
    _filter_estimate: Any = field(init=False)
    _covariance: Matrix = field(init=False)  # of the estimate; its shape distinguishes beliefs
    _rates: deque[tuple[Vector, Vector]] = field(
        init=False
    )  # gyro and efforts since the time of the belief
    _seen: deque[Vector] = field(init=False)  # tips of the ticks with readings that may still count
    _first: int = field(init=False, default=0)  # tick of the reset
    _tick: int = field(init=False, default=-1)
    _attitude_known: bool = field(
        init=False, default=False
    )  # a star tracker has given the attitude
    _reference: Vector = field(init=False, default_factory=lambda: EMPTY)
    _last: Estimate = field(init=False)

    def __post_init__(self) -> None:
        """Compile the steps for readings, which the zeros of a controller's warm-up do not call."""
        estimate = self.filter.begin(np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3), (1.0, 1.0))
        self.filter.update_attitude(estimate, estimate.attitude, np.eye(3))
        self.filter.update_direction(estimate, np.eye(3)[0], np.eye(3)[0], 1.0)

    def expect(self, reference: Reference) -> None:
        """Set the reference joint positions for the next tick."""
        self._reference = reference.position

    def reset(self, measurement: Measurement) -> None:
        """Start where the reference is, without a bias, and take in the first readings."""
        s, reference = self.settings, self._reference_position(measurement)
        start, reading = self.joints.orientation(reference), self._reading(measurement)
        self._filter_estimate = self.filter.begin(
            start, reading, (s.initial_attitude, s.initial_bias)
        )
        self._rates, self._attitude_known = deque(), False
        self._seen = deque(maxlen=self.late + 1)
        self._first = measurement.tick
        self._take(measurement)

    def update(self, measurement: Measurement) -> Estimate:
        """Return the joints' positions and rates as they are believed."""
        if measurement.tick != self._tick:
            self._rates.append((self._reading(measurement), measurement.applied_effort))
            result = None
            if measurement.tick - self._first > self.late:
                result = self.filter.propagate(self._filter_estimate, *self._rates.popleft())
                self._filter_estimate = result.belief
            self._take(measurement, result)
        return self._last

    @cached_property
    def late(self) -> int:
        """By how many ticks the latest reading is late."""
        return max((tracker.delay_ticks(self.period) for tracker in self.trackers), default=0)

    def _take(self, measurement: Measurement, result: Correction | None = None) -> None:
        """Correct the belief by what was measured at its time, and carry it to the present."""
        self._tick = measurement.tick
        self._seen.append(measurement.tip_deflection)
        first = self.filter.channels
        innovation, nis = np.zeros(first + 3 * len(self.trackers) + 2 * len(self.sun_sensors)), 0.0
        if result is not None:
            innovation[:first], nis = result.innovation, result.nis
        if len(self._seen) > self.late:
            nis += self._correct(innovation[first:])
        now = self._filter_estimate
        for reading, effort in self._rates:
            now = self.filter.propagate(now, reading, effort).belief
        self._last = self._estimate(measurement, now, innovation, nis)

    def _correct(self, innovation: Vector) -> float:
        """Take the readings of the belief's own time, write innovations, return their squares."""
        nis, at = 0.0, 0
        for tracker in self.trackers:
            read = self._seen[tracker.delay_ticks(self.period)][channels(tracker)]
            if _present(read):
                nis += self._fixed(tracker, read / np.linalg.norm(read), innovation[at : at + 3])
            at += 3
        for sun in self.sun_sensors:
            read = self._seen[0][channels(sun)]
            if _present(read) and self._attitude_known:
                sigma = self.settings.noise_factor * sun.settings.noise + LEAST
                result = self.filter.update_direction(self._filter_estimate, read, sun.sun, sigma)
                self._filter_estimate, nis = result.belief, nis + result.nis
                innovation[at : at + 2] = result.innovation
            at += 2
        return nis

    def _fixed(self, tracker: StarTracker, read: Vector, innovation: Vector) -> float:
        """Take an attitude that a star tracker has read; return its squared innovation."""
        rate = self._seen[0][channels(self.gyro)] - self._filter_estimate.bias
        noise = self.settings.noise_factor**2 * tracker.covariance_at(float(np.linalg.norm(rate)))
        noise = noise + LEAST**2 * np.eye(3)
        if not self._attitude_known:
            self._attitude_known = True
            self._filter_estimate = self.filter.initialize_attitude(
                self._filter_estimate, read, noise
            )
            return 0.0
        result = self.filter.update_attitude(self._filter_estimate, read, noise)
        self._filter_estimate, innovation[:] = result.belief, result.innovation
        return result.nis

    def _reference_position(self, measurement: Measurement) -> Vector:
        """Return the reference joint positions; the measured ones if there is no reference."""
        return self._reference if self._reference.size else measurement.joint_position

    def _estimate(
        self, measurement: Measurement, now: Any, innovation: Vector, nis: float
    ) -> Estimate:
        """Return what the joints would read, as positions about the reference."""
        self._covariance, axes, reads = (
            self.filter.covariance(now),
            self.joints.axes,
            self.joints.reads,
        )
        rotation, rate = (
            rotation_vector(now.attitude),
            self.filter.rate(now, self._reading(measurement)),
        )
        position = np.where(reads, axes @ rotation, measurement.joint_position)
        velocity = np.where(reads, axes @ rate, measurement.joint_velocity)
        position = self.joints.about(self._reference_position(measurement), position)
        return Estimate(position, velocity, EMPTY, self._covariance, innovation, nis)

    def _reading(self, measurement: Measurement) -> Vector:
        return measurement.tip_deflection[channels(self.gyro)]


def attitude_estimator(
    plant: PlantDescription, settings: AttitudeFilterSettings
) -> AttitudeEstimator:
    """Return the estimator for the sensors of a testbed.

    Raises:
        BadInput: its joints do not turn it in three axes, or it lacks a gyro or a star tracker.
    """
    model = plant.testbed.model()
    instruments = model.appendages.instruments
    gyros = {one.name: one for one in instruments if isinstance(one, Gyro)}
    trackers = tuple(one for one in instruments if isinstance(one, StarTracker))
    sun_sensors = tuple(one for one in instruments if isinstance(one, SunSensor))
    if model.attitude is None:
        raise BadInput("the joints of this testbed do not turn it in three axes", key="attitude")
    if not trackers or not gyros:
        missing = "gyro" if trackers else "star_tracker"
        raise BadInput(f"the testbed has no {missing}; give it one in `sensors`", key="attitude")
    name = settings.gyro
    if name is None and len(gyros) == 1:
        (name,) = gyros
    if name not in gyros:
        raise BadInput(f"one of {', '.join(gyros)}", key="attitude.gyro", value=name)
    result, factor, period = gyros[name].settings, settings.noise_factor, plant.period
    noise = GyroNoise(factor * result.angle_random_walk, factor * result.rate_random_walk)
    attitude_filter: AttitudeFilter = RigidFilter(noise, period)
    if settings.modes is not None:
        attitude_filter = flexible_filter(
            plant.design_model(settings.modes.model), noise, settings.modes, period
        )
    return AttitudeEstimator(
        model.attitude, gyros[name], trackers, sun_sensors, settings, period, attitude_filter
    )


def joint_estimator(plant: PlantDescription, settings: AttitudeFilterSettings | None) -> Estimator:
    """Return the estimator of joints for a collocated law: as measured, or by a filter.

    Raises:
        BadInput: see attitude_estimator.
    """
    return MeasuredJoints() if settings is None else attitude_estimator(plant, settings)


def _present(reading: Vector) -> bool:
    """Return whether a sensor has read something: no zeros, and no NaN of one that is broken."""
    return bool(np.linalg.norm(reading) > PRESENT)
