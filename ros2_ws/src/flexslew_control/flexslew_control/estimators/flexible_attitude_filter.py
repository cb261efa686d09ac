"""The multiplicative extended Kalman filter of a flexible craft: attitude, bias, rates and modes.

The estimate moves by the craft's own equations under the efforts that were applied; the gyro is a
sensor of the mean rate over a tick, as the attitude turned by. The error [e, b, v] has e, the small
turn along the joints, then modes; v that of their rates; b of the bias. It follows A(w) about the
estimated rates (see rate_dependent_platform), exactly for held efforts.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import block_diag, matrix_balance

from flexslew_control.estimators.attitude_filter import Correction, GyroNoise, copied
from flexslew_control.estimators.attitude_steps import MODES, AttitudeEstimate, ErrorMap
from flexslew_control.estimators.flexible_attitude_steps import FlexibleNumbers, begin, carry
from flexslew_control.linear.free_platform import JointCoordinates, joint_coordinates
from flexslew_control.linear.rate_dependent_platform import (
    RateDependentPlatform,
    rate_dependent_platform,
)
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds.model import Model
from flexslew_plant.testbeds.orientation.attitude import AttitudeJoints

_SLEW_RATE = 0.1  # rates of the joints for which equations are balanced [rad/s]


@section
class AppendageModesSettings:
    """The `modes` section of `attitude`: the craft's own equations carry what is believed."""

    model: dict[str, Any] | None = None  # keys of the testbed that the filter believes otherwise
    effort_noise: Positive = 1e-3  # density of noise on each effort [N m sqrt(s)]
    initial: NonNegative = 1e-3  # standard deviation of each deflection at the start [m]


@dataclass(frozen=True)
class FlexibleFilter:
    """A filter of attitude, bias, rates and modes, with the methods of a RigidFilter.

    Args:
        model: of the estimate; the platform's pose does not matter to how it moves.
        joints: that turn the platform, all that there are.
        platform: small motions about any rates.
        found: their coordinates.
        noise: of the gyro.
        settings: noises of the model.
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

    @property
    def errors(self) -> ErrorMap:
        """The errors of the estimate."""
        return ErrorMap(self.numbers.axes, self.numbers.inverse, self.numbers.motion)

    @cached_property
    def steps(self) -> int:
        """How many steps a tick has: none longer than one radian of the fastest mode."""
        linear = self.platform.small.linear
        highest = float(np.abs(np.linalg.eigvals(linear.state_matrix)).max())
        return max(1, int(np.ceil(highest * self.period)))

    @cached_property
    def numbers(self) -> FlexibleNumbers:
        """The constants of its steps, with no errors at the start."""
        model, found, small = self.model, self.found, self.platform.small
        n, m, modes, basis = small.coordinates, small.joints, model.modes, found.basis
        motion = np.zeros((modes + model.coordinates, 2 * n + 3))
        motion[:modes, m + 3 : n + 3], motion[modes:, n + 3 :] = found.elastic(modes), basis
        (white, walk), period = self.noise, self.period
        deviation = np.sqrt(white**2 / period + walk**2 * period / 3.0)
        return FlexibleNumbers(
            np.array(model.packed),
            model.rest({}),
            np.array(self.joints.axes, dtype=np.float64),
            np.array(self.joints.rotation_vector_of(np.eye(m)).T, order="C"),
            basis[:, :m] @ self.joints.axes,
            self.joints.rotation_vector_of(found.outputs.T).T.copy(),
            motion,
            np.zeros((2 * n + 3, 2 * n + 3)),
            *self._generators(),
            np.array([
                self.settings.effort_noise / np.sqrt(period), deviation, walk * np.sqrt(period)
            ]),
        )  # fmt: skip

    def _generators(self) -> tuple[Matrix, Vector]:
        """Return generators and scale of FlexibleNumbers; the scale is of powers of two."""
        p, (k, efforts) = self.platform, self.platform.input_matrix.shape
        found = np.zeros((10, k, k + efforts))
        found[:4, :, :k] = [p.small.linear.state_matrix, *p.linear]
        pairs = [(i, j) for i in range(3) for j in range(i, 3)]
        found[4:, :, :k] = [(1.0 if i == j else 2.0) * p.quadratic[i, j] for i, j in pairs]
        found[0, :, k:] = p.input_matrix
        found *= self.period
        weights = [1.0, *[_SLEW_RATE] * 3, *[_SLEW_RATE**2] * 6]
        typical = np.tensordot(weights, np.abs(found), axes=1)
        _, (scale, _) = matrix_balance(typical[:, :k], permute=False, separate=True)
        columns = np.abs(found[0, :, k:] / scale[:, None]).sum(axis=0)
        factors = np.concatenate((scale, 0.25 * 0.5 ** np.frexp(columns)[1]))
        return (found * factors / scale[:, None]).reshape(10, -1), factors

    def first_covariance(self, sigmas: tuple[float, float]) -> Matrix:
        """Return the covariance of the errors at the start.

        Args:
            sigmas: standard deviations of attitude [rad] and bias [rad/s].
        """
        small, axes, initial = self.platform.small, self.joints.axes, self.settings.initial
        n, m = small.coordinates, small.joints
        p = np.zeros((2 * n + 3, 2 * n + 3))
        read = np.zeros((2 * n + 3, 3))  # of an error of the bias, the error of the rate
        rates = slice(n + 3, n + 3 + m)
        read[3:6], read[rates] = np.eye(3), -axes
        p[:] = sigmas[1] ** 2 * read @ read.T
        p[:m, :m] = sigmas[0] ** 2 * axes @ axes.T
        p[rates, rates] += self.noise.white**2 / self.period * axes @ axes.T
        linear = small.linear
        frequencies = np.sqrt(np.abs(np.diag(linear.stiffness) / np.diag(linear.mass)))[m:]
        one = np.arange(m + 3, n + 3)
        p[one, one], p[n + one, n + one] = initial**2, (initial * frequencies) ** 2
        return p

    def begin(
        self, attitude: Vector, reading: Vector, sigmas: tuple[float, float]
    ) -> AttitudeEstimate:
        """Return the estimate of an attitude, a rate as the gyro reads it, straight appendages.

        Args:
            attitude: quaternion x y z w.
            reading: of the gyro, shape (3,) [rad/s].
            sigmas: standard deviations of attitude [rad] and bias [rad/s].
        """
        numbers = self.numbers._replace(first=self.first_covariance(sigmas))
        state = np.empty(MODES + len(numbers.motion))
        estimate = AttitudeEstimate(state, np.empty_like(numbers.first))
        q = attitude
        begin(numbers, (q[0], q[1], q[2], q[3]), reading, estimate)
        return estimate

    def propagate(self, estimate: AttitudeEstimate, reading: Vector, effort: Vector) -> Correction:
        """Return the estimate a tick later, corrected by the gyro's reading of that tick.

        Args:
            estimate: at the start of the tick.
            reading: mean rate over the tick, bias and noise in it, shape (3,) [rad/s].
            effort: that was applied, shape (actuators,).
        """
        model, numbers, after, innovation = self.model, self.numbers, copied(estimate), np.empty(3)
        before = np.concatenate((numbers.rest, estimate.state[MODES + model.modes :]))
        model.modal_state(before)[0][:] = estimate.state[MODES : MODES + model.modes]
        end = model.advance(before, effort, self.period, self.steps)
        (_, rate), (position, end_rate) = model.joint_state(before), model.joint_state(end)
        motion = np.concatenate((model.modal_state(end)[0], model.split(end)[1]))
        q, middle = self.joints.orientation(position), 0.5 * (rate + end_rate)
        given = motion, (q[0], q[1], q[2], q[3]), middle, reading, self.period, innovation
        return Correction(after, innovation, carry(numbers, after, *given))

    def rate(self, estimate: AttitudeEstimate, reading: Vector) -> Vector:
        """Return the rate in body axes, shape (3,) [rad/s]."""
        rate: Vector = self.numbers.rate @ estimate.state[MODES + self.model.modes :]
        return rate

    def covariance(self, estimate: AttitudeEstimate) -> Matrix:
        """Return that of small turn, bias, body rates, then modes and their rates."""
        n, rotation = self.platform.small.coordinates, self.numbers.inverse
        others = np.eye(n - 3)
        rows = block_diag(rotation, np.eye(3), others, rotation, others)
        at = np.split(np.arange(len(rows)), [6, n + 3, n + 6])
        order = np.concatenate((at[0], at[2], at[1], at[3]))
        p: Matrix = rows @ estimate.covariance @ rows.T
        return p[np.ix_(order, order)]


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
