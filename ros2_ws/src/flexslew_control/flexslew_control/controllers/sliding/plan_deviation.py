"""What output feedback control of a free craft is designed for: its deviation from the plan."""

from dataclasses import dataclass, field

import numpy as np

from flexslew_control.controllers.sliding.design_model import Mask, inverse
from flexslew_control.law import Estimate, Reference
from flexslew_control.linear.free_platform import nominal
from flexslew_control.linear.rate_dependent_platform import RateDependentPlatform
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.measurement import Measurement


@dataclass
class PlanDeviation:
    """(z - z*)' = A(w) (z - z*) + B (u - u_d) about the rates w of the plan.

    z are joints and modes as a RotationFilter estimates them: the reference plus their deviation,
    of the attitude a rotation in body axes. So z* has no modes, and the equivalent efforts cancel
    what A(w) does: the hypersurface is reached as fast at every rate of the plan.

    Args:
        craft: A and B.
        turning: whether A is that of the plan's rates; False: that of rest.
    """

    craft: RateDependentPlatform
    turning: bool
    _rest: Matrix = field(init=False)
    _joint_rows: Mask = field(init=False)

    def __post_init__(self) -> None:
        """Precompute what does not change."""
        small = self.craft.small
        self._rest = small.linear.state_matrix
        self._joint_rows = np.tile(np.arange(small.coordinates) < small.joints, 2)

    @property
    def joint_rows(self) -> Mask:
        """Which entries of z are joints and their rates, shape (2 n,)."""
        return self._joint_rows

    def drift(self, z: Vector, reference: Reference) -> Vector:
        """Return A (z - z*), shape (2 n,)."""
        a = self.craft.state_matrix(reference.velocity) if self.turning else self._rest
        drift: Vector = a @ (z - nominal(self.craft.small, reference))
        return drift

    def effectiveness(self, z: Vector, surface: Matrix) -> Matrix:
        """Return (G B)^-1, shape (joints, joints)."""
        return inverse(surface @ self.craft.input_matrix)

    def nominal_state(self, reference: Reference) -> tuple[Vector, Vector]:
        """Return z*, and B u_d as the part of its derivative that efforts give."""
        plan_effort: Vector = self.craft.input_matrix @ reference.effort
        return nominal(self.craft.small, reference), plan_effort

    def on_bench(self, effort: Vector) -> Vector:
        """Return the efforts as they are."""
        return effort

    def platform(self, measurement: Measurement, reference: Reference) -> dict[str, Vector]:
        """Return nothing: z holds every joint."""
        return {}

    def state(self, estimate: Estimate) -> Vector:
        """Return [q, v]."""
        return np.concatenate((estimate.position, estimate.velocity))
