"""The floating oscillator: a driven mass, a spring and a free mass.

Liu and Singh (1997), section 3.2.

Coordinates: x_1, where the driven mass is [m], then the stretch q = x_2 - x_1 [m], which stands
where other testbeds have the deflection of a tip. In these (8), (9) read
    (m_1 + m_2) x_1'' + m_2 q'' = u,    m_2 x_1'' + m_2 q'' + d q' + k q = 0.
"""

from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.settings import Positive, section
from flexslew_plant.testbeds.contract import require_no_payload
from flexslew_plant.testbeds.entry import TestbedEntry
from flexslew_plant.testbeds.initial.initial_motion import InitialMotion
from flexslew_plant.testbeds.kernels import Kernels
from flexslew_plant.testbeds.model import Appendages, Model
from flexslew_plant.testbeds.scene import Scene, slider

JOINTS = ("mass",)
JOINT_UNITS = ("m",)
# where the packed parameters lie
_TOTAL, _FREE, _STIFFNESS, _DAMPING = 0, 1, 2, 3


@section
class FloatingOscillatorParameters:
    """The benchmark of Liu and Singh (1997): everything is one."""

    driven_mass: Positive = 1.0  # m_1 [kg]
    free_mass: Positive = 1.0  # m_2 [kg]
    stiffness: Positive = 1.0  # k [N/m]


@section
class FloatingOscillatorInitial:
    """Where the driven mass rests at the start, the spring relaxed, and how the free mass moves."""

    mass: float = 0.0  # x_1(0) [m]
    free_mass_rate: float = 0.0  # x_2'(0) after an impulse m_2 x_2'(0) on the free mass [m/s]


@section
class FloatingOscillatorTestbed:
    """A driven mass, a spring and a free mass (Liu and Singh)."""

    # two masses and a spring (Liu and Singh, 1997)
    kind: Literal["floating_oscillator"] = "floating_oscillator"
    modes: Literal[1] = 1  # number of modes
    # damping ratio of the spring, mass held [-]
    damping_ratio: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    # numbers of the testbed
    parameters: FloatingOscillatorParameters = FloatingOscillatorParameters()
    # joint positions at the start, at rest
    initial: FloatingOscillatorInitial = FloatingOscillatorInitial()
    initial_motion: InitialMotion | None = None  # rates and deflections at the start; null: at rest
    effort_limit: tuple[Positive] = (1.0,)  # force limit of the drive [N]

    operating_point: ClassVar[dict[str, float]] = {}
    typical_goal: ClassVar[dict[str, float]] = {"mass": 1.0}
    simplified: ClassVar[dict[str, Any]] = {}

    def model(self) -> Model:
        """Return the equations of motion."""
        return Model(
            KERNELS,
            packed(self),
            JOINTS,
            JOINT_UNITS,
            self.modes,
            # its stretch stands where others have the deflection of a tip
            Appendages(("spring",), np.ones((1, 1)), np.zeros((1, 1))),
            scale_stiffness=scale_stiffness,
        )

    def initial_rates(self) -> Vector:
        """Return v at the start: what an impulse on the free mass leaves, shape (2,) [m/s]."""
        return np.array([0.0, self.initial.free_mass_rate])

    def scaled(self, stiffness: float = 1.0, payload: float = 1.0) -> "FloatingOscillatorTestbed":
        """Return it with another stiffness, as a factor [-].

        Raises:
            BadInput: if another payload is requested.
        """
        require_no_payload(self.kind, payload)
        p = self.parameters
        return replace(self, parameters=replace(p, stiffness=p.stiffness * stiffness))

    def scene(self) -> Scene:
        """Return how it is drawn."""
        p = self.parameters
        return slider(self.kind, JOINTS[0], 0.3, 2.0, (p.driven_mass, p.free_mass))


def packed(testbed: FloatingOscillatorTestbed) -> Vector:
    """Return [m_1 + m_2, m_2, k, d] as the kernels read them, shape (4,)."""
    p = testbed.parameters
    damping = 2.0 * testbed.damping_ratio * np.sqrt(p.stiffness * p.free_mass)
    return np.array([p.driven_mass + p.free_mass, p.free_mass, p.stiffness, damping])


def scale_stiffness(p: Vector, factor: float) -> Vector:
    """Return the packed parameters with the stiffness k multiplied by factor [-]."""
    scaled = p.copy()
    scaled[_STIFFNESS] *= factor
    scaled[_DAMPING] *= np.sqrt(factor)
    return scaled


def terms(
    p: Vector, t: float, x: Vector, joints: Matrix, coupling: Matrix, modal: Vector, bias: Vector
) -> None:
    """Write M and h(q, v) of M a + h = B u; see csa.equations.terms for the arguments."""
    joints[0, 0] = p[_TOTAL]
    coupling[0, 0] = p[_FREE]
    modal[0] = p[_FREE]
    bias[0] = 0.0
    bias[1] = p[_STIFFNESS] * x[1] + p[_DAMPING] * x[3]


def residual_jacobian(p: Vector, t: float, x: Vector, a: Vector, dq: Matrix, dv: Matrix) -> None:
    """Write dr/dq and dr/dv of r = M a + h; see csa.equations.residual_jacobian."""
    dq[:] = 0.0
    dv[:] = 0.0
    dq[1, 1] = p[_STIFFNESS]
    dv[1, 1] = p[_DAMPING]


def potential(p: Vector, t: float, q: Vector) -> float:
    """Return the strain energy of the spring [J]."""
    return float(0.5 * p[_STIFFNESS] * q[1] ** 2)


KERNELS = Kernels(terms, residual_jacobian, potential)


OSCILLATOR = TestbedEntry(FloatingOscillatorTestbed)
