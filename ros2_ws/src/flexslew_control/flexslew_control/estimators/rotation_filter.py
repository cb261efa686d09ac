"""A Kalman filter of how far a turning craft is from its plan, in attitude, rates and modes."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from flexslew_control.estimators.kalman import FilterSettings, KalmanFilter
from flexslew_control.estimators.later_covariance import later_covariance
from flexslew_control.estimators.prediction import (
    first_gain,
    first_state,
    gain_of,
    innovation_variance,
    measurement_update,
)
from flexslew_control.law import Estimate, PlantDescription, Reference
from flexslew_control.linear.rate_dependent_platform import RateDependentPlatform
from flexslew_control.linear.zero_order_hold import zero_order_hold
from flexslew_plant.arrays import EMPTY, Matrix, Tensor, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement

_WALK = 0.1  # of a disturbance, of the largest effort limit [1/sqrt(s)]
_SECOND = 1.0  # times the square of that limit is the density of the noise on joints [s]


class FilterAlong(NamedTuple):
    """A RotationFilter's matrices at the ticks of a plan; the first gain is that of its reset."""

    states: Tensor  # F of the tick that begins, (ticks, k, k)
    efforts: Tensor  # G, (ticks, k, joints)
    gains: Tensor  # K of the tick's measurement, (ticks, k, outputs)


@dataclass
class RotationFilter:
    """The estimator of [e, e', d]: the deviation of joints and modes, and effort disturbances.

    The joints' part of e is the rotation from the plan to the measurement, in body axes, and that
    of e' the difference of body rates, so it is the same from every inertial frame. Over a tick
    [e, e'] follows A(w) (see rate_dependent_platform) about the rates w of the plan, exactly for a
    held
    effort, driven by what the effort was beyond the plan's; d is a random walk. The estimate is
    the reference plus e: of the modes, what they have beyond those of the plan. It starts with
    none of that.

    Args:
        platform: the small motions about any rates.
        period: one tick [s].
        static: the filter about rest, with the constants that this one shares.
    """

    platform: RateDependentPlatform
    period: float
    static: KalmanFilter
    _x: Vector = field(init=False, default_factory=lambda: EMPTY)
    _p: Matrix = field(init=False)
    _prior: Matrix = field(init=False)  # P before the last measurement
    _tick: int = field(init=False, default=-1)
    _now: Reference | None = field(init=False, default=None)  # of the tick that comes
    _before: Reference | None = field(init=False, default=None)  # of the last one
    _last: Estimate = field(init=False)
    _step_cache: tuple[Vector, Matrix, Matrix] | None = field(init=False, default=None)  # w, F, G

    def expect(self, reference: Reference) -> None:
        """Set the reference for the next tick."""
        self._now = reference

    def reset(self, measurement: Measurement) -> None:
        """Start from the measured joints, the modes of the plan and no disturbance."""
        reference = self._reference(measurement)
        self._p = self._prior = self.static.matrices.first.copy()
        y = _deviation(measurement, reference)
        self._x = first_state(y, self.platform.small.coordinates, len(self._p))
        self._tick, self._before = measurement.tick, reference
        self._last = self._estimate(reference, np.zeros(y.size), 0.0)

    def update(self, measurement: Measurement) -> Estimate:
        """Return the estimate at this tick, with innovation, covariance of [e, e', d] and NIS."""
        if measurement.tick == self._tick:
            return self._last
        reference, before = self._reference(measurement), self._before
        assert before is not None
        f, g = self._step(before.velocity)
        x = f @ self._x + g @ (measurement.applied_effort - before.effort)
        p = f @ self._p @ f.T + self.static.matrices.q
        y = _deviation(measurement, reference)
        constant = self.static.matrices
        self._x, self._p, innovation, nis = measurement_update(x, p, y, constant.c, constant.r)
        self._prior, self._tick, self._before = p, measurement.tick, reference
        self._last = self._estimate(reference, innovation, nis)
        return self._last

    def along(self, references: list[Reference]) -> FilterAlong:
        """Return the filter of a plan from a reset on: no measurement changes its covariance."""
        c, q, r = self._noise
        (outputs, k), m, n = c.shape, self.platform.small.joints, self.platform.small.coordinates
        ticks, p = len(references), self.static.matrices.first
        found = FilterAlong(
            np.empty((ticks, k, k)), np.empty((ticks, k, m)), np.zeros((ticks, k, outputs))
        )
        found.gains[0] = first_gain(outputs, n, k)
        velocities = np.array([reference.velocity for reference in references])
        changes = np.flatnonzero((velocities[1:] != velocities[:-1]).any(axis=1))
        last_change = int(changes[-1]) + 1 if changes.size else 0  # the rates are those of the end
        for tick, rates in enumerate(velocities):
            f, found.efforts[tick] = self._step(rates)
            found.states[tick] = f
            if tick + 1 == ticks:
                break
            prior = f @ p @ f.T + q
            found.gains[tick + 1], after = gain_of(prior, c, r)
            if tick > last_change and np.array_equal(after, p):
                found.states[tick:], found.efforts[tick:] = f, found.efforts[tick]
                found.gains[tick + 1 :] = found.gains[tick + 1]
                break
            p = after
        return found

    def settle(self, doublings: int) -> Matrix:
        """Let the covariance become that of 2^doublings ticks later at rest, and return it."""
        f, c, q, r = self._step(np.zeros(self.platform.small.joints))[0], *self._noise
        self._prior, self._p = later_covariance(f, q, c, r, self._prior, doublings)
        self._last = self._last._replace(covariance=self._p)
        return self._p

    def innovation_variance(self) -> Vector:
        """Return the diagonal of C P C^T + R of the last update, shape (l,)."""
        c, _, r = self._noise
        return innovation_variance(self._prior, c, r)

    @property
    def _noise(self) -> tuple[Matrix, Matrix, Vector]:
        return self.static.matrices.c, self.static.matrices.q, self.static.matrices.r

    def _step(self, rates: Vector) -> tuple[Matrix, Matrix]:
        """Return F and G of [e, e', d] over a tick about these rates."""
        if self._step_cache is None or not np.array_equal(self._step_cache[0], rates):
            b = self.platform.input_matrix
            (k, m), states = b.shape, len(self.static.matrices.first)
            f, g = np.eye(states), np.zeros((states, m))
            f[:k, :k], g[:k] = zero_order_hold(self.platform.state_matrix(rates), b, self.period)
            f[:k, k:] = g[:k, : states - k]
            self._step_cache = rates, f, g
        return self._step_cache[1:]

    def _reference(self, measurement: Measurement) -> Reference:
        """Return the plan's reference; rest at the measured joints if there is none."""
        if self._now is not None:
            return self._now
        static = np.zeros_like(measurement.joint_velocity)
        return Reference(measurement.joint_position, static, static, EMPTY)

    def _estimate(self, reference: Reference, innovation: Vector, nis: float) -> Estimate:
        n, m = self.platform.small.coordinates, self.platform.small.joints
        position, velocity = self._x[:n].copy(), self._x[n : 2 * n].copy()
        position[:m] += reference.position
        velocity[:m] += reference.velocity
        return Estimate(position, velocity, self._x[2 * n :], self._p, innovation, nis)


def _deviation(measurement: Measurement, reference: Reference) -> Vector:
    """Return positions, then rates of the joints from the reference."""
    off = measurement.joint_position - reference.position
    return np.concatenate((off, measurement.joint_velocity - reference.velocity))


def rotation_filter(
    platform: RateDependentPlatform,
    settings: FilterSettings,
    plant: PlantDescription,
    noise: Matrix | None = None,
    key: str = "filter.tip_sigma",
) -> RotationFilter:
    """Return the filter of a craft that turns in three axes.

    By default the settings assume white noise on each joint's equation as large as the drives over
    a second: on a torque itself, of a wheel on its share in what it turns. Much noise at the
    plant's input gives a loop the margins of its full state again (Doyle and Stein 1979, IEEE TAC
    24(4)); with none, modes of another frequency than modelled are lost.

    Args:
        platform: the small motions about any rates.
        settings: noises.
        plant: description with the effort limits and the period.
        noise: noise of a filter without disturbances, see KalmanFilter; None: with them.
        key: key of the tip's noise, for the error.

    Raises:
        BadInput: if a motion or a disturbance does not show in the joints, or a tip is to be read.
    """
    if settings.tip_sigma is not None:
        raise BadInput(
            "a craft that turns in three axes is estimated about its plan, which does not tell "
            "what a tip reads; leave it out",
            key=key,
            value=settings.tip_sigma,
        )
    small = platform.small
    most = float(plant.effort_limit.max())
    walk, effort_noise = settings.disturbance_walk, settings.effort_noise
    filter_settings = replace(settings, disturbance_walk=_WALK * most if walk is None else walk)
    joint_noise = _SECOND * most**2 if effort_noise is None else 0.0
    static = KalmanFilter(
        small, np.zeros(small.coordinates), filter_settings, plant.period, noise, joint_noise
    )
    return RotationFilter(platform, plant.period, static)
