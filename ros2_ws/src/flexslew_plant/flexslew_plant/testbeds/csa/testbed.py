"""The CSA two-motor testbed: base yaw, hub pitch and two flexible beams.

Gorinevsky and Vukovich (1998), section 2.

Coordinates: joints (theta, psi) [rad], then modal coordinates q_j [m] with phi_j(L) = 1.
Variants:
    printed   equations (9)-(11) as printed;
    complete  with the kinetic energy term sin(psi) theta' psi' m^T q that (1) leaves out.
"""

from dataclasses import replace
from functools import lru_cache
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

import numpy as np
from pydantic import Field
from scipy.integrate import cumulative_simpson

from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds.beam import ClampedFreeBeam
from flexslew_plant.testbeds.contract import ShapedMotion
from flexslew_plant.testbeds.csa.equations import KERNELS, highest_frequency, stiffened, unpacked
from flexslew_plant.testbeds.entry import TestbedEntry
from flexslew_plant.testbeds.model import Appendages, Model
from flexslew_plant.testbeds.scene import POINTS, Scene, rod, turntable

JOINTS = ("base_yaw", "hub_pitch")
JOINT_UNITS = ("rad", "rad")
CsaVariant: TypeAlias = Literal["printed", "complete"]
_STEEPEST = 1.5  # largest pitch of a shaped slew [rad]


@section
class CsaParameters:
    """Table 1 of Gorinevsky and Vukovich (1998); another testbed is other numbers here."""

    length: Positive = 30.0  # L [m]
    linear_density: Positive = 0.2  # mu [kg/m]
    bending_stiffness: Positive = 1500.0  # EI [N m^2]
    hub_radius: NonNegative = 1.0  # a [m]
    base_inertia: Positive = 2000.0  # J [kg m^2]
    hub_inertia_1: Positive = 2000.0  # I_1, about the beams' axis and the vertical [kg m^2]
    hub_inertia_2: Positive = 2000.0  # I_2, about the pitch axis [kg m^2]


@section
class CsaInitial:
    """Where the joints rest at the start; the beams are straight."""

    base_yaw: float = 0.0  # theta(0) [rad]
    hub_pitch: float = 0.0  # psi(0) [rad]


@section
class CsaTestbed:
    """The `testbed` section for kind csa."""

    kind: Literal["csa"] = "csa"  # the two-joint testbed of Gorinevsky and Vukovich (1998)
    # form of the equations: printed (as in the paper) or complete (with the term that the paper
    # omits)
    variant: CsaVariant = "complete"
    modes: Annotated[int, Field(ge=1, le=12)] = 3  # number of modes of each beam
    # damping ratio of every beam mode [-]
    damping_ratio: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    parameters: CsaParameters = CsaParameters()  # numbers of the testbed
    initial: CsaInitial = CsaInitial()  # joint positions at the start, at rest
    # torque limits of the drives, one per joint [N m]
    effort_limit: tuple[Positive, Positive] = (150.0, 150.0)

    operating_point: ClassVar[dict[str, float]] = {"hub_pitch": 0.5}
    typical_goal: ClassVar[dict[str, float]] = {"base_yaw": 1.0, "hub_pitch": 0.5}
    simplified: ClassVar[dict[str, Any]] = {"modes": 1}

    def model(self) -> Model:
        """Return the equations of motion."""
        return _model(self)

    def highest_frequency(self) -> float:
        """Return a bound of its frequencies; see compiled.lanes.KnowsFrequency.

        max(K_qq / M_qq) / (1 - sum of m^2 / (M_qq J)) with J all that turns bounds their squares.
        """
        return highest_frequency(_model(self).packed)

    def scaled(self, stiffness: float = 1.0, payload: float = 1.0) -> "CsaTestbed":
        """Return it with other beams (EI) and another hub (I_1 and I_2), as factors [-]."""
        p = self.parameters
        parameters = replace(
            p,
            bending_stiffness=p.bending_stiffness * stiffness,
            hub_inertia_1=p.hub_inertia_1 * payload,
            hub_inertia_2=p.hub_inertia_2 * payload,
        )
        return replace(self, parameters=parameters)

    def shaped_motion(
        self, path: Vector, rate: Vector, first: Vector, last: Vector, h: float
    ) -> ShapedMotion:
        """Return the motion whose drive of the modes is a shaped command; see contract.Shaped.

        The pitch follows the command. The modes are driven by w = d/dt(theta' cos psi), on the
        complete model less theta' psi' sin psi. So with k = 1 there and 0 on the printed one
            theta' cos(psi)^(1 + k) = integral of w cos(psi)^k,
        which is zero at the end, as theta' must be, for one mixture w = alpha (p'' + beta p');
        alpha brings theta to its goal.

        Raises:
            BadInput: the beams come too near to the yaw axis, about which nothing moves them.
        """
        for at in (first[1], last[1]):
            if not abs(at) <= _STEEPEST:
                raise BadInput(
                    f"a shaped slew keeps within -{_STEEPEST:g} and {_STEEPEST:g} rad, where yaw "
                    "moves the appendages",
                    key="hub_pitch",
                    value=at,
                )
        span = last - first
        pitch, pitching = first[1] + span[1] * path, span[1] * rate
        cosine, sine = np.cos(pitch), np.sin(pitch)
        complete = self.variant == "complete"
        lever = cosine if complete else np.ones(path.size)
        # the integral of lever p'' by parts: p'' jumps, p' does not
        slowing = sine * pitching if complete else np.zeros(path.size)
        first_part = lever * rate + cumulative_simpson(slowing * rate, dx=h, initial=0.0)
        second_part = cumulative_simpson(lever * rate, dx=h, initial=0.0)
        beta = -first_part[-1] / second_part[-1]
        turning = (first_part + beta * second_part) / (lever * cosine)
        turned = cumulative_simpson(turning, dx=h, initial=0.0)
        alpha = span[0] / turned[-1]
        # the mean of w over each interval is exact, wherever p'' jumps
        drive = alpha / h * (np.diff(rate) + beta * np.diff(path))
        return ShapedMotion(
            np.column_stack((first[0] + alpha * turned, pitch)),
            np.column_stack((alpha * turning, pitching)),
            np.column_stack((drive, np.zeros(drive.size))),
        )

    def energies(self, symbols: Any, q: Any, v: Any) -> tuple[Any, Any, Any]:
        """Return kinetic and potential energy and dissipation in symbols; contract.Symbolic."""
        p, mode, rate = unpacked(packed(self)), q[2:], v[2:]
        c, s = symbols.cos(q[1]), symbols.sin(q[1])
        kinetic = 0.5 * (p.j_1 + p.j_a * c**2) * v[0] ** 2 + 0.5 * p.j_2 * v[1] ** 2
        kinetic += c * v[0] * symbols.dot(p.coupling, rate) + 0.5 * symbols.dot(p.mass, rate**2)
        if p.complete:
            kinetic += s * v[0] * v[1] * symbols.dot(p.coupling, mode)
        potential = 0.5 * symbols.dot(p.stiffness, mode**2)
        return kinetic, potential, 0.5 * symbols.dot(p.damping, rate**2)

    def scene(self) -> Scene:
        """Return how it is drawn."""
        b = beam(self)
        shapes = b.shape(np.linspace(0.0, b.length, POINTS))
        p = self.parameters
        i_1, i_2 = p.hub_inertia_1, p.hub_inertia_2
        base, hub = (p.base_inertia,) * 3, (i_1, i_2, i_1)
        boom = rod(p.linear_density * b.length, b.length)
        return turntable(self.kind, JOINTS, p.hub_radius, b.length, shapes, (base, hub), boom)


@lru_cache
def _model(testbed: CsaTestbed) -> Model:
    return Model(
        KERNELS,
        packed(testbed),
        JOINTS,
        JOINT_UNITS,
        testbed.modes,
        _appendages(testbed.parameters.length, testbed.modes),
        scale_stiffness=stiffened,
    )


@lru_cache
def _appendages(length: float, modes: int) -> Appendages:
    """Return two beams that bend antisymmetrically (3): their tips are opposite in y."""
    root = ClampedFreeBeam(length, 1.0, 1.0, modes).shape(np.zeros(1), derivative=2)[:, 0]
    sides = np.array([[1.0], [-1.0]])
    return Appendages(("beam_positive", "beam_negative"), sides * np.ones(modes), sides * root)


def beam(testbed: CsaTestbed) -> ClampedFreeBeam:
    """Return the appendage of the testbed."""
    p = testbed.parameters
    return ClampedFreeBeam(p.length, p.linear_density, p.bending_stiffness, testbed.modes)


def packed(testbed: CsaTestbed) -> Vector:
    """Return the numbers of (4)-(8) as the kernels read them.

    Layout: [complete, J_a, J_1, J_2, then m_theta_q, diag M_qq, diag K_qq, diag C_qq],
    shape (4 + 4 modes,). The integrals (5), (6), (8) carry the factor 2 for the two beams.
    """
    p = testbed.parameters
    b = beam(testbed)
    mu, ei, a, end = p.linear_density, p.bending_stiffness, p.hub_radius, p.length + p.hub_radius
    j_a = 2.0 * mu * (end**3 - a**3) / 3.0
    m = 2.0 * mu * (b.integral(1, 1, 0) + a * b.integral(0, 1, 0))  # (5)
    m_qq = 2.0 * mu * b.integral(0, 2, 0)  # (6)
    k_qq = 2.0 * ei * b.integral(0, 2, 2)  # (8)
    c_qq = 2.0 * testbed.damping_ratio * np.sqrt(k_qq * m_qq)
    head = [
        float(testbed.variant == "complete"),
        j_a,
        p.base_inertia + p.hub_inertia_1,
        p.hub_inertia_2 + j_a,
    ]
    return np.concatenate((head, m, m_qq, k_qq, c_qq))


CSA = TestbedEntry(CsaTestbed)
