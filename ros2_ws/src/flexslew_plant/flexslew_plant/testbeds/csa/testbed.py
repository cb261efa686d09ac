"""The CSA two-motor testbed: base yaw, hub pitch and two flexible beams.

Gorinevsky and Vukovich (1998), section 2.

Coordinates: joints (theta, psi) [rad], then modal coordinates q_j [m] with phi_j(L) = 1.
Variants:
    printed   equations (9)-(11) as printed;
    complete  with the kinetic energy term sin(psi) theta' psi' m^T q that (1) leaves out.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Annotated, Any, ClassVar, Literal, Self, TypeAlias

import numpy as np
from pydantic import Field
from scipy.integrate import cumulative_simpson

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds.beam import ClampedFreeBeam
from flexslew_plant.testbeds.contract import ShapedMotion
from flexslew_plant.testbeds.csa.equations import (
    KERNELS,
    highest_frequency,
    scale_stiffness,
    unpack,
)
from flexslew_plant.testbeds.entry import TestbedEntry
from flexslew_plant.testbeds.initial.initial_motion import InitialMotion
from flexslew_plant.testbeds.model import Appendages, Model
from flexslew_plant.testbeds.scene import POINTS, Scene, rod, turntable

JOINTS = ("base_yaw", "hub_pitch")
JOINT_UNITS = ("rad", "rad")
CsaVariant: TypeAlias = Literal["printed", "complete"]
_MAX_PITCH = 1.5  # largest pitch of a shaped slew [rad]


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
    """Two motors, base yaw and hub pitch, with two flexible beams (Gorinevsky, Vukovich)."""

    kind: Literal["csa"] = "csa"  # the two-joint testbed of Gorinevsky and Vukovich (1998)
    # form of the equations: printed (as in the paper) or complete (with the term that the paper
    # omits)
    variant: CsaVariant = "complete"
    modes: Annotated[int, Field(ge=1, le=12)] = 3  # number of modes of each beam
    # damping ratio of every beam mode [-]
    damping_ratio: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    parameters: CsaParameters = CsaParameters()  # numbers of the testbed
    initial: CsaInitial = CsaInitial()  # joint positions at the start
    initial_motion: InitialMotion | None = None  # rates and deflections at the start; null: at rest
    # torque limits of the drives, one per joint [N m]
    effort_limit: tuple[Positive, Positive] = (150.0, 150.0)

    operating_point: ClassVar[dict[str, float]] = {"hub_pitch": 0.5}
    typical_goal: ClassVar[dict[str, float]] = {"base_yaw": 1.0, "hub_pitch": 0.5}
    simplified: ClassVar[dict[str, Any]] = {"modes": 1}

    def model(self) -> Model:
        """Return the equations of motion."""
        return _model(self)

    @classmethod
    def many_models(cls, testbeds: Sequence[Self]) -> list[Model]:
        """Return the equations of motion of many; see contract.ManyModels."""
        if len({testbed.modes for testbed in testbeds}) > 1:  # their numbers are no rectangle
            return [testbed.model() for testbed in testbeds]
        rows = np.ascontiguousarray(_packed(testbeds).T)
        return [
            _equations(testbed.parameters.length, testbed.modes).with_packed(row)
            for testbed, row in zip(testbeds, rows, strict=True)
        ]

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
        """Return the motion that drives the modes by a shaped command; see contract.Shaped.

        The pitch follows the command. The modes are driven by w = d/dt(theta' cos psi), on the
        complete model less theta' psi' sin psi. So with k = 1 there and 0 on the printed one
            theta' cos(psi)^(1 + k) = integral of w cos(psi)^k,
        which is zero at the end, as theta' must be, for one mixture w = alpha (p'' + beta p');
        alpha brings theta to its goal.

        Raises:
            BadInput: the beams come too near to the yaw axis, about which nothing moves them.
        """
        for at in (first[1], last[1]):
            if not abs(at) <= _MAX_PITCH:
                raise BadInput(
                    f"a shaped slew keeps within -{_MAX_PITCH:g} and {_MAX_PITCH:g} rad, where yaw "
                    "moves the appendages",
                    key="hub_pitch",
                    value=at,
                )
        span = last - first
        pitch, pitch_rate = first[1] + span[1] * path, span[1] * rate
        cosine, sine = np.cos(pitch), np.sin(pitch)
        complete = self.variant == "complete"
        weight = cosine if complete else np.ones(path.size)
        # the integral of lever p'' by parts: p'' jumps, p' does not
        weight_rate = sine * pitch_rate if complete else np.zeros(path.size)
        first_part = weight * rate + cumulative_simpson(weight_rate * rate, dx=h, initial=0.0)
        second_part = cumulative_simpson(weight * rate, dx=h, initial=0.0)
        beta = -first_part[-1] / second_part[-1]
        yaw_rate = (first_part + beta * second_part) / (weight * cosine)
        yaw = cumulative_simpson(yaw_rate, dx=h, initial=0.0)
        alpha = span[0] / yaw[-1]
        # the mean of w over each interval is exact, wherever p'' jumps
        modal_input = alpha / h * (np.diff(rate) + beta * np.diff(path))
        return ShapedMotion(
            np.column_stack((first[0] + alpha * yaw, pitch)),
            np.column_stack((alpha * yaw_rate, pitch_rate)),
            np.column_stack((modal_input, np.zeros(modal_input.size))),
        )

    def energies(self, symbols: Any, q: Any, v: Any) -> tuple[Any, Any, Any]:
        """Return kinetic and potential energy and dissipation in symbols; contract.Symbolic."""
        p, mode, rate = unpack(packed(self)), q[2:], v[2:]
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
        beam_body = rod(p.linear_density * b.length, b.length)
        return turntable(self.kind, JOINTS, p.hub_radius, b.length, shapes, (base, hub), beam_body)


@lru_cache
def _model(testbed: CsaTestbed) -> Model:
    return CsaTestbed.many_models([testbed])[0]


@lru_cache
def _equations(length: float, modes: int) -> Model:
    """Return the model of all testbeds with such beams, without their numbers."""
    return Model(
        KERNELS,
        np.zeros(4 + 4 * modes),
        JOINTS,
        JOINT_UNITS,
        modes,
        _appendages(length, modes),
        scale_stiffness=scale_stiffness,
        highest_frequency=highest_frequency,
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
    return _packed([testbed])[:, 0]


def _packed(testbeds: Sequence[CsaTestbed]) -> Matrix:
    """Return those of many with as many modes, shape (4 + 4 modes, testbeds)."""
    each = [testbed.parameters for testbed in testbeds]
    volumes = np.array([(p.length + p.hub_radius) ** 3 - p.hub_radius**3 for p in each])
    mu, ei, a, j_base, j_1, j_2 = np.array(
        [
            (
                p.linear_density,
                p.bending_stiffness,
                p.hub_radius,
                p.base_inertia,
                p.hub_inertia_1,
                p.hub_inertia_2,
            )
            for p in each
        ]
    ).T
    beams = [_integrals(testbed.parameters.length, testbed.modes) for testbed in testbeds]
    first, zeroth, square, curvature_integral = np.stack(beams, axis=-1)
    j_a = 2.0 * mu * volumes / 3.0
    m = 2.0 * mu * (first + a * zeroth)  # (5)
    m_qq = 2.0 * mu * square  # (6)
    k_qq = 2.0 * ei * curvature_integral  # (8)
    c_qq = 2.0 * np.array([t.damping_ratio for t in testbeds]) * np.sqrt(k_qq * m_qq)
    complete = [float(testbed.variant == "complete") for testbed in testbeds]
    return np.concatenate(([complete, j_a, j_base + j_1, j_2 + j_a], m, m_qq, k_qq, c_qq))


@lru_cache
def _integrals(length: float, modes: int) -> Matrix:
    """Return those of s phi, phi, phi^2 and phi''^2 along a beam, shape (4, modes)."""
    b = ClampedFreeBeam(length, 1.0, 1.0, modes)
    wanted = ((1, 1, 0), (0, 1, 0), (0, 2, 0), (0, 2, 2))
    return np.array([b.integral(*which) for which in wanted])


CSA = TestbedEntry(CsaTestbed)
