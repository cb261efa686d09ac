"""The multiplicative extended Kalman filter of a flexible craft: attitude, bias, rates and modes.

What is believed moves by the craft's own equations under the efforts that were applied; the gyro
is a sensor of the mean rate over a tick, as the attitude turned by. The error is
[e, v, b]: e the small turn along the joints, then modes; v that of their rates; b of the bias. It
follows A(w) about the rates that are believed (see rate_dependent_platform), exactly for held
efforts.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag

from flexslew_control.estimators.attitude_filter import Correction, GyroNoise, cross_axes
from flexslew_control.free_platform import JointCoordinates, joint_coordinates
from flexslew_control.rate_dependent_platform import RateDependentPlatform, rate_dependent_platform
from flexslew_control.zero_order_hold import zero_order_hold
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds.attitude import (
    AttitudeJoints,
    conjugate,
    product,
    quaternion,
    rotation_vector,
    skew,
    to_body,
)
from flexslew_plant.testbeds.model import Model


@section
class AppendageModesSettings:
    """The `modes` section of `attitude`: the craft's own equations carry what is believed."""

    model: dict[str, Any] | None = None  # keys of the testbed that the filter believes otherwise
    effort_noise: Positive = 1e-3  # density of noise on each effort [N m sqrt(s)]
    initial: NonNegative = 1e-3  # standard deviation of each deflection at the start [m]


class FlexibleEstimate(NamedTuple):
    """An attitude, how the craft moves and bends, a bias, and how far off they may be."""

    attitude: Vector  # unit quaternion from body to inertial axes, x y z w, shape (4,)
    bias: Vector  # of the gyro, shape (3,) [rad/s]
    covariance: Matrix  # of [e, v, b], shape (2 n + 3, 2 n + 3)
    modes: Vector  # modal coordinates, shape (modes,)
    rates: Vector  # v of the model, shape (coordinates,)


@dataclass(frozen=True)
class FlexibleFilter:
    """Implements AttitudeFilter, see attitude_estimator.

    Args:
        model: that is believed; the platform's pose does not matter to how it moves.
        joints: that turn the platform, all that there are.
        platform: small motions about any rates.
        found: their coordinates.
        noise: of the gyro.
        settings: what is believed.
        period: one tick [s].
    """

    model: Model
    joints: AttitudeJoints
    platform: RateDependentPlatform
    found: JointCoordinates
    noise: GyroNoise
    settings: AppendageModesSettings
    period: float

    @property
    def channels(self) -> int:
        """How many innovations the gyro gives."""
        return 3

    @cached_property
    def _rest(self) -> Vector:
        return self.model.rest({})

    @cached_property
    def _rotation(self) -> Matrix:
        """From e to the small turn in body axes, shape (3, n)."""
        return np.asarray(np.linalg.pinv(self.joints.axes) @ np.eye(self._joints, self._n))

    @property
    def _n(self) -> int:
        return self.platform.small.coordinates

    @property
    def _joints(self) -> int:
        return self.platform.small.joints

    @cached_property
    def steps(self) -> int:
        """How many steps a tick has: none longer than one radian of the fastest mode."""
        linear = self.platform.small.linear
        highest = float(np.abs(np.linalg.eigvals(linear.state_matrix)).max())
        return max(1, int(np.ceil(highest * self.period)))

    def begin(self, attitude: Vector, reading: Vector, sigmas: tuple[float, float]) -> Any:
        """Return a belief in a rate as the gyro reads it, and straight appendages.

        Args:
            attitude: that is believed, x y z w.
            reading: of the gyro, shape (3,) [rad/s].
            sigmas: standard deviations of attitude [rad] and bias [rad/s].
        """
        n, m, axes = self._n, self._joints, self.joints.axes
        p = np.zeros((2 * n + 3, 2 * n + 3))
        p[:m, :m] = sigmas[0] ** 2 * axes @ axes.T
        p[-3:, -3:] = sigmas[1] ** 2 * np.eye(3)
        read = np.zeros((2 * n + 3, 3))  # of an error of the bias, the error of the rate
        read[n : n + m], read[-3:] = -axes, np.eye(3)
        p[n:, n:] = (sigmas[1] ** 2 * read @ read.T)[n:, n:]
        white = self.noise.white**2 / self.period
        p[n : n + m, n : n + m] += white * axes @ axes.T
        small = self.platform.small.linear
        frequencies = np.sqrt(np.abs(np.diag(small.stiffness) / np.diag(small.mass)))[m:]
        one = np.arange(m, n)
        p[one, one], p[n + one, n + one] = (
            self.settings.initial**2,
            (self.settings.initial * frequencies) ** 2,
        )
        rates = self.found.basis[:, :m] @ (axes @ reading)
        return FlexibleEstimate(attitude, np.zeros(3), p, np.zeros(self.model.modes), rates)

    def propagate(self, estimate: Any, reading: Vector, effort: Vector) -> Correction:
        """Return the belief a tick later, corrected by what the gyro has read of that tick.

        Args:
            estimate: at the start of the tick.
            reading: mean rate over the tick, bias and noise in it, shape (3,) [rad/s].
            effort: that was applied, shape (actuators,).
        """
        h, k = self.period, 2 * self._n
        q = self._rest.copy()
        q[q.size - self.model.modes :] = estimate.modes
        before = np.concatenate((q, estimate.rates))
        after = self.model.advance(before, effort, h, self.steps)
        attitude = self.joints.orientation(self.model.joint_state(after)[0])
        middle = 0.5 * (self.model.joint_state(before)[1] + self.model.joint_state(after)[1])
        a, b = self.platform.state_matrix(middle), self.platform.input_matrix
        f, g = zero_order_hold(a, b, h)
        step, process_noise = block_diag(f, np.eye(3)), np.zeros((k + 3, k + 3))
        process_noise[:k, :k] = self.settings.effort_noise**2 / h * g @ g.T
        process_noise[-3:, -3:] = self.noise.walk**2 * h * np.eye(3)
        angle = rotation_vector(attitude)
        slope = (np.eye(3) + 0.5 * skew(angle)) / h
        jacobian = self._jacobian(slope)
        jacobian[:, k:] = np.eye(3)
        # of the error before the tick: one of the attitude turns with the craft and does not show.
        # The difference of large covariances would be lost in their last digits
        before = jacobian @ step
        before[:, : self._joints] = 0.0
        white, walk = self.noise
        variance = (white**2 / h + walk**2 * h / 3.0) * np.eye(3)
        p = estimate.covariance
        s = before @ p @ before.T + jacobian @ process_noise @ jacobian.T + variance
        gain = np.linalg.solve(s, before @ p @ step.T + jacobian @ process_noise).T
        left, kept = step - gain @ before, np.eye(k + 3) - gain @ jacobian
        new_covariance = (
            left @ p @ left.T + kept @ process_noise @ kept.T + gain @ variance @ gain.T
        )
        predicted = FlexibleEstimate(
            product(estimate.attitude, attitude), estimate.bias, new_covariance,
            self.model.modal_state(after)[0], self.model.split(after)[1],
        )  # fmt: skip
        return self._apply_innovation(predicted, reading - angle / h - estimate.bias, gain, s)

    def update_attitude(self, estimate: Any, measured: Vector, noise: Matrix) -> Correction:
        """Return the belief after a measured attitude; see correct_by_attitude."""
        off = rotation_vector(product(conjugate(estimate.attitude), measured))
        return self._correct(estimate, off, self._jacobian(np.eye(3)), noise)

    def update_direction(
        self, estimate: Any, measured: Vector, inertial: Vector, sigma: float
    ) -> Correction:
        """Return the belief after a measured direction; see correct_by_direction."""
        seen = to_body(estimate.attitude) @ inertial
        two = cross_axes(seen)
        jacobian = self._jacobian(two @ skew(seen))
        return self._correct(estimate, two @ measured, jacobian, sigma**2 * np.eye(2))

    def initialize_attitude(self, estimate: Any, measured: Vector, noise: Matrix) -> Any:
        """Return the belief in the first measured attitude."""
        m, p = self._joints, estimate.covariance.copy()
        p[:m], p[:, :m] = 0.0, 0.0
        p[:m, :m] = self.joints.axes @ noise @ self.joints.axes.T
        return estimate._replace(attitude=measured, covariance=p)

    def rate(self, estimate: Any, reading: Vector) -> Vector:
        """Return the rate in body axes, shape (3,) [rad/s]."""
        state = np.concatenate((self._rest, estimate.rates))
        return self.joints.rotation_vector_of(self.model.joint_state(state)[1])

    def covariance(self, estimate: Any) -> Matrix:
        """Return that of small turn, bias, body rates, then modes and their rates."""
        n, m = self._n, self._joints
        rotation, others = self._rotation[:, :m], np.eye(n - m)
        rows = block_diag(rotation, others, rotation, others, np.eye(3))
        at = np.split(np.arange(len(rows)), [3, n, n + 3, 2 * n])  # m is 3
        order = np.concatenate((at[0], at[4], at[2], at[1], at[3]))
        p: Matrix = rows @ estimate.covariance @ rows.T
        return p[np.ix_(order, order)]

    def _jacobian(self, by_rotation: Matrix) -> Matrix:
        jacobian = np.zeros((len(by_rotation), 2 * self._n + 3))
        jacobian[:, : self._n] = by_rotation @ self._rotation
        return jacobian

    def _correct(
        self, estimate: FlexibleEstimate, innovation: Vector, jacobian: Matrix, noise: Matrix
    ) -> Correction:
        """Return the belief after an innovation of H times the error, by Joseph's form."""
        p = estimate.covariance
        s = jacobian @ p @ jacobian.T + noise
        gain = np.linalg.solve(s, jacobian @ p).T
        left = np.eye(len(p)) - gain @ jacobian
        new_covariance = left @ p @ left.T + gain @ noise @ gain.T
        return self._apply_innovation(
            estimate._replace(covariance=new_covariance), innovation, gain, s
        )

    def _apply_innovation(
        self, estimate: FlexibleEstimate, innovation: Vector, gain: Any, variance: Matrix
    ) -> Correction:
        """Return a belief moved by an innovation; its covariance is that after it already."""
        n, error = self._n, gain @ innovation
        attitude = product(estimate.attitude, quaternion(self._rotation @ error[:n]))
        after = FlexibleEstimate(
            attitude / np.linalg.norm(attitude),
            estimate.bias + error[2 * n : 2 * n + 3],
            estimate.covariance,
            estimate.modes + self.found.elastic(self.model.modes) @ error[self._joints : n],
            estimate.rates + self.found.basis @ error[n : 2 * n],
        )
        nis = float(innovation @ np.linalg.solve(variance, innovation))
        return Correction(after, innovation, nis)


def flexible_filter(
    model: Model, noise: GyroNoise, settings: AppendageModesSettings, period: float
) -> FlexibleFilter:
    """Return the filter of a craft that three independent joints turn.

    Raises:
        BadInput: other joints turn or move it.
    """
    joints = model.attitude
    if joints is None or len(joints.axes) != 3:
        raise BadInput(
            "give the craft three joints that turn it, and no others, or leave it out",
            key="attitude.modes",
            value=", ".join(model.joint_names),
        )
    rest = model.rest({})
    platform = rate_dependent_platform(model, rest)
    assert platform is not None
    found = joint_coordinates(model, rest)
    return FlexibleFilter(model, joints, platform, found, noise, settings, period)
