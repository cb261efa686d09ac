"""The Kalman filter: linear or with non-linear prediction, with disturbances among its states."""

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, expm

from flexslew_control.estimators.later_covariance import later_covariance
from flexslew_control.estimators.prediction import (
    error_transition,
    first_state,
    innovation_variance,
    kalman_prediction,
    measurement_update,
)
from flexslew_control.law import Estimate
from flexslew_control.linear.design_checks import (
    LinearDesignModel,
    output_matrix,
    require_observable,
    state_names,
)
from flexslew_control.linear.riccati import continuous_riccati, discrete_riccati
from flexslew_control.linear.zero_order_hold import zero_order_hold
from flexslew_plant.arrays import EMPTY, Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds.model import Model


@section
class FilterSettings:
    """The `filter` section of a law with a KalmanFilter as its estimator."""

    # model of the prediction: nonlinear, or linear where the equations of motion are linear
    prediction: Literal["linear", "nonlinear"] = "nonlinear"
    angle_sigma: Positive = 1e-4  # standard deviation of the joint encoders [rad or m]
    rate_sigma: Positive = 1e-3  # standard deviation of the joint rate sensors [rad/s or m/s]
    tip_sigma: Positive | None = None  # standard deviation of the tip sensor [m]; null: not used
    # random walk of each joint's disturbance [N m/sqrt(s)]; null: 10, of a craft that turns in
    # three axes a tenth of the largest effort limit
    disturbance_walk: NonNegative | None = None
    # density of the white noise on each effort [(N m)^2 s]; null: 0, of a craft that turns in
    # three axes the square of the largest effort limit, of a wheel times that of its share of the
    # craft's inertia
    effort_noise: NonNegative | None = None
    modal_noise: NonNegative = 0.0  # density of the white noise on each modal force [N^2 s]
    # standard deviation of each modal coordinate at a reset [m]
    initial_deflection: NonNegative = 0.01
    # of its rate at a reset [m/s]; null: that of the coordinate per second, which suits modes of
    # about 1 rad/s
    initial_deflection_rate: NonNegative | None = None
    # standard deviation of each disturbance at a reset [N m]
    initial_disturbance: NonNegative = 10.0


_WALK = 10.0  # of a disturbance unless it is given [N m/sqrt(s)]


def continuous_gain(a: Matrix, c: Matrix, noise: Matrix, r: Matrix) -> tuple[Matrix, Matrix]:
    """Return K_f = P C^T R^-1 and P of the stationary Kalman-Bucy filter (Sung and Joo, (6), (7)).

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
        p = continuous_riccati(a.T, c.T, noise, r)
    except LinAlgError as error:
        raise BadInput(
            f"no stationary Kalman filter: {error}; give every mode some process noise"
        ) from None
    gain = np.linalg.solve(r, c @ p).T
    return np.asarray(gain, dtype=np.float64), p


def discrete_model(a: Matrix, b: Matrix, noise: Matrix, dt: float) -> tuple[Matrix, Matrix, Matrix]:
    """Return F, G and Q of x+ = F x + G u + w, exact for a held u.

    Q = int_0^dt exp(A t) N exp(A^T t) dt, by C. Van Loan, Computing integrals involving the matrix
    exponential (1978); neither python-control nor SciPy has it.

    Args:
        a, b: of x' = A x + B u, shapes (k, k), (k, m).
        noise: spectral density of the white noise on x', shape (k, k).
        dt: [s].
    """
    k = len(a)
    pair = np.zeros((2 * k, 2 * k))
    pair[:k, :k], pair[:k, k:], pair[k:, k:] = -a, noise, a.T
    van_loan = expm(pair * dt)
    q = van_loan[k:, k:].T @ van_loan[:k, k:]
    return *zero_order_hold(a, b, dt), 0.5 * (q + q.T)


class FilterMatrices(NamedTuple):
    """The constants of a KalmanFilter of k states with l outputs."""

    f: Matrix  # of one tick about the rest, (k, k)
    g: Matrix  # (k, joints)
    q: Matrix  # noise of one tick, (k, k)
    c: Matrix  # (l, k)
    r: Vector  # variances of the sensors, (l,)
    origin: Vector  # the rest, (k,)
    first: Matrix  # covariance after a reset, (k, k)


@dataclass
class KalmanFilter:
    """The estimator of [q, v, d], d the disturbance of each effort.

    Prediction: x+ = the model advanced by one tick with effort + d (nonlinear), or the exact
    zero-order hold of its linearisation (linear, for linear models alone); d is a random walk.
    A measurement that comes again (same tick) gets the same estimate.

    Args:
        model: equations of motion.
        rest: q about which the noises are turned into accelerations, shape (n,).
        settings: noises and kind of prediction.
        period: one tick [s].
        noise: spectral density of the white noise on [q, v]', shape (2 n, 2 n), of a filter
            without disturbances; None: with them, and with the noises of the settings.
        on_joints: density of further noise on each joint's equation, added to that of the settings.
    """

    model: LinearDesignModel
    rest: Vector
    settings: FilterSettings
    period: float
    noise: Matrix | None = None
    on_joints: float = 0.0
    _x: Vector = field(init=False)
    _p: Matrix = field(init=False)
    _prior: Matrix = field(init=False)  # P before the last measurement
    _tick: int = field(init=False, default=-1)
    _last: Estimate = field(init=False)

    def __post_init__(self) -> None:
        """Precompute the constant matrices.

        Raises:
            BadInput: if a mode or a disturbance does not show in the outputs, a linear prediction
                is demanded of a model that is not linear, or a mode is too fast for a tick.
        """
        model, s = self.model, self.settings
        n, m = model.coordinates, model.joints
        d = m if self.noise is None else 0
        if s.prediction == "linear":
            _require_linear(model, self.rest)
        linear = model.linearise(self.rest)
        a, b = linear.state_matrix, linear.state_input_matrix
        whole = np.zeros((2 * n + d, 2 * n + d))
        whole[: 2 * n, : 2 * n], whole[: 2 * n, 2 * n :] = a, b[:, :d]
        c = output_matrix(model, s.tip_sigma is not None)
        self._c = np.hstack((c, np.zeros((len(c), d))))  # no sensor shows a disturbance directly
        names = (*state_names(model), *(f"disturbance of {name}" for name in model.joint_names[:d]))
        require_observable(whole, self._c, names)
        sigmas = [s.angle_sigma] * m + [s.rate_sigma] * m
        sigmas += [] if s.tip_sigma is None else [s.tip_sigma]
        self._r = np.square(np.array(sigmas))
        noise = np.zeros_like(whole)
        if self.noise is None:
            forces = np.linalg.solve(linear.mass, np.eye(n))
            by_effort = linear.input_matrix  # of wheels it is not one
            density = (s.effort_noise or 0.0) * by_effort @ by_effort.T
            density += np.diag([self.on_joints] * m + [s.modal_noise] * (n - m))
            noise[n : 2 * n, n : 2 * n] = forces @ density @ forces.T
            walk = _WALK if s.disturbance_walk is None else s.disturbance_walk
            noise[2 * n :, 2 * n :] = walk**2 * np.eye(m)
        else:
            noise[:] = self.noise
        inputs = np.vstack((b, np.zeros((d, m))))
        self._f, self._g, self._q = discrete_model(whole, inputs, noise, self.period)
        self._origin = np.concatenate((self.rest, np.zeros(n + d)))
        rate = s.initial_deflection_rate
        first = [s.angle_sigma] * m + [s.initial_deflection] * (n - m)
        first += [s.rate_sigma] * m + [s.initial_deflection if rate is None else rate] * (n - m)
        self._p0 = np.diag(np.square(np.array(first + [s.initial_disturbance] * d)))
        if s.prediction == "nonlinear" and isinstance(model, Model):
            self._require_resolved()
        self._predict = kalman_prediction(
            n,
            lambda _, x, effort, t: model.jacobian(x, effort, t=t),
            lambda _, x, effort, dt, t: model.advance(x, effort, dt, t=t),
        )

    def _require_resolved(self) -> None:
        """Check that one step of the equations of motion over a tick follows what it believes.

        Raises:
            BadInput: a mode turns by more than half a turn in a tick: it is followed wrongly from
                there on, and diverges soon after.
        """
        state = self.model.linearise(self.rest).state_matrix
        highest = float(abs(np.linalg.eigvals(state)).max())
        if highest * self.period > np.pi:
            raise BadInput(
                f"the Kalman filter cannot follow its model with a period of {self.period:g} s: it "
                f"believes modes up to {highest:.3g} rad/s, {highest * self.period:.2g} rad in a "
                f"tick; allowed: fewer modes in its model, or a period up to {1.0 / highest:.1g} s"
            )

    def _transition(self, x: Vector) -> Matrix:
        """Return error_transition at a state [q, v, d]."""
        k = 2 * self.model.coordinates
        d = x[k:]
        dx, du = self.model.jacobian(x[:k], d if d.size else np.zeros(self.model.joints))
        return np.asarray(error_transition(dx, du[:, : d.size], self.period))

    @property
    def matrices(self) -> FilterMatrices:
        """What does not change while it runs."""
        return FilterMatrices(self._f, self._g, self._q, self._c, self._r, self._origin, self._p0)

    def steady_state_gain(self) -> Matrix:
        """Return the gain towards which it tends at rest at `rest`, shape (k, l).

        Raises:
            BadInput: there is none.
        """
        c, r = self._c, np.diag(self._r)
        try:
            p = discrete_riccati(self._f.T, c.T, self._q, r)
        except LinAlgError as error:
            raise BadInput(f"no stationary Kalman filter: {error}") from None
        return np.asarray(np.linalg.solve(c @ p @ c.T + r, c @ p).T)

    def reset(self, measurement: Measurement) -> None:
        """Start from the measured joints, straight appendages and no disturbance."""
        y = outputs(measurement, len(self._c))
        self._x = first_state(y, self.model.coordinates, len(self._p0))
        self._p = self._p0.copy()
        self._prior = self._p
        self._tick = measurement.tick
        self._last = self._estimate(np.zeros(len(self._c)), 0.0)

    def update(self, measurement: Measurement) -> Estimate:
        """Return the estimate at this tick, with innovation, covariance of [q, v, d] and NIS."""
        if measurement.tick == self._tick:
            return self._last
        x, p = self._predicted(measurement.applied_effort, measurement.time - self.period)
        y = outputs(measurement, len(self._c))
        self._x, self._p, innovation, nis = measurement_update(x, p, y, self._c, self._r)
        self._prior, self._tick = p, measurement.tick
        self._last = self._estimate(innovation, nis)
        return self._last

    def settle(self, doublings: int) -> Matrix:
        """Let the covariance become that of 2^doublings ticks later at rest, and return it."""
        nonlinear = self.settings.prediction == "nonlinear"
        f = self._transition(self._x) if nonlinear else self._f
        given = self._q, self._c, self._r, self._prior, doublings
        self._prior, self._p = later_covariance(f, *given)
        self._last = self._last._replace(covariance=self._p)
        return self._p

    def innovation_variance(self) -> Vector:
        """Return the diagonal of C P C^T + R of the last update, shape (l,)."""
        return innovation_variance(self._prior, self._c, self._r)

    def _predicted(self, effort: Vector, t: float) -> tuple[Vector, Matrix]:
        """Return state and covariance a tick after t [s]."""
        if self.settings.prediction == "linear":
            x = self._origin + self._f @ (self._x - self._origin) + self._g @ effort
            return x, self._f @ self._p @ self._f.T + self._q
        given = self._q, self._x, self._p, effort, t, self.period
        return self._predict(EMPTY, *given)

    def _estimate(self, innovation: Vector, nis: float) -> Estimate:
        n = self.model.coordinates
        x = self._x
        return Estimate(x[:n], x[n : 2 * n], x[2 * n :], self._p, innovation, nis)


def outputs(measurement: Measurement, count: int) -> Vector:
    """Return y: joint positions, joint rates and, where `count` includes it, the first tip."""
    m = measurement.joint_position.size
    joints = (measurement.joint_position, measurement.joint_velocity)
    return np.concatenate((*joints, measurement.tip_deflection[: count - 2 * m]))


def _require_linear(model: LinearDesignModel, rest: Vector) -> None:
    """Check that the equations of motion are linear: the same Jacobian wherever it moves.

    Raises:
        BadInput: they are not, and the stated covariance would be right at rest alone.
    """
    rng, zero = np.random.default_rng(1), np.zeros(model.joints)
    origin = np.concatenate((rest, np.zeros_like(rest)))
    reference = model.jacobian(origin, zero)[0]
    for _ in range(4):
        shifted = model.jacobian(origin + rng.normal(0.0, 0.5, origin.size), zero)[0]
        same = np.allclose(shifted, reference, rtol=1e-9, atol=1e-9 * np.abs(reference).max())
        if model.time_varying or not same:
            raise BadInput(
                "filter.prediction: linear is right for a linear model alone, and this one is "
                "not: in motion the stated covariance would be far too small; take nonlinear"
            )
