"""A controller as matrices, where its law is linear in what it knows.

u(k) = f(k) + kp (q_d - q) + kd (q_d' - q') + K z(k) + H y(k) + s(k),
s' = g(k) + ki (q_d - q) + G z(k) + (sat(u) - u) / T_t,
with y the measured joints, their rates and the first tip, f and g from the reference alone, and
z the state of an observer: see Observer and KalmanForm.
"""

from typing import Any, NamedTuple

import numpy as np

from flexslew_control.controllers.collocated_pid import JointDeviation
from flexslew_control.controllers.design_model import JointsAndModes, held_step
from flexslew_control.controllers.integral_action import IntegralLaw
from flexslew_control.controllers.lqr import LqrLaw
from flexslew_control.controllers.output_feedback import SampledObserver, SlidingLaw
from flexslew_control.controllers.pd_feedforward import PdFeedforward
from flexslew_control.controllers.proportional_integral import NominalDeviation
from flexslew_control.estimators.kalman import FilterMatrices, KalmanFilter
from flexslew_control.law import Estimator, Law, Reference, nominal_state
from flexslew_control.plan import Plan
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.model import Model


class Observer(NamedTuple):
    """z(k) = A z(k - 1) + B u(k - 1) + E y(k - 1) + c, from z(0) = S y(0)."""

    start: Matrix  # S, (k, l)
    state: Matrix  # A, (k, k)
    effort: Matrix  # B, (k, m)
    before: Matrix  # E, (k, l)
    constant: Vector  # c, (k,)


class KalmanForm(NamedTuple):
    """A KalmanFilter: z is its state [q, v, d], and then its innovation."""

    model: Model
    linear: bool
    matrices: FilterMatrices


class LawForm(NamedTuple):
    """The matrices of the equations above."""

    kp: Vector  # (m,)
    ki: Vector  # (m,)
    kd: Vector  # (m,)
    from_state: Matrix  # K, (m, k)
    from_output: Matrix  # H, (m, l)
    to_integral: Matrix  # G, (m, k)
    demand: Matrix  # f, (ticks, m)
    integrand: Matrix  # g, (ticks, m)
    integral: bool  # whether there is s
    unwinding: float  # 1 / T_t [1/s]
    limit: Vector  # of the law itself, (m,); inf: none


class LinearForm(NamedTuple):
    """A law with what it knows of the bench."""

    law: LawForm
    observer: Observer | KalmanForm


def linear_form(estimator: Estimator, law: Law, plan: Plan, ticks: int) -> LinearForm | None:
    """Return a controller as matrices; None where it is not linear.

    Args:
        estimator: as built.
        law: as built.
        plan: that it follows.
        ticks: of the run.
    """
    wanted = [plan.reference(k) for k in range(ticks)]
    if isinstance(law, PdFeedforward):
        none = np.zeros(law.kp.size)
        return _collocated(law.kp, none, law.kd, wanted, None)
    if isinstance(law, IntegralLaw) and isinstance(law.deviation, JointDeviation):
        gains = law.deviation
        return _collocated(gains.kp, gains.ki, gains.kd, wanted, law)
    if isinstance(estimator, KalmanFilter) and isinstance(law, LqrLaw | IntegralLaw):
        return _about_nominal(estimator, law, wanted)
    if isinstance(law, SlidingLaw):
        return _sliding(estimator, law, wanted)
    return None


def _collocated(
    kp: Vector, ki: Vector, kd: Vector, wanted: list[Reference], law: IntegralLaw | None
) -> LinearForm:
    m, demand = kp.size, np.array([w.effort for w in wanted])
    none = np.zeros((m, 0))
    form = LawForm(
        kp, ki, kd, none, np.zeros((m, 2 * m)), none, demand, 0.0 * demand, **_integral(law, m)
    )
    nothing = Observer(np.zeros((0, 2 * m)), none[:0], none.T, np.zeros((0, 2 * m)), np.zeros(0))
    return LinearForm(form, nothing)


def _about_nominal(
    estimator: KalmanFilter, law: LqrLaw | IntegralLaw, wanted: list[Reference]
) -> LinearForm | None:
    """Return LQR or PI, which work on the deviation of [q, v] from the nominal state."""
    model = estimator.model
    if not isinstance(model, Model):
        return None  # the small motions of a free platform: no kernel flies them in lanes
    n, m, outputs = model.coordinates, model.joints, len(estimator.matrices.c)
    nominal = np.array([nominal_state(w.state, w, m, model.modes) for w in wanted])
    demand = np.array([w.effort for w in wanted])
    to_integral, integrand = np.zeros((m, 2 * n + m + outputs)), np.zeros_like(demand)
    if isinstance(law, LqrLaw):
        gain, cancel = law.gain, law.disturbance_gain
    elif isinstance(law.deviation, NominalDeviation):
        gains = law.deviation.gains
        gain, cancel = np.hstack((gains.kp, gains.kd)), np.zeros((m, m))
        to_integral[:, :n] = -gains.ki
        integrand = nominal[:, :n] @ gains.ki.T
    else:
        return None
    none = np.zeros(m)
    form = LawForm(
        none,
        none,
        none,
        np.hstack((-gain, -cancel, np.zeros((m, outputs)))),
        np.zeros((m, outputs)),
        to_integral,
        demand + nominal @ gain.T,
        integrand,
        **_integral(law if isinstance(law, IntegralLaw) else None, m),
    )
    return LinearForm(form, _kalman(estimator, model))


def _sliding(estimator: Estimator, law: SlidingLaw, wanted: list[Reference]) -> LinearForm | None:
    """Return output feedback with the linear model, tracking (b): (51) with D = 0."""
    observed = law.observed
    if not isinstance(observed, JointsAndModes) or not observed.linear:
        return None
    system, surface, m = observed.system, law.found.surface, observed.model.joints
    inverse = observed.effectiveness(observed.origin, surface)
    rates = law.found.reaching_rate + law.attitude_gain * observed.joint_rows
    reaching = inverse @ (surface * rates)
    innovation = -inverse @ (surface @ law.found.observer_gain)
    equivalent = inverse @ surface @ system.a
    pairs = [observed.wanted(w) for w in wanted]
    nominal, slope = (np.array(column) for column in zip(*pairs, strict=True))
    demand = slope @ (inverse @ surface).T + nominal @ reaching.T + equivalent @ observed.origin
    of_state, outputs = -equivalent - reaching, len(system.c)
    found: Observer | KalmanForm
    if isinstance(estimator, KalmanFilter):
        found, of_output = _kalman(estimator, observed.model), np.zeros((m, outputs))
        of_state = np.hstack((of_state, innovation))
    elif isinstance(estimator, SampledObserver):
        found, of_output = _sampled(observed), innovation  # of e = y - C z
        of_state = of_state - innovation @ system.c
    else:
        return None
    none, unused = np.zeros(m), np.zeros_like(of_state)
    form = LawForm(
        none, none, none, of_state, of_output, unused, demand, 0.0 * demand, **_integral(None, m)
    )
    return LinearForm(form, found)


def _kalman(estimator: KalmanFilter, model: Model) -> KalmanForm:
    linear = estimator.settings.prediction == "linear"
    return KalmanForm(model, linear, estimator.matrices)


def _sampled(observed: JointsAndModes) -> Observer:
    """Return the linear observer whose measurement is held over the tick."""
    c, origin = observed.system.c, observed.origin
    step = held_step(observed.system, observed.gain, observed.period)
    k, m, n = len(origin), observed.model.joints, observed.model.coordinates
    a, b, held = step[:, :k], step[:, k : k + m], step[:, k + m :]
    start = np.zeros((k, len(c)))
    start[:m, :m], start[n : n + m, m : 2 * m] = np.eye(m), np.eye(m)
    return Observer(start, a, b, held, origin - a @ origin - held @ (c @ origin))


def _integral(law: IntegralLaw | None, m: int) -> dict[str, Any]:
    if law is None:
        return {"integral": False, "unwinding": 0.0, "limit": np.full(m, np.inf)}
    unwinding = 0.0 if law.tracking_time is None else 1.0 / law.tracking_time
    return {"integral": True, "unwinding": unwinding, "limit": law.limit}
