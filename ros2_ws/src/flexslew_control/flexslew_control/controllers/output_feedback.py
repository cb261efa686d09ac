"""Output feedback control: sliding surfaces, observer and elastic reference (Sung and Joo).

Modes:
    tracking_a  the non-linear model stands in the law and in the observer;
    tracking_b  the linear model at the set point, D = 0;
    rigid_hold  as tracking_a, with the reference's deflection set to zero.
"""

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from scipy.linalg import expm

from flexslew_control.controllers.sliding_surface import LinearSystem, SlidingDesign, design
from flexslew_control.estimators.kalman import outputs
from flexslew_control.law import Estimate, PlantDescription, Reference, nominal_state
from flexslew_control.linear_design import output_matrix, require_stable, set_point_of, state_names
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.bench.measurement import Measurement
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds.model import Model


@section
class OutputFeedback:
    """The settings of controller `output_feedback`."""

    mode: Literal["tracking_a", "tracking_b", "rigid_hold"] = "tracking_a"
    model: dict[str, Any] | None = None  # what it believes of the testbed; null: one mode
    set_point: dict[str, float] | None = None  # mid-slew [rad]; null: half of the testbed's own
    reaching_rate: Positive = 2.0  # nu [1/s]
    weight_frequency: Positive = 0.3  # omega_r, of the joints in Q_s [rad/s]
    attitude_gain: NonNegative = 0.0  # kappa of (51) [1/s]
    effort_noise: Positive = 0.1  # density of each effort in L Q L^T [(N m)^2 s]
    modal_noise: Positive = 0.00025  # density of each force on M_qq q'' alone [N^2 s]
    angle_sigma: Positive = 1e-4  # [rad or m]
    rate_sigma: Positive = 1e-4  # [rad/s or m/s]
    tip_sigma: Positive | None = None  # of the tip sensor [m]; null: it is not used


@dataclass
class SampledObserver:
    """z_hat' = f(z_hat, u) + K_f (y - C z_hat) (5), with y and the applied u held over each tick.

    The linear one is the exact zero-order hold of A - K_f C, the non-linear one a step of RK4.
    The estimate at tick k rests on the measurements before k; the law adds K_f y(k) itself.

    Args:
        model: equations of motion.
        system: its linearisation at the rest z0, shape (2 n,).
        origin: z0.
        found: K_f and P.
        linear: whether f(z, u) is A (z - z0) + B u.
        period: one tick [s].
    """

    model: Model
    system: LinearSystem
    origin: Vector
    found: SlidingDesign
    linear: bool
    period: float
    _z: Vector = field(init=False)
    _y: Vector = field(init=False)
    _tick: int = field(init=False, default=-1)
    _last: Estimate = field(init=False)

    def __post_init__(self) -> None:
        """Precompute the step and the inverse of the innovation's covariance."""
        s, gain = self.system, self.found.observer_gain
        k, held = len(s.a), np.hstack((s.b, gain))
        both = np.zeros((k + held.shape[1], k + held.shape[1]))
        both[:k, :k], both[:k, k:] = s.a - gain @ s.c, held
        self._step: Matrix = np.ascontiguousarray(expm(both * self.period)[:k])
        variance = s.c @ self.found.covariance @ s.c.T + s.sensor_density / self.period
        self._inverse = np.linalg.inv(variance)
        self._feedback: Matrix = gain @ s.c
        self._covariance = self.found.covariance.copy()
        self._covariance.flags.writeable = False

    def reset(self, measurement: Measurement) -> None:
        """Start at the measured joints with straight appendages at rest."""
        n, m = self.model.coordinates, self.model.joints
        self._z = np.zeros(2 * n)
        self._z[:m] = measurement.joint_position
        self._z[n : n + m] = measurement.joint_velocity
        self._tick = measurement.tick
        self._take(measurement)

    def update(self, measurement: Measurement) -> Estimate:
        """Return the estimate at this tick; the same again for a measurement that is repeated."""
        if measurement.tick != self._tick:
            self._z = self._advanced(measurement.applied_effort)
            self._tick = measurement.tick
            self._take(measurement)
        return self._last

    def _take(self, measurement: Measurement) -> None:
        self._y = outputs(measurement, len(self.system.c))
        n, e = self.model.coordinates, self._y - self.system.c @ self._z
        nis = float(e @ self._inverse @ e)
        z = self._z
        self._last = Estimate(z[:n], z[n:], np.zeros(0), self._covariance, e, nis)

    def _advanced(self, effort: Vector) -> Vector:
        z, h = self._z, self.period
        if self.linear:
            y = self._y - self.system.c @ self.origin
            return self.origin + self._step @ np.concatenate((z - self.origin, effort, y))
        held, derivative, feedback = (
            self.found.observer_gain @ self._y,
            self.model.derivative,
            self._feedback,
        )
        k1 = derivative(z, effort) + (held - feedback @ z)
        at = z + 0.5 * h * k1
        k2 = derivative(at, effort) + (held - feedback @ at)
        at = z + 0.5 * h * k2
        k3 = derivative(at, effort) + (held - feedback @ at)
        at = z + h * k3
        k4 = derivative(at, effort) + (held - feedback @ at)
        return z + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)


@dataclass
class SlidingLaw:
    """u = -(G B)^-1 {G [f(z_hat, 0) + K_f e - z*'] + nu G (z_hat - z*) + kappa G z_re} (51).

    e = y - C z_hat. f(z, 0) = A z + D, and B is that at z_hat (tracking (a)) or at the set point
    with D = 0 (tracking (b)). z*' is the mean of the reference's derivative over the coming tick.

    Args:
        model, system, origin, found, linear, period: as in SampledObserver.
        elastic: False holds the appendages straight (z* with q* = 0).
        attitude_gain: kappa, on the joints' rows of z_hat - z* [1/s].
    """

    model: Model
    system: LinearSystem
    origin: Vector
    found: SlidingDesign
    linear: bool
    period: float
    elastic: bool = True
    attitude_gain: float = 0.0
    terms: dict[str, Vector] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        """Precompute what does not change."""
        n, m = self.model.coordinates, self.model.joints
        self._joint_rows = np.tile(np.arange(n) < m, 2)
        self._no_effort = np.zeros(m)
        nu, kappa = self.found.reaching_rate, self.attitude_gain
        # nu G + kappa G on the joints' columns alone
        self._reaching = self.found.surface * (nu + kappa * self._joint_rows)
        self._innovation_gain = self.found.surface @ self.found.observer_gain
        self._inverse = np.linalg.inv(self.found.surface @ self.system.b)

    def reset(
        self, measurement: Measurement, estimate: Estimate, reference: Reference, effort: Vector
    ) -> None:
        """Nothing to choose: the law has no state of its own."""

    def update(self, measurement: Measurement, estimate: Estimate, reference: Reference) -> Vector:
        """Return the joint efforts, shape (joints,) [N m or N]."""
        z = np.concatenate((estimate.position, estimate.velocity))
        nominal, slope = self._wanted(reference)
        surface = self.found.surface
        if self.linear:
            drift, inverse = self.system.a @ (z - self.origin), self._inverse
        else:
            drift = self.model.derivative(z, self._no_effort)
            inverse = np.linalg.inv(surface @ self.model.jacobian(z, self._no_effort)[1])
        feedforward = inverse @ (surface @ slope)
        equivalent = -inverse @ (surface @ drift)
        innovation = -inverse @ (self._innovation_gain @ estimate.innovation)
        reaching = -inverse @ (self._reaching @ (z - nominal))
        self.terms = {
            "feedforward": feedforward,
            "equivalent": equivalent,
            "innovation": innovation,
            "reaching": reaching,
        }
        return feedforward + equivalent + innovation + reaching

    def _wanted(self, reference: Reference) -> tuple[Vector, Vector]:
        """Return z* and z*', each of shape (2 n,)."""
        m, modes = self.model.joints, self.model.modes
        now = nominal_state(reference.state, reference, m, modes)
        if reference.next_state.size:
            later = nominal_state(reference.next_state, reference, m, modes)
            slope = (later - now) / self.period
        else:
            slope = self.model.derivative(now, reference.effort)
        if self.elastic:
            return now, slope
        return now * self._joint_rows, slope * self._joint_rows


def testbed_system(
    model: Model, rest: Vector, settings: OutputFeedback, period: float
) -> LinearSystem:
    """Return the linearisation at the rest q with the noises of the settings.

    Its efforts disturb as the torques do; each mode is disturbed by a force on M_qq q'' alone.
    """
    linear = model.linearise(rest)
    n, m = model.coordinates, model.joints
    modal = np.zeros((2 * n, n - m))
    modal[n + m :] = np.linalg.inv(linear.mass[m:, m:])
    b, tip = linear.state_input_matrix, settings.tip_sigma
    sigmas = [settings.angle_sigma] * m + [settings.rate_sigma] * m + ([] if tip is None else [tip])
    return LinearSystem(
        linear.state_matrix,
        b,
        output_matrix(model, tip is not None),
        np.hstack((b, modal)),
        np.diag([settings.effort_noise] * m + [settings.modal_noise] * (n - m)),
        np.diag(np.square(sigmas)) * period,
        state_names(model),
    )


def testbed_weight(model: Model, rest: Vector, settings: OutputFeedback) -> Matrix:
    """Return Q_s = diag(M_jj omega_r^2, K_qq, M_jj, M_qq), an energy, shape (2 n, 2 n)."""
    linear = model.linearise(rest)
    mass, stiffness = np.diag(linear.mass), np.diag(linear.stiffness).copy()
    m = model.joints
    stiffness[:m] = mass[:m] * settings.weight_frequency**2
    return np.diag(np.concatenate((stiffness, mass)))


def build(settings: OutputFeedback, plant: PlantDescription) -> tuple[SampledObserver, SlidingLaw]:
    """Return the observer and the law; the drive limits the effort.

    Raises:
        BadInput: the model is not controllable or observable at the set point, or the weights
            or noises give no stable design.
    """
    model = plant.believed(settings.model)
    rest = set_point_of(plant, model, settings.set_point, 0.5)
    system = testbed_system(model, rest, settings, plant.period)
    found = design(system, testbed_weight(model, rest, settings), settings.reaching_rate)
    require_stable(system.a - found.observer_gain @ system.c, system.names, "the observer")
    origin = np.concatenate((rest, np.zeros(model.coordinates)))
    linear = settings.mode == "tracking_b"
    observer = SampledObserver(model, system, origin, found, linear, plant.period)
    elastic = settings.mode != "rigid_hold"
    kappa = settings.attitude_gain
    law = SlidingLaw(model, system, origin, found, linear, plant.period, elastic, kappa)
    return observer, law
