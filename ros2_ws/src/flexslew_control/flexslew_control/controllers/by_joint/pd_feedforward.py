"""PD + feedforward: collocated feedback of the joints about the plan.

Gorinevsky and Vukovich 1998, eqs 12-13.
"""

import numpy as np

from flexslew_control.allocation import Allocation
from flexslew_control.controllers.by_joint.gyroscopic import Gyroscopic
from flexslew_control.controllers.by_joint.three_axes import OF_TESTBED, control_axes, form_on_axes
from flexslew_control.controllers.entry import LawEntry
from flexslew_control.controllers.linear_form import LinearForm, collocated_form, no_integral
from flexslew_control.estimators.attitude_estimator import (
    AttitudeFilterSettings,
    joint_estimator,
)
from flexslew_control.law import (
    Estimate,
    Estimator,
    Law,
    PlantDescription,
    Reference,
    per_joint,
)
from flexslew_plant.arrays import Number, Vector
from flexslew_plant.measurement import Measurement
from flexslew_plant.settings import PerJoint, section


@section
class PdFeedforwardSettings:
    """PD of each joint about the plan, plus the plan's effort (17).

    Gains are one per joint; a single value serves every joint.
    """

    kp: PerJoint = (460.0,)  # proportional gain, one per joint, or one for all [N m/rad]
    kd: PerJoint = (920.0,)  # derivative gain, one per joint, or one for all [N m s/rad]
    # add w x J w, beyond that of the plan, of a craft that turns in three axes
    gyroscopic: bool = False
    # attitude and rates by gyro and star tracker; null: as the joints read them
    attitude: AttitudeFilterSettings | None = None
    # share the torque about the body axes, which the gains are then of, out among thrusters,
    # wheels or gyros; null: every joint has its own gains
    allocation: Allocation | None = None


def pd_step(
    kp: Number, kd: Number, feedforward: Number, error: Number, rate_error: Number
) -> tuple[Number, Number, Number]:
    """Return u = u_ff + Kp e + Kd e' of (12), (13), and its last two terms [N m or N]."""
    proportional, derivative = kp * error, kd * rate_error
    return feedforward + proportional + derivative, proportional, derivative


class PdFeedforward:
    """See pd_step, and w x J w beyond that of the reference."""

    def __init__(self, kp: Vector, kd: Vector, gyro_torque: Gyroscopic | None = None) -> None:
        self.kp, self.kd, self.turning = kp, kd, gyro_torque
        self.terms: dict[str, Vector] = {}

    def reset(
        self, measurement: Measurement, estimate: Estimate, reference: Reference, effort: Vector
    ) -> None:
        """Nothing to choose: the law has no free state."""

    def update(self, measurement: Measurement, estimate: Estimate, reference: Reference) -> Vector:
        """Return the torques, shape (joints,) [N m or N]."""
        n = self.kp.size
        error = reference.position - estimate.position[:n]
        rate_error = reference.velocity - estimate.velocity[:n]
        terms = pd_step(self.kp, self.kd, reference.effort, error, rate_error)
        effort, proportional, derivative = terms
        self.terms = {
            "feedforward": reference.effort,
            "proportional": proportional,
            "derivative": derivative,
        }
        if self.turning is None:
            return effort
        excess = self.turning.limit_excess(estimate.velocity[:n], reference.velocity)
        self.terms["gyroscopic"] = excess
        return effort + excess


def build(settings: PdFeedforwardSettings, plant: PlantDescription) -> tuple[Estimator, Law]:
    """Return the estimator and the law.

    Args:
        settings: the gains.
        plant: what the law is for.

    Raises:
        BadInput: neither one gain nor one per joint, not stable at this period, or gyroscopic or
            with an allocation on a testbed that does not turn in three axes, or without the
            sensors of an attitude.
    """
    what = control_axes(plant, settings.allocation, settings.gyroscopic)
    kp, kd = per_joint("kp", settings.kp, what.names), per_joint("kd", settings.kd, what.names)
    what.require_stable(kp, kd, "pd_feedforward")
    law = what.finished(PdFeedforward(kp, kd, what.turning))
    return joint_estimator(plant, settings.attitude), law


def linear(estimator: Estimator, law: Law, references: list[Reference]) -> LinearForm | None:
    """Return the law as matrices; see LawEntry."""
    return form_on_axes(estimator, law, references, _form)


def _form(law: Law, reference: Reference) -> tuple[LinearForm, Gyroscopic | None] | None:
    if not isinstance(law, PdFeedforward):
        return None
    none, integration = np.zeros(law.kp.size), no_integral(law.kp.size)
    return collocated_form(law.kp, none, law.kd, reference.effort, integration), law.turning


PD_FEEDFORWARD = LawEntry(
    "pd_feedforward",
    PdFeedforwardSettings,
    build,
    linear=linear,
    batch_gains=("kp", "kd"),
    of_testbed=OF_TESTBED,
    takes_over=True,
)
