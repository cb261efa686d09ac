"""The sliding law and its observer (Sung and Joo, (5), (51)), and their linear form."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from flexslew_control.controllers.linear_form import (
    KalmanForm,
    LinearForm,
    LinearObserver,
    OnModelForm,
    SteadyForm,
    SurfaceGains,
    kalman_form,
    observed_form,
    surface_terms,
)
from flexslew_control.controllers.rotation_form import rotation_form
from flexslew_control.controllers.sliding.design_model import (
    DesignModel,
    JointsAndModes,
    ObservedModel,
    observer_step,
)
from flexslew_control.controllers.sliding.one_appendage import OneAppendage, appendage_form
from flexslew_control.controllers.sliding.plan_deviation import PlanDeviation
from flexslew_control.controllers.sliding.sliding_surface import SlidingDesign
from flexslew_control.estimators.gained_filter import GainFilter
from flexslew_control.estimators.kalman import KalmanFilter, discrete_model
from flexslew_control.estimators.prediction import first_gain
from flexslew_control.estimators.rotation_filter import RotationFilter
from flexslew_control.law import Estimate, Estimator, Reference
from flexslew_plant.arrays import EMPTY, Matrix, Tensor, Vector
from flexslew_plant.measurement import Measurement


@dataclass
class SampledObserver:
    """z_hat' = f(z_hat, u) + K_f (y - C z_hat) (5), with y and the applied u held over each tick.

    The estimate at tick k rests on the measurements before k; the law adds K_f y(k) itself. Its
    covariance at rest is not P of (7), which has no ticks: an error e becomes F e - H v + w, with
    the noise v of the sensors held over the tick, so P = F P F^T + H R H^T + Q.

    Args:
        observed: the observed model.
        found: design with K_f.
        period: one tick [s].
    """

    observed: ObservedModel
    found: SlidingDesign
    period: float
    _z: Vector = field(init=False)
    _y: Vector = field(init=False)
    _tick: int = field(init=False, default=-1)
    _last: Estimate = field(init=False)
    _reference: Reference | None = field(init=False, default=None)  # of the tick of _y
    _coming: Reference | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        """Precompute the covariance, and the inverse of the innovation's."""
        s, sensors = self.observed.system, self.observed.system.sensor_density / self.period
        noise = s.noise_input @ s.noise_density @ s.noise_input.T
        f, h = self.observed.error_step()
        q = discrete_model(s.a, s.b, noise, self.period)[2] + h @ sensors @ h.T
        self._covariance = np.asarray(solve_discrete_lyapunov(f, q), dtype=np.float64)
        variance = s.c @ self._covariance @ s.c.T + sensors
        self._inverse, self._variance = np.linalg.inv(variance), np.diag(variance)
        self._covariance.flags.writeable = False

    def expect(self, reference: Reference) -> None:
        """Take the reference of the next measurement, which determines the known part of D(t)."""
        self._coming = reference

    def reset(self, measurement: Measurement) -> None:
        """Start at the measured joints with straight appendages at rest."""
        self._z = self.observed.start(measurement)
        self._tick = measurement.tick
        self._take(measurement)

    def update(self, measurement: Measurement) -> Estimate:
        """Return the estimate at this tick; the same again for a measurement that is repeated."""
        if measurement.tick != self._tick:
            effort = self.observed.efforts(measurement)
            gain = self.found.observer_gain
            self._z = self.observed.propagate(self._z, self._y, effort, gain, self._reference)
            self._tick = measurement.tick
            self._take(measurement)
        return self._last

    def innovation_variance(self) -> Vector:
        """Return the variance of each innovation with the stationary covariance, shape (l,)."""
        return self._variance

    def _take(self, measurement: Measurement) -> None:
        self._reference = self._coming
        self._y = self.observed.outputs(measurement)
        z = self._z
        e = self._y - self.observed.system.c @ z
        nis = float(e @ self._inverse @ e)
        position, velocity = self.observed.estimate(z, measurement)
        self._last = Estimate(position, velocity, np.zeros(0), self._covariance, e, nis)


@dataclass
class SlidingLaw:
    """u = -(G B)^-1 {G [f(z_hat, 0) + K_f e - z*'] + nu G (z_hat - z*) + kappa G z_re} (51).

    e = y - C z_hat. f(z, 0) = A z + D, and B is that at z_hat (tracking (a)) or at the operating
    point with D = 0 (tracking (b)). What z leaves out of the bench is held by its own feedback.

    Args:
        observed: what is controlled.
        found: G and nu.
        attitude_gain: kappa, on the joints' rows of z_hat - z* [1/s].
        innovation_term: whether K_f e moves z_hat between ticks, too; False: without that term, as
            the
            observer has corrected z_hat at the tick.
    """

    observed: DesignModel
    found: SlidingDesign
    attitude_gain: float = 0.0
    innovation_term: bool = True
    terms: dict[str, Vector] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        """Precompute what does not change."""
        self._innovation_gain = self.found.surface @ self.found.observer_gain

    @cached_property
    def reaching(self) -> Matrix:
        """The matrix nu G + kappa G, kappa on the joints' columns alone."""
        nu, kappa = self.found.reaching_rate, self.attitude_gain
        return self.found.surface * (nu + kappa * self.observed.joint_rows)

    def at_rest(self, a: Matrix) -> Matrix:
        """Return (G B)^-1 (G A + nu G + kappa G), which multiplies -(z - z*) at the rest z = 0.

        Args:
            a: A, shape (k, k).
        """
        inverse = self.observed.effectiveness(np.zeros(len(a)), self.found.surface)
        return inverse @ (self.found.surface @ a + self.reaching)

    def reset(
        self, measurement: Measurement, estimate: Estimate, reference: Reference, effort: Vector
    ) -> None:
        """Nothing to choose: the law has no state of its own."""

    def update(self, measurement: Measurement, estimate: Estimate, reference: Reference) -> Vector:
        """Return the joint efforts, shape (joints,) [N m or N]."""
        observed, surface = self.observed, self.found.surface
        z = observed.state(estimate)
        nominal, slope = observed.nominal_state(reference)
        drift, inverse = observed.drift(z, reference), observed.effectiveness(z, surface)
        gains = SurfaceGains(surface, self.reaching, self._innovation_gain)
        parts = surface_terms(gains, inverse, slope, drift, estimate.innovation, z - nominal)
        self.terms = {
            name: observed.on_bench(effort)
            for name, effort in zip(_TERMS, parts, strict=True)
            if self.innovation_term or name != "innovation"
        }
        self.terms |= observed.platform(measurement, reference)
        total: Vector = sum(self.terms.values(), start=_ZERO)
        return total


_ZERO = np.zeros(())
_TERMS = ("feedforward", "equivalent", "innovation", "reaching")  # see surface_terms


def _of_deviation(law: SlidingLaw, observed: PlanDeviation, references: list[Reference]) -> Tensor:
    """Return what multiplies [e, e'] about a plan, shape (ticks, joints, 2 n)."""
    platform, surface = observed.craft, law.found.surface
    inverse = observed.effectiveness(EMPTY, surface)
    rest = platform.small.linear.state_matrix
    found = np.empty((len(references), len(inverse), len(rest)))
    for tick, reference in enumerate(references):
        a = platform.state_matrix(reference.velocity) if observed.turning else rest
        found[tick] = -inverse @ (surface @ a + law.reaching)
    return found


def sliding_form(
    estimator: Estimator, law: SlidingLaw, references: list[Reference]
) -> LinearForm | None:
    """Return output feedback (51) as a linear form.

    Of one appendage, and of a craft about its plan, and with D = 0, tracking (b), all other terms
    come from the plan alone; of all else z has the efforts by the equations of motion.
    """
    observed = law.observed
    if isinstance(estimator, RotationFilter) and isinstance(observed, PlanDeviation):
        return rotation_form(estimator, _of_deviation(law, observed, references), references)
    if isinstance(observed, OneAppendage) and isinstance(estimator, SampledObserver):
        return appendage_form(law.found, observed, law.attitude_gain, references)
    if not isinstance(observed, JointsAndModes):
        return None
    if not observed.linear:
        return _on_model(estimator, law, observed, references)
    system, surface, m = observed.system, law.found.surface, observed.model.joints
    inverse = observed.effectiveness(observed.origin, surface)
    rates = law.found.reaching_rate + law.attitude_gain * observed.joint_rows
    reaching = inverse @ (surface * rates)
    innovation = -inverse @ (surface @ law.found.observer_gain)
    equivalent = inverse @ surface @ system.a
    nominal, slope = observed.nominal_states(references)
    demand = slope @ (inverse @ surface).T + nominal @ reaching.T + equivalent @ observed.origin
    of_state, outputs = -equivalent - reaching, len(system.c)
    found: LinearObserver | GainFilter | KalmanForm
    if isinstance(estimator, KalmanFilter):
        found, of_output = kalman_form(estimator, len(references)), np.zeros((m, outputs))
        of_state = np.hstack((of_state, innovation))
    elif isinstance(estimator, SampledObserver):
        found, of_output = _sampled(observed), innovation  # of e = y - C z
        of_state = of_state - innovation @ system.c
    else:
        return None
    return observed_form(of_state, of_output, demand, found)


def _on_model(
    estimator: Estimator, law: SlidingLaw, observed: JointsAndModes, references: list[Reference]
) -> LinearForm | None:
    """Return the law with drift and effectiveness by the equations of motion."""
    found: KalmanForm | SteadyForm | GainFilter
    if isinstance(estimator, KalmanFilter):
        found = kalman_form(estimator, len(references))
    elif isinstance(estimator, SampledObserver):
        variance = estimator.innovation_variance()
        found = SteadyForm(observed.model, observed.gain, observed.system.c, variance)
    else:
        return None
    surface, gain, c = law.found.surface, law.found.observer_gain, observed.system.c
    plan = observed.nominal_states(references)
    m, (outputs, states) = len(surface), c.shape
    efforts = OnModelForm(found, observed.model, surface, law.reaching, surface @ gain, *plan)
    selection, none = np.hstack((np.zeros((m, states + outputs)), np.eye(m))), np.zeros
    return observed_form(selection, none((m, outputs)), none((len(references), m)), efforts)


def _sampled(observed: JointsAndModes) -> LinearObserver:
    """Return the linear observer with the measurement held over the tick."""
    c, origin = observed.system.c, observed.origin
    step = observer_step(observed.system, observed.gain, observed.period)
    k, m, n = len(origin), observed.model.joints, observed.model.coordinates
    a, b, output_gain = step[:, :k], step[:, k : k + m], step[:, k + m :]
    start = first_gain(len(c), n, k)
    return LinearObserver(
        start, a, b, output_gain, origin - a @ origin - output_gain @ (c @ origin)
    )
