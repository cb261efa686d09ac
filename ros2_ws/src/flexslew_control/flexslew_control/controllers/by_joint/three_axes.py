"""What a collocated law controls: the joints one by one, or the turn in three axes."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flexslew_control.allocation import (
    AllocationLaw,
    Allocator,
    AnyAllocation,
    allocator_of,
)
from flexslew_control.controllers.by_joint.gyroscopic import Gyroscopic, gyroscopic
from flexslew_control.controllers.linear_form import LinearForm, SharedForm
from flexslew_control.controllers.sampled_loop import SampledPlant, require_sampled_pd
from flexslew_control.estimators.attitude_estimator import AttitudeEstimator
from flexslew_control.estimators.flexible_attitude_tick import flexible_form
from flexslew_control.law import Estimator, Law, PlantDescription, Reference
from flexslew_plant.arrays import EMPTY, Matrix, Vector
from flexslew_plant.testbeds.orientation.attitude import AttitudeJoints

_AXES = ("x", "y", "z")
OF_TESTBED = ("gyroscopic", "allocation", "attitude")  # keys that make a law depend on its testbed


@dataclass(frozen=True)
class BodyAxisPlant:
    """The small motions of a craft with its body axes as joints, and torques as efforts.

    Args:
        motions: small motions with the joints as they are.
        allocator: shares the torques out.
        attitude: the joints that measure the turn.
    """

    motions: SampledPlant
    allocator: Allocator
    attitude: AttitudeJoints

    @property
    def position(self) -> Matrix:
        """From the state to the turn, shape (3, states)."""
        return self.attitude.rotation_vector_of(self.motions.position.T).T

    @property
    def velocity(self) -> Matrix:
        """From the state to the body rates, shape (3, states)."""
        return self.attitude.rotation_vector_of(self.motions.velocity.T).T

    def step(self, period: float) -> tuple[Matrix, Matrix]:
        """Return F and G of x+ = F x + G T over a tick with the torque T held."""
        f, g = self.motions.step(period)
        return f, g @ self.allocator.spread


@dataclass(frozen=True)
class ControlAxes:
    """The joints or axes that a collocated law has gains for.

    Args:
        names: names of these, for errors.
        limit: largest effort along each [N m or N].
        turning: their w x J w; None: not used.
        allocator: shares torques about the body axes out; None: the efforts are those of joints.
        plant: the design model of the law and its bench.
        attitude: the joints that measure the turn, as they stand on the bench; None: none do.
    """

    names: tuple[str, ...]
    limit: Vector
    turning: Gyroscopic | None
    allocator: Allocator | None
    plant: PlantDescription
    attitude: AttitudeJoints | None

    def require_stable(self, kp: Vector, kd: Vector, what: str, ki: Vector | None = None) -> None:
        """Check the sampled loop of these gains; see require_sampled_pd.

        Raises:
            BadInput: if it is not stable at this period.
        """
        model = self.plant.testbed.model()
        require_sampled_pd(model, model.rest({}), kp, kd, self.plant.period, what, ki, self._seen())

    def _seen(self) -> Callable[[SampledPlant], SampledPlant]:
        allocator, attitude = self.allocator, self.plant.testbed.model().attitude
        if allocator is None or attitude is None:
            return lambda motions: motions
        return lambda motions: BodyAxisPlant(motions, allocator, attitude)

    def finished(self, law: Law) -> Law:
        """Return a law of these as one of the joints."""
        if self.allocator is None or self.attitude is None:
            return law
        return AllocationLaw(law, self.allocator, self.attitude)


def control_axes(
    plant: PlantDescription,
    allocation: AnyAllocation | None,
    with_gyroscopic: bool,
    design_model: dict[str, Any] | None = None,
) -> ControlAxes:
    """Return the axes of a law's gains: the joints, or with an allocation the body axes.

    Args:
        plant: what the law is for.
        allocation: allocation of its torque; None: its efforts are those of the joints.
        with_gyroscopic: whether w x J w is used.
        design_model: its `model` section; None: its design model is the testbed.

    Raises:
        BadInput: if the torque cannot be shared out so, or w x J w is used where nothing turns
            in three axes.
    """
    attitude = plant.testbed.model().attitude
    plant = plant if design_model is None else plant.with_design_model(design_model)
    gyro_torque = gyroscopic(plant.testbed, "gyroscopic") if with_gyroscopic else None
    if gyro_torque is not None and attitude is not None:
        gyro_torque = replace(gyro_torque, attitude=attitude)
    if allocation is None:
        return ControlAxes(
            plant.joint_names, plant.effort_limit, gyro_torque, None, plant, attitude
        )
    allocator = allocator_of(allocation, plant)
    if gyro_torque is not None:
        torque = np.tensordot(allocator.torque, gyro_torque.quadratic, axes=1)
        gyro_torque = replace(gyro_torque, attitude=AttitudeJoints(np.eye(3)), quadratic=torque)
    return ControlAxes(_AXES, allocator.limit, gyro_torque, allocator, plant, attitude)


def form_on_axes(
    estimator: Estimator,
    law: Law,
    references: list[Reference],
    form_of: Callable[[Law, Reference], tuple[LinearForm, Gyroscopic | None] | None],
) -> LinearForm | None:
    """Return what `Controlled.finished` has made of a law as matrices; None: there are none.

    Args:
        estimator: of the joints, see joint_estimator.
        law: as finished.
        references: of the joints, tick by tick.
        form_of: returns the form of the law itself without its w x J w, and what adds that, from
            its references in rows, each of shape (ticks, axes).
    """
    shared = attitude = flexible = None
    if isinstance(estimator, AttitudeEstimator):
        attitude, flexible = estimator.numbers, flexible_form(estimator)
    wanted = Reference(
        np.array([reference.position for reference in references]),
        np.array([reference.velocity for reference in references]),
        np.array([reference.effort for reference in references]),
        EMPTY,
    )
    if isinstance(law, AllocationLaw):
        wanted = law.requested(wanted)
        shared = SharedForm(law.allocator.numbers, wanted.position, wanted.velocity)
        law = law.law
    found = form_of(law, wanted)
    if found is None:
        return None
    form, gyro_torque = found
    law_form = form.law
    if gyro_torque is not None:
        plan_torque = gyro_torque.along(wanted.velocity)
        law_form = law_form._replace(
            demand=law_form.demand - plan_torque,
            quadratic=gyro_torque.of_products(law_form.kp.size),
        )
    return form._replace(law=law_form, shared=shared, attitude=attitude, flexible=flexible)
