"""The Kalman filter: linear or with non-linear prediction, with disturbances among its states."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from scipy.linalg import LinAlgError, expm, solve_continuous_are

from flexslew_control.law import Estimate
from flexslew_control.linear_design import output_matrix, require_observable, state_names
from flexslew_plant.arrays import Matrix, Vector, compiled
from flexslew_plant.bench.measurement import Measurement
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds.model import Model


@section
class FilterSettings:
    """The `filter` section of a law whose estimator is a KalmanFilter."""

    prediction: Literal["linear", "nonlinear"] = "nonlinear"
    angle_sigma: Positive = 1e-4  # of the joint encoders [rad or m]
    rate_sigma: Positive = 1e-3  # of the joint rate sensors [rad/s or m/s]
    tip_sigma: Positive | None = None  # of the tip sensor [m]; null: it is not used
    disturbance_walk: NonNegative = 10.0  # random walk of each joint's disturbance [N m/sqrt(s)]
    effort_noise: NonNegative = 0.0  # white, density of each effort [(N m)^2 s]
    modal_noise: NonNegative = 0.0  # white, density of each modal force [N^2 s]
    initial_deflection: NonNegative = 0.01  # sigma of each modal coordinate at a reset [m]
    initial_disturbance: NonNegative = 10.0  # sigma of each disturbance at a reset [N m]


def continuous_gain(a: Matrix, c: Matrix, noise: Matrix, r: Matrix) -> tuple[Matrix, Matrix]:
    """Return K_f = P C^T R^-1 and P of the stationary Kalman-Bucy filter (papers/002, (6), (7)).

    0 = A P + P A^T + L Q L^T - P C^T R^-1 C P.

    Args:
        a: shape (k, k).
        c: shape (l, k).
        noise: L Q L^T, shape (k, k).
        r: spectral density of the sensor noise, variance times sampling period, shape (l, l).

    Raises:
        BadInput: the equation has no stabilising solution.
    """
    try:
        p = solve_continuous_are(a.T, c.T, noise, r)
    except (LinAlgError, ValueError) as error:
        raise BadInput(
            f"no stationary Kalman filter: {error}; give every mode some process noise"
        ) from None
    gain = np.linalg.solve(r, c @ p).T
    return np.asarray(gain, dtype=np.float64), np.asarray(p, dtype=np.float64)


def discretised(a: Matrix, b: Matrix, noise: Matrix, dt: float) -> tuple[Matrix, Matrix, Matrix]:
    """Return F, G and Q of x+ = F x + G u + w, exact for a held u (Van Loan).

    Args:
        a, b: of x' = A x + B u, shapes (k, k), (k, m).
        noise: spectral density of the white noise on x', shape (k, k).
        dt: [s].
    """
    k, m = b.shape
    held = np.zeros((k + m, k + m))
    held[:k, :k], held[:k, k:] = a, b
    both = expm(held * dt)
    pair = np.zeros((2 * k, 2 * k))
    pair[:k, :k], pair[:k, k:], pair[k:, k:] = -a, noise, a.T
    van_loan = expm(pair * dt)
    q = van_loan[k:, k:].T @ van_loan[:k, k:]
    return both[:k, :k], both[:k, k:], 0.5 * (q + q.T)


@compiled
def predicted_covariance(
    dx: Matrix, du: Matrix, covariance: Matrix, noise: Matrix, dt: float
) -> Matrix:
    """Return F P F^T + Q with F = I + J dt + (J dt)^2 / 2 and J = [[df/dx, df/du], [0, 0]].

    Args:
        dx: df/dx, shape (2 n, 2 n).
        du: df/dd, the efforts' columns, as disturbances add to the efforts, shape (2 n, d).
        covariance: P, shape (2 n + d, 2 n + d).
        noise: Q of one tick, same shape.
        dt: one tick [s].
    """
    k, d = du.shape
    j = np.zeros((k + d, k + d))
    j[:k, :k] = dx * dt
    j[:k, k:] = du * dt
    f = np.eye(k + d) + j + 0.5 * (j @ j)
    return f @ covariance @ f.T + noise


@compiled
def corrected(
    x: Vector, covariance: Matrix, y: Vector, c: Matrix, r: Vector
) -> tuple[Vector, Matrix, Vector, float]:
    """Return x and P after the measurement, the innovation y - C x, and its NIS.

    One scalar output after the other, which is exact as the sensors' noises are independent;
    the squares of the scalar innovations over their variances add up to e^T S^-1 e.

    Args:
        x: predicted state, shape (k,).
        covariance: P, shape (k, k).
        y: outputs, shape (l,).
        c: shape (l, k).
        r: variances of the sensors, shape (l,).
    """
    x, p = x.copy(), covariance.copy()
    k = x.size
    innovation = y - c @ x
    nis = 0.0
    for i in range(y.size):
        gain = p @ c[i]
        s = r[i] + c[i] @ gain
        e = y[i] - c[i] @ x
        nis += e * e / s
        for a in range(k):
            x[a] += gain[a] * e / s
            for b in range(k):
                p[a, b] -= gain[a] * gain[b] / s
    return x, 0.5 * (p + p.T), innovation, nis


@dataclass
class KalmanFilter:
    """The estimator of [q, v, d], d the disturbance of each effort.

    Prediction: x+ = the model advanced by one tick with effort + d (nonlinear), or the exact
    zero-order hold of its linearisation (linear); d is a random walk. A measurement that comes
    again (same tick) gets the same estimate.

    Args:
        model: equations of motion.
        rest: q about which `linear` is linear, shape (n,).
        settings: noises and kind of prediction.
        period: one tick [s].
    """

    model: Model
    rest: Vector
    settings: FilterSettings
    period: float
    _x: Vector = field(init=False)
    _p: Matrix = field(init=False)
    _tick: int = field(init=False, default=-1)
    _last: Estimate = field(init=False)

    def __post_init__(self) -> None:
        """Precompute the constant matrices.

        Raises:
            BadInput: a mode or a disturbance does not show in the outputs.
        """
        model, s = self.model, self.settings
        n, m = model.coordinates, model.joints
        linear = model.linearise(self.rest)
        a, b = linear.state_matrix, linear.state_input_matrix
        whole = np.zeros((2 * n + m, 2 * n + m))
        whole[: 2 * n, : 2 * n], whole[: 2 * n, 2 * n :] = a, b
        self._c = np.hstack((output_matrix(model, s.tip_sigma is not None), _zeros(model, s)))
        names = (*state_names(model), *(f"disturbance of {name}" for name in model.joint_names))
        require_observable(whole, self._c, names)
        sigmas = [s.angle_sigma] * m + [s.rate_sigma] * m
        sigmas += [] if s.tip_sigma is None else [s.tip_sigma]
        self._r = np.square(np.array(sigmas))
        forces = np.linalg.solve(linear.mass, np.eye(n))
        density = np.diag([s.effort_noise] * m + [s.modal_noise] * (n - m))
        noise = np.zeros_like(whole)
        noise[n : 2 * n, n : 2 * n] = forces @ density @ forces.T
        noise[2 * n :, 2 * n :] = s.disturbance_walk**2 * np.eye(m)
        inputs = np.vstack((b, np.zeros((m, m))))
        self._f, self._g, self._q = discretised(whole, inputs, noise, self.period)
        self._origin = np.concatenate((self.rest, np.zeros(n + m)))
        first = [s.angle_sigma] * m + [s.initial_deflection] * (n - m)
        first += [s.rate_sigma] * m + [s.initial_deflection] * (n - m)
        self._p0 = np.diag(np.square(np.array(first + [s.initial_disturbance] * m)))

    def reset(self, measurement: Measurement) -> None:
        """Start from the measured joints, straight appendages and no disturbance."""
        n, m = self.model.coordinates, self.model.joints
        self._x = np.zeros(2 * n + m)
        self._x[:m] = measurement.joint_position
        self._x[n : n + m] = measurement.joint_velocity
        self._p = self._p0.copy()
        self._tick = measurement.tick
        self._last = self._estimate(np.zeros(len(self._c)), 0.0)

    def update(self, measurement: Measurement) -> Estimate:
        """Return the estimate at this tick, with innovation, covariance of [q, v, d] and NIS."""
        if measurement.tick == self._tick:
            return self._last
        x, p = self._predicted(measurement.applied_effort)
        y = outputs(measurement, len(self._c))
        self._x, self._p, innovation, nis = corrected(x, p, y, self._c, self._r)
        self._tick = measurement.tick
        self._last = self._estimate(innovation, nis)
        return self._last

    def _predicted(self, effort: Vector) -> tuple[Vector, Matrix]:
        if self.settings.prediction == "linear":
            x = self._origin + self._f @ (self._x - self._origin) + self._g @ effort
            return x, self._f @ self._p @ self._f.T + self._q
        k = 2 * self.model.coordinates
        state, d = self._x[:k], self._x[k:]
        total = effort + d
        dx, du = self.model.jacobian(state, total)
        p = predicted_covariance(dx, du, self._p, self._q, self.period)
        return np.concatenate((self.model.advance(state, total, self.period), d)), p

    def _estimate(self, innovation: Vector, nis: float) -> Estimate:
        n = self.model.coordinates
        x = self._x
        return Estimate(x[:n], x[n : 2 * n], x[2 * n :], self._p, innovation, nis)


def outputs(measurement: Measurement, count: int) -> Vector:
    """Return y: joint positions, joint rates and, where `count` asks for it, the first tip."""
    m = measurement.joint_position.size
    joints = (measurement.joint_position, measurement.joint_velocity)
    return np.concatenate((*joints, measurement.tip_deflection[: count - 2 * m]))


def _zeros(model: Model, settings: FilterSettings) -> Matrix:
    """Return the columns of C for the disturbances, which no sensor shows directly."""
    return np.zeros((2 * model.joints + (settings.tip_sigma is not None), model.joints))
