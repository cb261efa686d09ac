"""The law with an integral and anti-windup that several controllers share."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import numpy as np

from flexslew_control.controllers.by_joint.gyroscopic import Gyroscopic
from flexslew_control.controllers.linear_form import Integration
from flexslew_control.law import Estimate, Reference
from flexslew_plant.arrays import Number, Vector
from flexslew_plant.measurement import Measurement


class Action(NamedTuple):
    """The action on a deviation, each part of shape (joints,)."""

    integrand: Vector  # rate of the integral [N m/s or N/s]
    proportional: Vector  # [N m or N]
    derivative: Vector  # [N m or N]


Deviation: TypeAlias = Callable[[Estimate, Reference], Action]


def integral_step(
    demand: Number,
    integral: Number,
    integrand: Number,
    limit: Number,
    tracking_rate: float,
    period: float,
) -> tuple[Number, Number]:
    """Return the effort sat(u) and s a tick later: ds/dt = i + (sat(u) - u) / T_t.

    Args:
        demand: u, with s in it [N m or N].
        integral: s [N m or N].
        integrand: i [N m/s or N/s].
        limit: of the effort [N m or N].
        tracking_rate: 1 / T_t [1/s].
        period: one tick [s].
    """
    effort = np.minimum(np.maximum(demand, -limit), limit)
    return effort, integral + period * (integrand + tracking_rate * (effort - demand))


@dataclass
class IntegralLaw:
    """u = u_ff + p + d + s with back-calculation against windup; see integral_step.

    Args:
        deviation: gives integrand i, proportional p and derivative d.
        limit: of the efforts, shape (joints,) [N m or N].
        tracking_time: T_t [s]; None: the integral winds up.
        period: one tick [s].
        turning: adds w x J w beyond that of the reference to u; None: nothing.
    """

    deviation: Deviation
    limit: Vector
    tracking_time: float | None
    period: float
    turning: Gyroscopic | None = None
    terms: dict[str, Vector] = field(init=False, default_factory=dict)
    _s: Vector = field(init=False)

    def __post_init__(self) -> None:
        """Start with an empty integral."""
        self._s = np.zeros(self.limit.size)
        self._tracking_rate = 0.0 if self.tracking_time is None else 1.0 / self.tracking_time

    @property
    def integration(self) -> Integration:
        """The integral of the linear form."""
        return Integration(True, self._tracking_rate, self.limit)

    def reset(
        self, measurement: Measurement, estimate: Estimate, reference: Reference, effort: Vector
    ) -> None:
        """Choose the integral such that the next effort is `effort`, within the limit."""
        if measurement.tick == 0:
            self._s = np.zeros_like(effort)
            return
        action = self.deviation(estimate, reference)
        self._s = effort - reference.effort - action.proportional - action.derivative
        if self.turning is not None:
            self._s = self._s - self._gyroscopic_excess(self.turning, estimate, reference)

    def update(self, measurement: Measurement, estimate: Estimate, reference: Reference) -> Vector:
        """Return the joint efforts within the limit, shape (joints,) [N m or N]."""
        action = self.deviation(estimate, reference)
        demand = reference.effort + action.proportional + action.derivative + self._s
        excess = {}
        if self.turning is not None:
            excess = {"gyroscopic": self._gyroscopic_excess(self.turning, estimate, reference)}
            demand = demand + excess["gyroscopic"]
        self.terms = {
            "feedforward": reference.effort,
            "proportional": action.proportional,
            "derivative": action.derivative,
            "integral": self._s,
            **excess,
        }
        back = self.limit, self._tracking_rate, self.period
        effort, self._s = integral_step(demand, self._s, action.integrand, *back)
        return effort

    def _gyroscopic_excess(
        self, gyro_torque: Gyroscopic, estimate: Estimate, reference: Reference
    ) -> Vector:
        return gyro_torque.limit_excess(estimate.velocity[: self.limit.size], reference.velocity)
