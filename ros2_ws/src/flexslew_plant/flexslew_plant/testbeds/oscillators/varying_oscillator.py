"""A loaded oscillator with a stiffness that varies with time: the plainest plant that does.

Example 3 of Kwak's dissertation on retargeting antennas (chapter 3):
    m u'' + d u' + (k + k_a sin(2 pi f t)) u = force + load.
"""

from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds.contract import require_no_payload
from flexslew_plant.testbeds.entry import TestbedEntry
from flexslew_plant.testbeds.initial.initial_motion import InitialMotion
from flexslew_plant.testbeds.kernels import Kernels
from flexslew_plant.testbeds.model import Appendages, Model
from flexslew_plant.testbeds.scene import Scene, slider

JOINTS = ("mass",)
# where the packed parameters lie
_MASS, _DAMPING, _STIFFNESS, _SWING, _RATE, _LOAD, _PHASE = 0, 1, 2, 3, 4, 5, 6


@section
class VaryingOscillatorParameters:
    """The numbers of Example 3."""

    mass: Positive = 1.0  # m [kg]
    stiffness: Positive = 100.0  # k [N/m]
    stiffness_swing: NonNegative = 10.0  # k_a [N/m]
    frequency: NonNegative = 1.0  # f [Hz]
    load: float = 100.0  # constant [N]


@section
class VaryingOscillatorInitial:
    """Where the mass rests at the start."""

    mass: float = 0.0  # u(0) [m]


@section
class VaryingOscillatorTestbed:
    """A loaded mass on a spring whose stiffness varies with time."""

    # the simplest plant that depends on time
    kind: Literal["varying_oscillator"] = "varying_oscillator"
    modes: Literal[0] = 0  # number of modes
    # damping ratio at the mean stiffness [-]
    damping_ratio: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    # numbers of the testbed
    parameters: VaryingOscillatorParameters = VaryingOscillatorParameters()
    # where it starts
    initial: VaryingOscillatorInitial = VaryingOscillatorInitial()
    initial_motion: InitialMotion | None = None  # rates and deflections at the start; null: at rest
    effort_limit: tuple[Positive] = (1000.0,)  # force limit of the drive [N]

    operating_point: ClassVar[dict[str, float]] = {}
    typical_goal: ClassVar[dict[str, float]] = {"mass": 0.0}
    simplified: ClassVar[dict[str, Any]] = {}

    def model(self) -> Model:
        """Return the equations of motion."""
        empty = np.zeros((0, 0))
        appendages = Appendages((), empty, empty)
        return Model(
            KERNELS,
            packed(self),
            JOINTS,
            ("m",),
            0,
            appendages,
            scale_stiffness=scale_stiffness,
            time_varying=self.parameters.stiffness_swing > 0.0,
            from_time=shift_time,
        )

    def scaled(self, stiffness: float = 1.0, payload: float = 1.0) -> "VaryingOscillatorTestbed":
        """Return it with another stiffness, its swing included, as a factor [-].

        Raises:
            BadInput: if another payload is requested.
        """
        require_no_payload(self.kind, payload)
        p = self.parameters
        other = replace(
            p, stiffness=p.stiffness * stiffness, stiffness_swing=p.stiffness_swing * stiffness
        )
        return replace(self, parameters=other)

    def scene(self) -> Scene:
        """Return how it is drawn."""
        return slider(self.kind, JOINTS[0], 0.3, 2.0, (self.parameters.mass,))


def packed(testbed: VaryingOscillatorTestbed) -> Vector:
    """Return [m, d, k, k_a, 2 pi f, load, phase], shape (7,)."""
    p = testbed.parameters
    damping = 2.0 * testbed.damping_ratio * np.sqrt(p.stiffness * p.mass)
    rate = 2.0 * np.pi * p.frequency
    return np.array([p.mass, damping, p.stiffness, p.stiffness_swing, rate, p.load, 0.0])


def scale_stiffness(p: Vector, factor: float) -> Vector:
    """Return the packed parameters with the stiffness and its swing times factor [-]."""
    scaled = p.copy()
    scaled[_STIFFNESS] *= factor
    scaled[_SWING] *= factor
    scaled[_DAMPING] *= np.sqrt(factor)
    return scaled


def shift_time(p: Vector, time: float) -> Vector:
    """Return the packed parameters with their time zero at this time [s]."""
    shifted = p.copy()
    shifted[_PHASE] += p[_RATE] * time
    return shifted


def terms(
    p: Vector, t: float, x: Vector, joints: Matrix, coupling: Matrix, modal: Vector, bias: Vector
) -> None:
    """Write M and h(q, v, t) of M a + h = B u; see kernels.Kernels for the arguments."""
    stiffness = p[_STIFFNESS] + p[_SWING] * np.sin(p[_RATE] * t + p[_PHASE])
    joints[0, 0] = p[_MASS]
    bias[0] = stiffness * x[0] + p[_DAMPING] * x[1] - p[_LOAD]


def residual_jacobian(p: Vector, t: float, x: Vector, a: Vector, dq: Matrix, dv: Matrix) -> None:
    """Write the partial derivatives of M a + h at fixed a."""
    dq[0, 0] = p[_STIFFNESS] + p[_SWING] * np.sin(p[_RATE] * t + p[_PHASE])
    dv[0, 0] = p[_DAMPING]


def potential(p: Vector, t: float, q: Vector) -> float:
    """Return the energy of spring and load [J]."""
    stiffness = p[_STIFFNESS] + p[_SWING] * np.sin(p[_RATE] * t + p[_PHASE])
    return float(0.5 * stiffness * q[0] ** 2 - p[_LOAD] * q[0])


KERNELS = Kernels(terms, residual_jacobian, potential)


VARYING = TestbedEntry(VaryingOscillatorTestbed)
