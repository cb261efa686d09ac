"""The multiplicative extended Kalman filter of a flexible craft: attitude, bias, rates and modes.

What is believed moves by the craft's own equations under the efforts that were applied; the gyro
is a sensor of the mean rate over a tick, as the attitude turned by. The error is
[e, v, b]: e the small turn along the joints, then modes; v that of their rates; b of the bias. It
follows A(w) about the rates that are believed (see turning_platform), exactly for held efforts.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag

from flexslew_control.estimators.attitude_filter import Correction, GyroNoise, across
from flexslew_control.free_platform import Independent, independent
from flexslew_control.turning_platform import TurningPlatform, turning_platform
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


class FlexibleBelief(NamedTuple):
    """An attitude, how the craft moves and bends, a bias, and how far off they may be."""

    attitude: Vector  # unit quaternion from body to inertial axes, x y z w, shape (4,)
    bias: Vector  # of the gyro, shape (3,) [rad/s]
    covariance: Matrix  # of [e, v, b], shape (2 n + 3, 2 n + 3)
    modes: Vector  # modal coordinates, shape (modes,)
    rates: Vector  # v of the model, shape (coordinates,)


@dataclass(frozen=True)
class FlexibleFilter:
    """Implements TurnFilter, see attitude_estimator.

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
    platform: TurningPlatform
    found: Independent
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
    def _turn(self) -> Matrix:
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
        fastest = float(np.abs(np.linalg.eigvals(linear.state_matrix)).max())
        return max(1, int(np.ceil(fastest * self.period)))

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
        own = np.sqrt(np.abs(np.diag(small.stiffness) / np.diag(small.mass)))[m:]
        one = np.arange(m, n)
        p[one, one], p[n + one, n + one] = (
            self.settings.initial**2,
            (self.settings.initial * own) ** 2,
        )
        rates = self.found.basis[:, :m] @ (axes @ reading)
        return FlexibleBelief(attitude, np.zeros(3), p, np.zeros(self.model.modes), rates)

    def carried(self, belief: Any, reading: Vector, effort: Vector) -> Correction:
        """Return the belief a tick later, corrected by what the gyro has read of that tick.

        Args:
            belief: at the start of the tick.
            reading: mean rate over the tick, bias and noise in it, shape (3,) [rad/s].
            effort: that was applied, shape (actuators,).
        """
        h, k = self.period, 2 * self._n
        q = self._rest.copy()
        q[q.size - self.model.modes :] = belief.modes
        before = np.concatenate((q, belief.rates))
        after = self.model.advance(before, effort, h, self.steps)
        turned = self.joints.orientation(self.model.joint_state(after)[0])
        middle = 0.5 * (self.model.joint_state(before)[1] + self.model.joint_state(after)[1])
        a, b = self.platform.state_matrix(middle), self.platform.input_matrix
        f, g = zero_order_hold(a, b, h)
        step, pushed = block_diag(f, np.eye(3)), np.zeros((k + 3, k + 3))
        pushed[:k, :k] = self.settings.effort_noise**2 / h * g @ g.T
        pushed[-3:, -3:] = self.noise.walk**2 * h * np.eye(3)
        angle = rotation_vector(turned)
        slope = (np.eye(3) + 0.5 * skew(angle)) / h
        shows = self._shown(slope)
        shows[:, k:] = np.eye(3)
        # of the error before the tick: one of the attitude turns with the craft and does not show.
        # The difference of large covariances would be lost in their last digits
        before = shows @ step
        before[:, : self._joints] = 0.0
        white, walk = self.noise
        variance = (white**2 / h + walk**2 * h / 3.0) * np.eye(3)
        p = belief.covariance
        s = before @ p @ before.T + shows @ pushed @ shows.T + variance
        gain = np.linalg.solve(s, before @ p @ step.T + shows @ pushed).T
        left, kept = step - gain @ before, np.eye(k + 3) - gain @ shows
        narrowed = left @ p @ left.T + kept @ pushed @ kept.T + gain @ variance @ gain.T
        moved = FlexibleBelief(
            product(belief.attitude, turned), belief.bias, narrowed,
            self.model.modal_state(after)[0], self.model.split(after)[1],
        )  # fmt: skip
        return self._told(moved, reading - angle / h - belief.bias, gain, s)

    def told_attitude(self, belief: Any, measured: Vector, noise: Matrix) -> Correction:
        """Return the belief after a measured attitude; see corrected_by_attitude."""
        off = rotation_vector(product(conjugate(belief.attitude), measured))
        return self._corrected(belief, off, self._shown(np.eye(3)), noise)

    def told_direction(
        self, belief: Any, measured: Vector, inertial: Vector, sigma: float
    ) -> Correction:
        """Return the belief after a measured direction; see corrected_by_direction."""
        seen = to_body(belief.attitude) @ inertial
        two = across(seen)
        shows = self._shown(two @ skew(seen))
        return self._corrected(belief, two @ measured, shows, sigma**2 * np.eye(2))

    def first_told(self, belief: Any, measured: Vector, noise: Matrix) -> Any:
        """Return the belief in the first measured attitude."""
        m, p = self._joints, belief.covariance.copy()
        p[:m], p[:, :m] = 0.0, 0.0
        p[:m, :m] = self.joints.axes @ noise @ self.joints.axes.T
        return belief._replace(attitude=measured, covariance=p)

    def rate(self, belief: Any, reading: Vector) -> Vector:
        """Return the rate in body axes, shape (3,) [rad/s]."""
        state = np.concatenate((self._rest, belief.rates))
        return self.joints.turn_of(self.model.joint_state(state)[1])

    def covariance(self, belief: Any) -> Matrix:
        """Return that of small turn, bias, body rates, then modes and their rates."""
        n, m = self._n, self._joints
        turn, others = self._turn[:, :m], np.eye(n - m)
        rows = block_diag(turn, others, turn, others, np.eye(3))
        at = np.split(np.arange(len(rows)), [3, n, n + 3, 2 * n])  # m is 3
        order = np.concatenate((at[0], at[4], at[2], at[1], at[3]))
        p: Matrix = rows @ belief.covariance @ rows.T
        return p[np.ix_(order, order)]

    def _shown(self, of_turn: Matrix) -> Matrix:
        shows = np.zeros((len(of_turn), 2 * self._n + 3))
        shows[:, : self._n] = of_turn @ self._turn
        return shows

    def _corrected(
        self, belief: FlexibleBelief, innovation: Vector, shows: Matrix, noise: Matrix
    ) -> Correction:
        """Return the belief after an innovation of H times the error, by Joseph's form."""
        p = belief.covariance
        s = shows @ p @ shows.T + noise
        gain = np.linalg.solve(s, shows @ p).T
        left = np.eye(len(p)) - gain @ shows
        narrowed = left @ p @ left.T + gain @ noise @ gain.T
        return self._told(belief._replace(covariance=narrowed), innovation, gain, s)

    def _told(
        self, belief: FlexibleBelief, innovation: Vector, gain: Any, variance: Matrix
    ) -> Correction:
        """Return a belief moved by an innovation; its covariance is that after it already."""
        n, error = self._n, gain @ innovation
        turned = product(belief.attitude, quaternion(self._turn @ error[:n]))
        after = FlexibleBelief(
            turned / np.linalg.norm(turned),
            belief.bias + error[2 * n : 2 * n + 3],
            belief.covariance,
            belief.modes + self.found.elastic(self.model.modes) @ error[self._joints : n],
            belief.rates + self.found.basis @ error[n : 2 * n],
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
    platform = turning_platform(model, rest)
    assert platform is not None
    found = independent(model, rest)
    return FlexibleFilter(model, joints, platform, found, noise, settings, period)
