"""A law of joints that works on the turn of a craft instead, its torque shared out among drives."""

from dataclasses import dataclass, field

import numpy as np

from flexslew_control.allocation.allocation import Allocator
from flexslew_control.law import Estimate, Law, Reference
from flexslew_plant.arrays import Vector
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds.orientation.attitude import AttitudeJoints


@dataclass
class AllocationLaw:
    """Takes the torque about the body axes from a law, and the efforts from an allocator.

    The joints of the law are the body axes: the rotation vector and rates that the joints measure,
    and the torque of the plan's efforts, whichever drives the plan meant.

    Args:
        law: law with three joints and three torques.
        allocator: shares the torques out among the drives.
        attitude: the joints that measure the turn.
    """

    law: Law
    allocator: Allocator
    attitude: AttitudeJoints
    terms: dict[str, Vector] = field(init=False, default_factory=dict)

    def reset(
        self, measurement: Measurement, estimate: Estimate, reference: Reference, effort: Vector
    ) -> None:
        """Become active with the torque that these efforts have given; see law.Law."""
        seen, wanted = self._body_axes(estimate, reference)
        self.law.reset(measurement, seen, wanted, self.allocator.torque @ effort)

    def update(self, measurement: Measurement, estimate: Estimate, reference: Reference) -> Vector:
        """Return the efforts of all joints, shape (joints,) [N m or N]."""
        seen, wanted = self._body_axes(estimate, reference)
        effort = self.allocator.efforts(self.law.update(measurement, seen, wanted), measurement)
        spread = self.allocator.spread
        self.terms = {name: spread @ torque for name, torque in self.law.terms.items()}
        self.terms["allocation"] = effort - sum(self.terms.values(), np.zeros(effort.size))
        return effort

    def requested(self, reference: Reference) -> Reference:
        """Return a reference as the law sees it, or many in rows."""
        return reference._replace(
            position=self.attitude.rotation_vector_of(reference.position),
            velocity=self.attitude.rotation_vector_of(reference.velocity),
            effort=reference.effort @ self.allocator.torque.T,
        )

    def _body_axes(self, estimate: Estimate, reference: Reference) -> tuple[Estimate, Reference]:
        """Return estimate and reference as the law sees them."""
        n, rotation = len(self.attitude.axes), self.attitude.rotation_vector_of
        seen = estimate._replace(
            position=rotation(estimate.position[:n]), velocity=rotation(estimate.velocity[:n])
        )
        return seen, self.requested(reference)
