"""A controller as matrices, where its law and its estimator are linear in their states.

z(k) = A z(k - 1) + B u(k - 1) + D y(k) + E y(k - 1) + c, from z(0) = S y(0),
u(k) = f(k) + kp (q_d - q) + kd (q_d' - q') + K z(k) + H y(k) + s(k),
s' = g(k) + ki (q_d - q) + G z(k) + (sat(u) - u) / T_t,
with y the measured joints, their rates and the first tip, and f, g from the reference alone.
"""

from typing import Any, NamedTuple

import numpy as np

from flexslew_control.controllers.collocated_pid import JointDeviation
from flexslew_control.controllers.integral_action import IntegralLaw
from flexslew_control.controllers.pd_feedforward import PdFeedforward
from flexslew_control.law import Law
from flexslew_control.plan import Plan
from flexslew_plant.arrays import Matrix, Tensor, Vector


class References(NamedTuple):
    """A plan on the ticks of a run; see law.Reference."""

    position: Matrix  # (ticks, joints)
    velocity: Matrix  # (ticks, joints)
    effort: Matrix  # (ticks, joints)
    state: Matrix  # (ticks, 2 n of the planner), or (ticks, 0)
    next_state: Matrix


class LinearForm(NamedTuple):
    """The matrices of the equations above; entries of A, B, D and c hold to the next ones."""

    kp: Vector  # (m,)
    ki: Vector  # (m,)
    kd: Vector  # (m,)
    start: Matrix  # S, (k, l)
    state: Tensor  # A, (steps, k, k)
    effort: Tensor  # B, (steps, k, m)
    output: Tensor  # D, (steps, k, l)
    before: Matrix  # E, (k, l)
    constant: Matrix  # c, (steps, k)
    from_state: Matrix  # K, (m, k)
    from_output: Matrix  # H, (m, l)
    to_integral: Matrix  # G, (m, k)
    demand: Matrix  # f, (ticks, m)
    integrand: Matrix  # g, (ticks, m)
    integral: bool  # whether there is s
    unwinding: float  # 1 / T_t [1/s]
    limit: Vector  # of the law itself, (m,); inf: none


def references(plan: Plan, ticks: int) -> References:
    """Return what a plan wants at the ticks from 0 to before `ticks`."""
    rows = [plan.reference(k) for k in range(ticks)]
    columns = zip(*rows, strict=True)
    return References(*(np.array(column, dtype=np.float64) for column in columns))


def linear_form(law: Law, wanted: References) -> LinearForm | None:
    """Return a controller as matrices; None where it is not linear.

    Args:
        law: as built.
        wanted: the plan on the ticks.
    """
    m = wanted.position.shape[1]
    if isinstance(law, PdFeedforward):
        return _collocated(law.kp, np.zeros(m), law.kd, wanted, None)
    if isinstance(law, IntegralLaw) and isinstance(law.deviation, JointDeviation):
        gains = law.deviation
        return _collocated(gains.kp, gains.ki, gains.kd, wanted, law)
    return None


def _collocated(
    kp: Vector, ki: Vector, kd: Vector, wanted: References, law: IntegralLaw | None
) -> LinearForm:
    m = kp.size
    none = np.zeros((0, 2 * m))
    return LinearForm(
        kp,
        ki,
        kd,
        none,
        np.zeros((1, 0, 0)),
        np.zeros((1, 0, m)),
        np.zeros((1, 0, 2 * m)),
        none,
        np.zeros((1, 0)),
        np.zeros((m, 0)),
        np.zeros((m, 2 * m)),
        np.zeros((m, 0)),
        wanted.effort,
        np.zeros_like(wanted.effort),
        **_integral(law, m),
    )


def _integral(law: IntegralLaw | None, m: int) -> dict[str, Any]:
    if law is None:
        return {"integral": False, "unwinding": 0.0, "limit": np.full(m, np.inf)}
    unwinding = 0.0 if law.tracking_time is None else 1.0 / law.tracking_time
    return {"integral": True, "unwinding": unwinding, "limit": law.limit}
