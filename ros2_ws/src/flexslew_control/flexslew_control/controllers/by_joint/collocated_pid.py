"""Collocated PID: one loop a joint on its own encoder, with feedforward and anti-windup."""

from dataclasses import dataclass

import numpy as np

from flexslew_control.allocation import Allocation
from flexslew_control.controllers.by_joint.gyroscopic import Gyroscopic
from flexslew_control.controllers.by_joint.integral_action import Action, IntegralLaw
from flexslew_control.controllers.by_joint.three_axes import OF_TESTBED, control_axes, form_on_axes
from flexslew_control.controllers.entry import LawEntry
from flexslew_control.controllers.linear_form import LinearForm, collocated_form
from flexslew_control.controllers.sampled_loop import integral_loop
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
from flexslew_control.linear.design_checks import (
    OperatingPoint,
    operating_point_of,
    require_stable,
    state_names,
)
from flexslew_control.shared_keys import DesignModel, TrackingTime
from flexslew_plant.arrays import Vector
from flexslew_plant.settings import PerJoint, section


@section
class CollocatedPid:
    """PID of each joint on its own encoder, plus the plan's effort.

    One number per joint, or one for all.
    """

    kp: PerJoint = (460.0,)  # one per joint, or one for all [N m/rad]
    ki: PerJoint = (15.0,)  # one per joint, or one for all [N m/(rad s)]
    kd: PerJoint = (920.0,)  # one per joint, or one for all [N m s/rad]
    tracking_time: TrackingTime = 10.0
    model: DesignModel = None
    operating_point: OperatingPoint = None
    gyroscopic: bool = False  # add w x J w, beyond that of the plan, of a craft in three axes
    # attitude and rates by gyro and star tracker; null: as the joints read them
    attitude: AttitudeFilterSettings | None = None
    # share the torque about the body axes, which the gains are then of, out among thrusters,
    # wheels or gyros; null: every joint has its own gains
    allocation: Allocation | None = None


@dataclass(frozen=True)
class JointDeviation:
    """Ki e, Kp e and Kd e' of e = reference - measured; gains of shape (joints,)."""

    kp: Vector
    ki: Vector
    kd: Vector

    def __call__(self, estimate: Estimate, reference: Reference) -> Action:
        """Return the action on the deviation of the joints."""
        m = self.kp.size
        e = reference.position - estimate.position[:m]
        rate = reference.velocity - estimate.velocity[:m]
        return Action(self.ki * e, self.kp * e, self.kd * rate)


def build(settings: CollocatedPid, plant: PlantDescription) -> tuple[Estimator, Law]:
    """Return the estimator of the joints and the law.

    Raises:
        BadInput: neither one gain nor one per joint, gains that do not stabilise the operating
            point, or a testbed that lacks the sensors of an attitude or turns in fewer axes.
    """
    model = plant.design_model(settings.model)
    what = control_axes(plant, settings.allocation, settings.gyroscopic, settings.model)
    given = (("kp", settings.kp), ("ki", settings.ki), ("kd", settings.kd))
    kp, ki, kd = (per_joint(name, gains, what.names) for name, gains in given)
    linear = model.linearise(operating_point_of(plant, model, settings.operating_point))
    if model.leading is None:  # else motions that no effort reaches are at rest for ever
        integrals = [
            f"integral of {name}" for name, k in zip(what.names, ki, strict=True) if k > 0.0
        ]
        names = (*state_names(model), *integrals)
        p, d, i = (np.diag(each) @ linear.input_matrix.T for each in (kp, kd, ki))
        loop = integral_loop(linear, p, d, i, None)
        require_stable(loop, names, "collocated_pid with these gains")
    what.require_stable(kp, kd, "collocated_pid", ki)
    deviation = JointDeviation(kp, ki, kd)
    law = IntegralLaw(deviation, what.limit, settings.tracking_time, plant.period, what.turning)
    return joint_estimator(plant, settings.attitude), what.finished(law)


def linear(estimator: Estimator, law: Law, references: list[Reference]) -> LinearForm | None:
    """Return the law as matrices; see LawEntry."""
    return form_on_axes(estimator, law, references, _form)


def _form(law: Law, reference: Reference) -> tuple[LinearForm, Gyroscopic | None] | None:
    if not isinstance(law, IntegralLaw):
        return None
    gains = law.deviation
    assert isinstance(gains, JointDeviation)
    form = collocated_form(gains.kp, gains.ki, gains.kd, reference.effort, law.integration)
    return form, law.turning


COLLOCATED_PID = LawEntry(
    "collocated_pid",
    CollocatedPid,
    build,
    linear=linear,
    batch_gains=("kp", "ki", "kd"),
    of_testbed=OF_TESTBED,
    checked=True,
    takes_over=True,
)
