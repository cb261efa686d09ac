"""Laws on the small motions of a platform with retargeting appendages, as gains on the estimate."""

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import block_diag

from flexslew_control.controllers.linear_form import (
    LinearForm,
    LinearObserver,
    SmallMotionForm,
    no_observer,
    observed_form,
)
from flexslew_control.controllers.probing.at_rest import plan_motion_error
from flexslew_control.estimators.small_motion_observer import (
    InverseObserver,
    SmallMotionObserver,
)
from flexslew_control.law import Estimate, Reference
from flexslew_control.plan import Plan
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.measurement import Measurement

NO_GAINS = "its plan has no gains; set plan.gains to constant, perturbation or adiabatic"


@dataclass
class StateFeedback:
    """u = u_ff - K (x, x') (3-1), (3-8).

    Args:
        gain: K on all coordinates and their rates, SI, shape (m, 2 n).
        rest: joint positions that it holds, shape (m,) [rad or m].
    """

    gain: Matrix
    rest: Vector
    terms: dict[str, Vector] = field(init=False, default_factory=dict)

    def objection(self, plan: Plan | None) -> str:
        """Return why it cannot fly without a plan, or with this one; empty if it can."""
        return plan_motion_error(plan, self.rest)

    def reset(
        self, measurement: Measurement, estimate: Estimate, reference: Reference, effort: Vector
    ) -> None:
        """Nothing to choose: the law has no state of its own."""

    def update(self, measurement: Measurement, estimate: Estimate, reference: Reference) -> Vector:
        """Return the efforts, shape (m,) [N m or N]."""
        feedback = -(self.gain @ np.concatenate((estimate.position, estimate.velocity)))
        self.terms = {"feedforward": reference.effort, "regulator": feedback}
        return reference.effort + feedback


@dataclass
class IntegralFeedback:
    """u = u_ff - Kp x - Kd x' - Ki z, z' = x + Ki^+ (u - sat(u)) / T_t (3-23), (3-52).

    The gains multiply the integral from outside, as in Kwak (1989).

    Args:
        gains: [Kp, Kd, Ki] on all coordinates, SI, shape (m, 3 n).
        rest: joint positions that it holds, shape (m,) [rad or m].
        limit: of the efforts, shape (m,) [N m or N].
        tracking_time: T_t [s]; None: the integral winds up.
        period: one tick [s].
        planned: whether it flies with the gains of its plan alone.
    """

    gains: Matrix
    rest: Vector
    limit: Vector
    tracking_time: float | None
    period: float
    planned: bool = False
    terms: dict[str, Vector] = field(init=False, default_factory=dict)
    _z: Vector = field(init=False, default_factory=lambda: np.zeros(0))
    _before: Vector = field(init=False, default_factory=lambda: np.zeros(0))

    def objection(self, plan: Plan | None) -> str:
        """Return why it cannot fly without a plan, or with this one; empty if it can."""
        missing = self.planned and not (plan and plan.gains.size)
        return NO_GAINS * missing or plan_motion_error(plan, self.rest)

    def reset(
        self, measurement: Measurement, estimate: Estimate, reference: Reference, effort: Vector
    ) -> None:
        """Choose the integral such that the next effort is nearest to `effort`."""
        kp, kd, ki = self.three(reference)
        rest = reference.effort - kp @ estimate.position - kd @ estimate.velocity - effort
        self._z = np.asarray(np.linalg.lstsq(ki, rest, rcond=None)[0], dtype=np.float64)
        self._before = -estimate.position  # the first effort is this one: nothing is integrated yet

    def update(self, measurement: Measurement, estimate: Estimate, reference: Reference) -> Vector:
        """Return the efforts within the limit, shape (m,) [N m or N]."""
        kp, kd, ki = self.three(reference)
        x = estimate.position
        if measurement.tick == 0:
            self._z, self._before = np.zeros_like(x), -x
        self._z = self._z + 0.5 * self.period * (self._before + x)
        self._before = x
        self.terms = {
            "feedforward": reference.effort,
            "proportional": -(kp @ x),
            "derivative": -(kd @ estimate.velocity),
            "integral": -(ki @ self._z),
        }
        demand: Vector = sum(self.terms.values(), np.zeros(len(self.limit)))
        effort = np.clip(demand, -self.limit, self.limit)
        if self.tracking_time is not None and (effort != demand).any():
            correction = np.linalg.lstsq(ki, demand - effort, rcond=None)[0]
            self._z = self._z + self.period / self.tracking_time * correction
        return effort

    def three(self, reference: Reference) -> tuple[Matrix, Matrix, Matrix]:
        """Return Kp, Kd and Ki of a tick, shape (m, n) each."""
        gains = self.gains
        if self.planned and reference.gains.size:
            gains = reference.gains.reshape(len(self.limit), -1)
        n = gains.shape[1] // 3
        return gains[:, :n], gains[:, n : 2 * n], gains[:, 2 * n :]


def state_form(
    estimator: InverseObserver | SmallMotionObserver,
    law: StateFeedback,
    references: list[Reference],
) -> LinearForm:
    """Return the law as matrices; see LawEntry."""
    (m, states), none = law.gain.shape, np.zeros((len(law.gain), 0))
    demand = np.array([reference.effort for reference in references])
    return _on_motion(estimator, -law.gain, none, demand, no_observer(states, m))


def integral_form(
    estimator: InverseObserver | SmallMotionObserver,
    law: IntegralFeedback,
    references: list[Reference],
) -> LinearForm:
    """Return the law as matrices; see LawEntry.

    The integral is z = s + x T / 2 with s(k + 1) = s(k) + T x(k) + g (demand - sat(demand)), and
    s(0) = -x T / 2; g is what takes it back at the limits.
    """
    h, m, n = law.period, len(law.gains), law.gains.shape[1] // 3
    one, none = np.eye(n), np.zeros((n, n))
    demand = np.array([reference.effort for reference in references])
    varying = law.planned and any(reference.gains.size for reference in references)
    rows = []
    for reference in references if varying else references[:1]:
        kp, kd, ki = law.three(reference)
        correction = np.zeros((n, m))
        if law.tracking_time is not None:
            correction = h / law.tracking_time * np.asarray(np.linalg.pinv(ki))
        of_motion = -np.hstack((kp + 0.5 * h * ki, kd))
        before = np.hstack((h * one, none)) + correction @ of_motion
        rows.append((of_motion, -ki, one - correction @ ki, -correction, before, correction))
    of_motion, of_state, state, taken, before, correction = map(np.array, zip(*rows, strict=True))
    start = np.hstack((-0.5 * h * one, none))
    constant = (correction @ demand[:, :, None])[:, :, 0]
    observer = LinearObserver(start, state, np.zeros((n, m)), before, constant, taken)
    return _on_motion(estimator, of_motion, of_state, demand, observer)


def _on_motion(
    estimator: InverseObserver | SmallMotionObserver,
    of_motion: Matrix,
    of_state: Matrix,
    demand: Matrix,
    observer: LinearObserver,
) -> LinearForm:
    """Return a law on the estimate (x, x') and on an observer that reads it.

    Args:
        estimator: estimator of (x, x').
        of_motion: gains from (x, x') to the efforts, (m, 2 n), or tick by tick.
        of_state: gains from the observer's state to the efforts.
        demand: shape (ticks, m).
        observer: observer with y = (x, x').
    """
    if isinstance(estimator, InverseObserver):
        read = block_diag(estimator.inverse, estimator.inverse)
        on_outputs = observer._replace(start=observer.start @ read, before=observer.before @ read)
        return observed_form(of_state, of_motion @ read, demand, on_outputs)
    m = demand.shape[1]
    form = SmallMotionForm(estimator.motion.model, estimator.constants, observer)
    on_all = np.concatenate((of_motion, of_state), axis=-1)
    return observed_form(on_all, np.zeros((m, 2 * m)), demand, form)
