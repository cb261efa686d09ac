"""A testbed of one's own: three hinged bodies in a row, a flexible boom on the last one.

    testbed: {kind: docs/examples/three_joints.py:ThreeJoints}

Joints base, arm and wrist turn bodies of inertia I_1, I_2, I_3 about one axis, each relative to the
body before it; the boom bends in n modes q, clamped to the last body. With the absolute angles
a_1 = base, a_2 = a_1 + arm, a_3 = a_2 + wrist the energies are
    2 T = sum I_i a_i'^2 + 2 a_3' c^T q' + m q'^T q',    2 U = q^T K q.
"""

from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds import Appendages, Model
from flexslew_plant.testbeds.kernels import Kernels
from flexslew_plant.testbeds.scene import Scene, schematic

JOINTS = ("base", "arm", "wrist")


def terms(
    p: Vector, t: float, x: Vector, joints: Matrix, coupling: Matrix, modal: Vector, bias: Vector
) -> None:
    """Write M and h. p = [I_1, I_2, I_3, then c, m, k, d of each mode]."""
    n = (p.size - 3) // 4
    for i in range(3):
        for j in range(3):
            # body k turns with every joint up to k
            joints[i, j] = 0.0
            for k in range(max(i, j), 3):
                joints[i, j] += p[k]
        bias[i] = 0.0
    for k in range(n):
        for i in range(3):
            coupling[i, k] = p[3 + k]
        modal[k] = p[3 + n + k]
        bias[3 + k] = p[3 + 2 * n + k] * x[3 + k] + p[3 + 3 * n + k] * x[6 + n + k]


def residual_jacobian(p: Vector, t: float, x: Vector, a: Vector, dq: Matrix, dv: Matrix) -> None:
    """Write the partial derivatives of M a + h at fixed a."""
    n = (p.size - 3) // 4
    dq[:] = 0.0
    dv[:] = 0.0
    for k in range(n):
        dq[3 + k, 3 + k] = p[3 + 2 * n + k]
        dv[3 + k, 3 + k] = p[3 + 3 * n + k]


def potential(p: Vector, t: float, q: Vector) -> float:
    """Return the strain energy of the boom [J]."""
    n = (p.size - 3) // 4
    energy = 0.0
    for k in range(n):
        energy += 0.5 * p[3 + 2 * n + k] * q[3 + k] ** 2
    return energy


def stiffened(p: Vector, factor: float) -> Vector:
    """Return p with the stiffness of every mode times factor [-], damping ratios kept."""
    n, out = (p.size - 3) // 4, p.copy()
    out[3 + 2 * n : 3 + 3 * n] *= factor
    out[3 + 3 * n :] *= np.sqrt(factor)
    return out


KERNELS = Kernels(terms, residual_jacobian, potential)


@section
class ThreeJoints:
    """The `testbed` section: what the user may set, checked on the way in."""

    kind: str = "docs/examples/three_joints.py:ThreeJoints"
    modes: Annotated[int, Field(ge=1, le=3)] = 2
    inertias: tuple[Positive, Positive, Positive] = (60.0, 30.0, 15.0)  # of the bodies [kg m^2]
    first_frequency: Positive = 2.0  # of the boom, clamped [rad/s]
    boom_mass: Positive = 4.0  # modal mass of each mode [kg]
    damping_ratio: NonNegative = 0.0  # of every mode [-]
    initial: dict[str, float] = Field(default_factory=dict)  # by joint [rad]
    effort_limit: tuple[Positive, Positive, Positive] = (40.0, 30.0, 20.0)  # [N m]

    operating_point: ClassVar[dict[str, float]] = {}
    typical_goal: ClassVar[dict[str, float]] = {"base": 0.5, "arm": -0.4, "wrist": 0.3}
    simplified: ClassVar[dict[str, Any]] = {"modes": 1}

    def model(self) -> Model:
        """Return the equations of motion."""
        order = np.arange(1, self.modes + 1, dtype=np.float64)
        mass = np.full(self.modes, self.boom_mass)
        stiffness = mass * (self.first_frequency * (2.0 * order - 1.0) ** 2) ** 2
        damping = 2.0 * self.damping_ratio * np.sqrt(mass * stiffness)
        lever = 5.0 / order**2  # c, of each mode [kg m]
        packed = np.concatenate((self.inertias, lever, mass, stiffness, damping))
        tip = np.ones((1, self.modes))  # every mode is scaled to one at the tip
        boom = Appendages(("boom",), tip, 0.0 * tip)
        return Model(
            KERNELS, packed, JOINTS, ("rad",) * 3, self.modes, boom, scale_stiffness=stiffened
        )

    def scaled(self, stiffness: float = 1.0, payload: float = 1.0) -> "ThreeJoints":
        """Return it with another boom stiffness and another last body, as factors [-]."""
        from dataclasses import replace

        first, second, last = self.inertias
        return replace(
            self,
            first_frequency=self.first_frequency * stiffness**0.5,
            inertias=(first, second, last * payload),
        )

    def scene(self) -> Scene:
        """Return how it is drawn."""
        return schematic(self.kind, JOINTS, ("boom",), np.ones((1, self.modes)))
