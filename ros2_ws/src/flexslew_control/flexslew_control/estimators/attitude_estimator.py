"""The attitude and rates of a platform from its gyro, star trackers and Sun sensors."""

from collections import deque
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from flexslew_control.estimators.attitude_filter import (
    Correction,
    GyroNoise,
    RigidFilter,
    copied,
)
from flexslew_control.estimators.attitude_steps import BIAS, AttitudeEstimate
from flexslew_control.estimators.attitude_tick import AttitudeNumbers, take_readings
from flexslew_control.estimators.flexible_attitude_filter import (
    AppendageModesSettings,
    FlexibleFilter,
    flexible_filter,
)
from flexslew_control.law import Estimate, Estimator, MeasuredJoints, PlantDescription, Reference
from flexslew_plant.arrays import EMPTY, Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds.instruments import Gyro, Instrument, StarTracker, SunSensor
from flexslew_plant.testbeds.instruments.instrument import channels
from flexslew_plant.testbeds.orientation.attitude import AttitudeJoints, rotation_vector


@section
class AttitudeFilterSettings:
    """The `attitude` section of a law that takes the attitude from sensors alone."""

    gyro: str | None = None  # name of the gyro; null: the only one
    noise_factor: Positive = 1.0  # on all noises that the sensors state [-]
    initial_attitude: NonNegative = 1.0  # standard deviation until the first reading [rad]
    initial_bias: NonNegative = 1e-3  # of the gyro's bias at the start [rad/s]
    modes: AppendageModesSettings | None = None  # with appendages' modes; null: by the gyro alone


@dataclass
class AttitudeEstimator:
    """The readings of joints that turn the platform, estimated by a filter of attitude and bias.

    The filter stands as far in the past as the latest reading is late. Its estimate is carried to
    the present with the gyro's readings since, so that a late reading counts for its own time.
    Its first attitude is the first that a star tracker reads; until then it takes the reference
    for the attitude. All other joints are as measured. The covariance is of the small turn in
    body axes [rad], then of the bias [rad/s]; innovations without a reading are zero.

    Args:
        joints: joints that read the attitude.
        gyro: source of the rates.
        trackers, suns: sensors that correct them.
        settings: noises and initial deviations.
        period: one tick [s].
        filter: filter of attitude, bias and perhaps modes.
    """

    joints: AttitudeJoints
    gyro: Gyro
    trackers: tuple[StarTracker, ...]
    sun_sensors: tuple[SunSensor, ...]
    settings: AttitudeFilterSettings
    period: float
    filter: RigidFilter | FlexibleFilter
    _filter_estimate: AttitudeEstimate = field(init=False)
    # gyro and efforts since the time of that
    _rates: deque[tuple[Vector, Vector]] = field(init=False)
    _covariance: Matrix = field(init=False)  # its shape tells which filters can follow each other
    _seen: Matrix = field(init=False)  # tips of the ticks with readings that may still count
    _known: Vector = field(init=False)  # 1 once a star tracker has given the attitude, else 0
    _first: int = field(init=False, default=0)  # tick of the reset
    _tick: int = field(init=False, default=-1)
    _reference: Vector = field(init=False, default_factory=lambda: EMPTY)
    _last: Estimate = field(init=False)

    def __post_init__(self) -> None:
        """Compile the step for readings, which a controller's warm-up may be too short for."""
        sensors: list[Instrument] = [self.gyro, *self.trackers, *self.sun_sensors]
        self._seen = np.zeros((self.late + 1, max(channels(one).stop for one in sensors)))
        start = self.filter.begin(np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3), (1.0, 1.0))
        self._filter_estimate, self._known = start, np.zeros(1)
        self._correct(np.zeros(0))

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
        self._rates, self._known = deque(), np.zeros(1)
        self._seen = np.zeros((self.late + 1, measurement.tip_deflection.size))
        self._first = measurement.tick
        self._take(measurement)

    def update(self, measurement: Measurement) -> Estimate:
        """Return the estimated positions and rates of the joints."""
        if measurement.tick != self._tick:
            self._rates.append((self._reading(measurement), measurement.applied_effort))
            result = None
            if measurement.tick - self._first > self.late:
                result = self.filter.propagate(self._filter_estimate, *self._rates.popleft())
                self._filter_estimate = result.estimate
            self._take(measurement, result)
        return self._last

    @cached_property
    def late(self) -> int:
        """By how many ticks the latest reading is late."""
        return max((tracker.delay_ticks(self.period) for tracker in self.trackers), default=0)

    @cached_property
    def numbers(self) -> AttitudeNumbers:
        """The constants of its steps."""
        s, inverse = self.settings, self.joints.rotation_vector_of(np.eye(len(self.joints.axes)))
        count, suns = len(self.trackers), self.sun_sensors
        late = [(one.first, one.delay_ticks(self.period)) for one in self.trackers]
        return AttitudeNumbers(
            np.array(self.joints.axes, dtype=np.float64),
            np.array(inverse.T, order="C"),
            np.array([self.gyro.first]),
            np.array(late).reshape(count, 2),
            np.array([one.covariance for one in self.trackers]).reshape(count, 3, 3),
            np.array([one.settings.rate_noise for one in self.trackers]),
            np.array([one.first for one in suns], dtype=np.int64),
            np.array([one.sun for one in suns]).reshape(-1, 3),
            np.array([one.settings.noise for one in suns]),
            np.array([s.noise_factor]),
            np.array(self.filter.noise),
            np.array([s.initial_attitude, s.initial_bias]),
            np.array([self.period]),
        )

    def _take(self, measurement: Measurement, result: Correction | None = None) -> None:
        """Correct the estimate by what was measured at its time, and carry it to the present."""
        self._tick = measurement.tick
        self._seen = np.vstack((self._seen[1:], measurement.tip_deflection))
        first = self.filter.channels
        innovation, nis = np.zeros(first + 3 * len(self.trackers) + 2 * len(self.sun_sensors)), 0.0
        if result is not None:
            innovation[:first], nis = result.innovation, result.nis
        if self._tick - self._first >= self.late:
            nis += self._correct(innovation[first:])
        now = self._filter_estimate
        for reading, effort in self._rates:
            now = self.filter.propagate(now, reading, effort).estimate
        self._last = self._estimate(measurement, now, innovation, nis)

    def _correct(self, innovation: Vector) -> float:
        """Take the readings of the estimate's own time; see take_readings."""
        self._filter_estimate = copied(self._filter_estimate)
        given = self._seen, self._filter_estimate, self._known, innovation
        return take_readings(0, self.numbers, self.filter.errors, *given)

    def _reference_position(self, measurement: Measurement) -> Vector:
        """Return the reference joint positions; the measured ones if there is no reference."""
        return self._reference if self._reference.size else measurement.joint_position

    def _estimate(
        self, measurement: Measurement, now: AttitudeEstimate, innovation: Vector, nis: float
    ) -> Estimate:
        """Return what the joints would read, as positions about the reference."""
        self._covariance, axes, reads = (
            self.filter.covariance(now),
            self.joints.axes,
            self.joints.reads,
        )
        rotation, rate = (
            rotation_vector(now.state[:BIAS]),
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
    attitude_filter: RigidFilter | FlexibleFilter = RigidFilter(noise, period)
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
