"""An attitude estimator with its instruments, from the true attitude of every tick.

So the linear form of a controller that reads star tracker and gyro is one from the attitude of the
joints to the efforts: delays, the gyro's mean over a tick and the filter are states of it. A filter
is linear in its error state; its gains are those of the covariance that has settled. An instrument
that reads every N ticks, or not always, counts as one that reads every tick with as much
information, so that the form does not change from tick to tick.
"""

from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np

from flexslew_control.estimators.attitude_estimator import AttitudeEstimator
from flexslew_control.estimators.attitude_filter import RigidFilter
from flexslew_control.estimators.attitude_steps import BIAS, MODES
from flexslew_control.estimators.attitude_tick import LEAST
from flexslew_control.estimators.later_covariance import later_covariance
from flexslew_control.law import Estimate, Reference
from flexslew_plant.arrays import EMPTY, Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds.instruments import StarTracker
from flexslew_plant.testbeds.instruments.instrument import channels
from flexslew_plant.testbeds.orientation.attitude import (
    conjugate,
    product,
    rotation_vector,
    to_body,
)

_REST_TICKS = 300  # ticks
_DOUBLINGS = 24  # of a tick, after which the covariance of attitude and bias is taken
_LEAST_RATE = 1e-6  # least share of ticks with a reading [-]


@dataclass
class InstrumentSimulator:
    """An attitude estimator that receives positions, which its instruments turn into readings.

    The positions are about the reference, as a controller passes them; see AttitudeJoints.about.

    Args:
        inner: the estimator; its star trackers read every tick.
    """

    inner: AttitudeEstimator
    _reference: Vector = field(init=False, default_factory=lambda: EMPTY)
    _history: deque[Vector] = field(init=False, default_factory=deque)  # the newest last
    _tick: int = field(init=False, default=-1)
    _first: int = field(init=False, default=0)  # tick of the reset
    _extra_ticks: int = field(init=False, default=0)  # ticks that the filter has rested in between
    _steady_covariance: Matrix | None = field(init=False, default=None)  # covariance; None: not yet

    def expect(self, reference: Reference) -> None:
        """Set the reference joint positions for the next tick."""
        self._reference = reference.position
        self.inner.expect(reference)

    def reset(self, measurement: Measurement) -> None:
        """Start at the attitude of this measurement, at rest."""
        now = self._attitude(measurement)
        kept = max(self.inner.late, 1) + 1
        self._history = deque([now.copy() for _ in range(kept)], maxlen=kept)
        self._tick = self._first = measurement.tick
        self._extra_ticks, self._steady_covariance = 0, None
        self.inner.reset(self._read(measurement))

    def update(self, measurement: Measurement) -> Estimate:
        """Return the estimate from the instruments' readings at this tick."""
        if measurement.tick != self._tick:
            self._tick = measurement.tick
            self._history.append(self._attitude(measurement))
        seen = self._read(measurement)
        if self._steady_covariance is None and measurement.tick > self._first + self.inner.late:
            self._run_to_rest(seen)
        estimate = self.inner.update(seen._replace(tick=seen.tick + self._extra_ticks))
        if self._steady_covariance is not None:  # rounding apart, it is that already
            self.inner._filter_estimate = self.inner._filter_estimate._replace(
                covariance=self._steady_covariance
            )
        return estimate

    def _attitude(self, measurement: Measurement) -> Vector:
        """Return the true attitude, whose error from the reference is that of the positions."""
        joints, position = self.inner.joints, measurement.joint_position
        if self._reference.size:
            position = joints.add_error(self._reference, position - self._reference)
        return joints.orientation(position)

    def _run_to_rest(self, seen: Measurement) -> None:
        """Let the filter rest at these readings until its gains change little, and keep them."""
        for _ in range(_REST_TICKS):
            self.inner.update(seen._replace(tick=seen.tick + self._extra_ticks))
            self._extra_ticks += 1
        estimate = self.inner._filter_estimate
        self._steady_covariance = self._later(_DOUBLINGS)
        self.inner._filter_estimate = estimate._replace(covariance=self._steady_covariance)

    def _read(self, measurement: Measurement) -> Measurement:
        """Return the measurement with the readings of the instruments."""
        it, now, tips = self.inner, self._history[-1], measurement.tip_deflection.copy()
        rotation = rotation_vector(product(conjugate(self._history[-2]), now))
        tips[channels(it.gyro)] = it.gyro.response @ rotation / it.period
        for tracker in it.trackers:
            late = tracker.delay_ticks(it.period)
            tips[channels(tracker)] = self._history[-1 - late]
        for sun in it.sun_sensors:
            seen, along = to_body(now) @ sun.sun, np.array(sun.settings.boresight)
            visible = seen @ along >= np.cos(sun.settings.half_angle) * np.linalg.norm(along)
            tips[channels(sun)] = seen * visible
        return measurement._replace(tip_deflection=tips)

    def _later(self, doublings: int) -> Matrix:
        """Return the covariance after 2^doublings ticks at rest, of attitude and bias."""
        it, estimate = self.inner, self.inner._filter_estimate
        f, static = np.eye(6), estimate._replace(covariance=np.zeros((6, 6)))
        f[:3, 3:] = -it.period * np.eye(3)
        bias = estimate.state[BIAS:MODES]
        q = it.filter.propagate(static, bias, np.zeros(0)).estimate.covariance
        rows, variances = [], []
        for tracker in it.trackers:
            noise = it.settings.noise_factor**2 * tracker.covariance + LEAST**2 * np.eye(3)
            sizes, axes = np.linalg.eigh(noise)
            rows.append(axes.T)
            variances.append(sizes)
        c, r = np.hstack((np.vstack(rows), np.zeros((3 * len(rows), 3)))), np.concatenate(variances)
        return later_covariance(f, q, c, r, f @ estimate.covariance @ f.T + q, doublings)[1]


def with_sensors(estimator: AttitudeEstimator) -> InstrumentSimulator:
    """Return the estimator with instruments that read at every tick, with as much information.

    Raises:
        BadInput: its filter estimates appendage modes, too.
    """
    if not isinstance(estimator.filter, RigidFilter):
        words = "a filter with appendage modes has no linear form; allowed: attitude: {}"
        raise BadInput(words, key="attitude.modes")
    trackers = tuple(_every_tick(one, estimator.period) for one in estimator.trackers)
    return InstrumentSimulator(replace(estimator, trackers=trackers))


def _every_tick(tracker: StarTracker, period: float) -> StarTracker:
    s = tracker.settings
    share = (1.0 - s.dropout) / max(1, round(s.interval / period))
    more = 1.0 / np.sqrt(max(share, _LEAST_RATE))
    settings = replace(
        s, across=more * s.across, about=more * s.about, rate_noise=0.0, interval=0.0, dropout=0.0
    )
    return replace(tracker, settings=settings)
