"""A controller's tick as one function: reference, estimator, law and handover.

It does in one flight what Controller.observe does for a node, which also starts again in later
epochs, takes over from another design, and tests its estimate.
"""

import numpy as np

from flexslew_control.controllers.controller import Controller, handover_effort
from flexslew_control.law import Estimate, Estimator, Law, Reference
from flexslew_plant.arrays import Vector
from flexslew_plant.measurement import Measurement


class ControllerTick:
    """The tick of a controller.

    Args:
        controller: as built, with the plan that it follows.
    """

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self.estimator: Estimator = controller.estimator
        self.law: Law = controller.law
        self.started, self.was_active = False, False
        self.rest: Reference | None = None
        self.offset: Vector = np.zeros(len(controller.joint_names))
        self.passed = 0  # ticks since it took over

    def step(self, measurement: Measurement, active: bool) -> Vector:
        """Return the efforts for the coming tick; zeros while it is not active, shape (joints,)."""
        controller = self.controller
        if self.rest is None:
            self.rest = controller.rest_at(measurement.joint_position)
        reference = controller.plan_sequence.reference(measurement.tick, self.rest)
        expect = getattr(self.estimator, "expect", None)
        if expect is not None:
            expect(reference)
        seen = measurement
        if controller.attitude is not None:
            measured = measurement.joint_position
            position = controller.attitude.about(reference.position, measured)
            seen = measurement._replace(joint_position=position)
        if not self.started:
            self.estimator.reset(seen)
            self.started = True
        estimate = self.estimator.update(seen)
        effort = np.zeros(self.offset.size)
        if active:
            effort = self._effort(seen, estimate, reference)
        self.was_active = active
        return effort

    def _effort(self, seen: Measurement, estimate: Estimate, reference: Reference) -> Vector:
        """Return the law's efforts, and what is left of those of the previous controller."""
        applied, takes_over = seen.applied_effort, not self.was_active
        if takes_over:
            self.law.reset(seen, estimate, reference, applied)
        effort = self.law.update(seen, estimate, reference)
        if takes_over:
            self.passed = 0
            self.offset = np.zeros(self.offset.size)
            if seen.tick > 0:
                self.offset = applied - effort
        if self.passed < self.controller.handover_ticks:
            share = handover_effort(self.offset, self.passed, self.controller.handover_ticks)
            effort = effort + share
        self.passed = self.passed + 1
        return effort
