"""A controller as matrices, where its law is linear in its inputs.

u(k) = f(k) + kp (q_d - q) + kd (q_d' - q') + K z(k) + H y(k) + Q (q' x q') + s(k),
s' = g(k) + ki (q_d - q) + G z(k) + (sat(u) - u) / T_t,
with y the measured joints, their rates and the first of the tips, f and g from the reference alone,
and z the state of an observer: see LinearObserver, SmallMotionForm, KalmanForm, SteadyForm and
GainFilter, where z is its state and then its innovation. What a law makes of the equations
of motion is part of z as well: see OnModelForm. The products of the rates q', which gyroscopic
torques are of, are all that is not linear. A law on the turn about the body axes has them for its
joints: see SharedForm.
"""

from typing import NamedTuple, TypeAlias

import numpy as np

from flexslew_control.allocation.sharing import AllocationNumbers
from flexslew_control.estimators.attitude_tick import AttitudeNumbers
from flexslew_control.estimators.flexible_attitude_tick import FlexibleForm
from flexslew_control.estimators.gained_filter import GainFilter, gain_filter
from flexslew_control.estimators.kalman import FilterMatrices, KalmanFilter
from flexslew_control.estimators.small_motion_observer import MotionConstants
from flexslew_control.law import Reference
from flexslew_control.linear.free_platform import nominal_states
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.model import Model


class LinearObserver(NamedTuple):
    """z(k) = A z(k - 1) + B u(k - 1) + E y(k - 1) + c + G d(k - 1), from z(0) = S y(0).

    u is the effort that was applied; d the law's own demand within the limits of the drives, from
    which motors, faults and lost answers may keep u. All but S may have an axis for ticks in
    front: those of k - 1 count.
    """

    start: Matrix  # S, (k, l)
    state: Matrix  # A, (k, k)
    effort: Matrix  # B, (k, m)
    before: Matrix  # E, (k, l)
    constant: Vector  # c, (k,)
    demand: Matrix = np.zeros((0, 0))  # G, (k, m); empty: none


class KalmanForm(NamedTuple):
    """A KalmanFilter that predicts by equations: z is its state [q, v, d], then its innovation."""

    model: Model
    matrices: FilterMatrices

    @property
    def output(self) -> Matrix:
        """C, (l, k)."""
        return self.matrices.c


class SteadyForm(NamedTuple):
    """x' = f(x, u) + K (y - C x) by a step of RK4 a tick, y and u held: z is x, then y - C x.

    It begins at the measured joints, all else at rest and zero.
    """

    model: Model
    gain: Matrix  # K, (2 n, l)
    output: Matrix  # C, (l, 2 n)
    variance: Vector  # of y - C x as it states it, (l,)


class OnModelForm(NamedTuple):
    """An observer of x and e, and efforts u by the equations of motion: z = [x, e, u].

    u is the sum of surface_terms with f(x, 0) and B(x).
    """

    observer: KalmanForm | SteadyForm | GainFilter
    model: Model  # of f and B
    surface: Matrix  # G, (m, 2 n)
    reaching: Matrix  # R, (m, 2 n)
    innovation: Matrix  # W, (m, l)
    nominal: Matrix  # x*, (ticks, 2 n)
    slope: Matrix  # x*', (ticks, 2 n)


class SurfaceGains(NamedTuple):
    """The gains of a sliding law."""

    surface: Matrix  # G, (m, k)
    reaching: Matrix  # R, (m, k)
    innovation: Matrix  # W, (m, l)


def surface_terms(
    gains: SurfaceGains,
    inverse: Matrix,
    slope: Vector,
    drift: Vector,
    innovation: Vector,
    error: Vector,
) -> tuple[Vector, Vector, Vector, Vector]:
    """Return the terms of u = (G B)^-1 [G x*' - G f(x, 0) - W e - R (x - x*)], each of shape (m,).

    Args:
        gains: G, R and W.
        inverse: (G B)^-1, shape (m, m).
        slope: x*', shape (k,).
        drift: f(x, 0), shape (k,).
        innovation: e, shape (l,).
        error: x - x*, shape (k,).
    """
    return (
        inverse @ (gains.surface @ slope),
        -inverse @ (gains.surface @ drift),
        -inverse @ (gains.innovation @ innovation),
        -inverse @ (gains.reaching @ error),
    )


class SmallMotionForm(NamedTuple):
    """A SmallMotionObserver, and what reads its estimate (x, x') as others read y.

    z is the estimate, then the state of the one behind it.
    """

    model: Model
    constants: MotionConstants
    behind: LinearObserver


class Integration(NamedTuple):
    """The integral s of a law, and the limit against which it stops."""

    integral: bool  # whether there is s
    tracking_rate: float  # 1 / T_t [1/s]
    limit: Vector  # of the law itself, (m,); inf: none


def no_integral(m: int) -> Integration:
    """Return that of a law without an integral."""
    return Integration(False, 0.0, np.full(m, np.inf))


class LawForm(NamedTuple):
    """The matrices of the equations above; K, H and G may have an axis for ticks in front."""

    kp: Vector  # (m,)
    ki: Vector  # (m,)
    kd: Vector  # (m,)
    from_state: Matrix  # K, (m, k)
    from_output: Matrix  # H, (m, l)
    to_integral: Matrix  # G, (m, k)
    demand: Matrix  # f, (ticks, m)
    integrand: Matrix  # g, (ticks, m)
    integration: Integration
    quadratic: Matrix = np.zeros((0, 0))  # Q, (m, m m); empty: none

    @property
    def gains(self) -> Vector:
        """kp, ki and kd one behind another, (3 m,)."""
        return np.concatenate((self.kp, self.ki, self.kd))


class SharedForm(NamedTuple):
    """What makes efforts of the torque of a law on the body axes; see allocation.AllocationLaw."""

    allocation: AllocationNumbers
    position: Matrix  # q_d of the law: rotation vectors, (ticks, 3) [rad]
    velocity: Matrix  # (ticks, 3) [rad/s]


Observer: TypeAlias = (
    LinearObserver | GainFilter | KalmanForm | SteadyForm | SmallMotionForm | OnModelForm
)


class LinearForm(NamedTuple):
    """A law with its observer and its allocation."""

    law: LawForm
    observer: Observer
    shared: SharedForm | None = None  # None: its efforts are those of the joints
    attitude: AttitudeNumbers | None = None  # the filter that gives the joints; None: as measured
    flexible: FlexibleForm | None = None  # what it estimates besides attitude and bias


def collocated_form(
    kp: Vector, ki: Vector, kd: Vector, demand: Matrix, integration: Integration
) -> LinearForm:
    """Return a law on the measured joints alone, with the plan's efforts for f."""
    m = kp.size
    state, output = np.zeros((m, 0)), np.zeros((m, 2 * m))
    form = observed_form(state, output, demand, no_observer(2 * m, m), (kp, kd))
    return form._replace(law=form.law._replace(ki=ki, integration=integration))


def observed_form(
    from_state: Matrix,
    from_output: Matrix,
    demand: Matrix,
    observer: Observer,
    gains: tuple[Vector, Vector] | None = None,
) -> LinearForm:
    """Return a law on an observer's state and on the readings, without an integral of its own.

    Args:
        from_state: K.
        from_output: H.
        demand: f, shape (ticks, m).
        observer: observer with the state z.
        gains: kp and kd, (m,) each; None: zero.
    """
    m = demand.shape[1]
    kp, kd = gains or (np.zeros(m), np.zeros(m))
    unused, none = np.zeros((m, from_state.shape[-1])), np.zeros(m)
    numbers = from_state, from_output, unused, demand, 0.0 * demand, no_integral(m)
    return LinearForm(LawForm(kp, none, kd, *numbers), observer)


def no_observer(outputs: int, m: int) -> LinearObserver:
    """Return an observer without a state, for so many outputs and efforts."""
    none = np.zeros((0, outputs))
    return LinearObserver(none, np.zeros((0, 0)), np.zeros((0, m)), none, np.zeros(0))


class OnDeviation(NamedTuple):
    """The gains of a law on the deviation of [q, v] from the nominal state."""

    gain: Matrix  # of the deviation, (m, 2 n)
    cancel: Matrix  # of the estimated disturbance, (m, m)
    ki: Matrix  # of the integral of the deviation of q, (m, n)


def nominal_form(
    estimator: KalmanFilter,
    gains: OnDeviation,
    references: list[Reference],
    integration: Integration,
) -> LinearForm:
    """Return a law on the deviation of a KalmanFilter's estimate from the nominal state."""
    model = estimator.model
    n, m, outputs = model.coordinates, model.joints, len(estimator.matrices.c)
    nominal = nominal_states(model, references)
    demand = np.array([r.effort for r in references])
    to_integral = np.zeros((m, 2 * n + m + outputs))
    to_integral[:, :n] = -gains.ki
    no_output = np.zeros((m, outputs))
    form = observed_form(
        np.hstack((-gains.gain, -gains.cancel, no_output)),
        no_output,
        demand + nominal @ gains.gain.T,
        kalman_form(estimator, len(references)),
    )
    integrand = nominal[:, :n] @ gains.ki.T
    law = form.law._replace(integrand=integrand, integration=integration)
    return form._replace(law=law._replace(to_integral=to_integral))


def kalman_form(estimator: KalmanFilter, ticks: int) -> GainFilter | KalmanForm:
    """Return a filter as matrices for so many ticks."""
    found = gain_filter(estimator, ticks)
    if found is not None:
        return found
    assert isinstance(estimator.model, Model)
    return KalmanForm(estimator.model, estimator.matrices)
