"""A rigid hub with two flexible appendages, tip masses and foreshortening.

Liu and Singh (1997), section 4.

Coordinates: the hub's angle theta [rad], then the tip deflection q [m]: the mode (21) is scaled
here such that phi(L) = 1, as on the other testbeds; the paper's own amplitude is q/phi(L). With
    2 T = a(q) theta'^2 + 2 b(q) theta' q' + c(q) q'^2,    U = k_qq q^2    (22)-(26)
the equations of motion are
    a theta'' + b q'' + da/dq theta' q' + db/dq q'^2 = u,
    b theta'' + c q'' + (dc/dq q'^2 - da/dq theta'^2)/2 + d q' + 2 k_qq q = 0.
In (25) both phi'(L)^2 are read as beta(L), the integral of phi'^2 over the appendage: only then
does a tip at the end of the beam move as the beam's last point does.
"""

from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds.contract import require_no_payload
from flexslew_plant.testbeds.entry import TestbedEntry
from flexslew_plant.testbeds.initial.initial_motion import InitialMotion
from flexslew_plant.testbeds.kernels import Kernels
from flexslew_plant.testbeds.model import Appendages, Model
from flexslew_plant.testbeds.scene import POINTS, Scene, rod, turntable

JOINTS = ("hub",)
JOINT_UNITS = ("rad",)
FOOT = 0.3048  # [m]
FOOT_POUND = 1.3558179483314004  # [J]
# where the packed parameters lie
_A0, _A2, _A4, _B0, _B2, _C0, _C2, _STIFFNESS, _DAMPING = 0, 1, 2, 3, 4, 5, 6, 7, 8


@section
class HubParameters:
    """Table 1 of Liu and Singh (1997) in its own units; they become SI when they are packed."""

    hub_radius: NonNegative = 1.0  # r [ft]
    hub_inertia: Positive = 8.0  # I_h [slug ft^2]
    linear_density: Positive = 0.0271875  # rho [slug/ft]
    elastic_modulus: Positive = 0.1584e10  # E [lb/ft^2]
    length: Positive = 4.0  # L [ft]
    thickness: Positive = 0.125  # t, in the plane of the bending [in]
    height: Positive = 6.0  # h [in]
    tip_mass: NonNegative = 0.156941  # m_t [slug]
    tip_inertia: NonNegative = 0.0018  # I_t [slug ft^2]

    @property
    def bending_stiffness(self) -> float:
        """E I of one appendage [lb ft^2]."""
        second_moment = self.height * self.thickness**3 / 12.0
        return self.elastic_modulus * second_moment / 12.0**4


@section
class HubInitial:
    """Where the hub rests at the start; the appendages are straight."""

    hub: float = 0.0  # theta(0) [rad]


@section
class HubTestbed:
    """A rigid hub with two flexible appendages and tip masses (Liu and Singh)."""

    # a hub with two flexible appendages (Liu and Singh, 1997)
    kind: Literal["hub_with_appendages"] = "hub_with_appendages"
    modes: Literal[1] = 1  # number of modes
    # damping ratio of the mode, hub held [-]
    damping_ratio: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    parameters: HubParameters = HubParameters()  # numbers of the testbed
    initial: HubInitial = HubInitial()  # joint positions at the start
    initial_motion: InitialMotion | None = None  # rates and deflections at the start; null: at rest
    effort_limit: tuple[Positive] = (2.0 * FOOT_POUND,)  # torque limit of the drive, 2 ft lb [N m]

    operating_point: ClassVar[dict[str, float]] = {}
    typical_goal: ClassVar[dict[str, float]] = {"hub": 1.0}
    simplified: ClassVar[dict[str, Any]] = {}

    def model(self) -> Model:
        """Return the equations of motion."""
        return Model(
            KERNELS,
            packed(self),
            JOINTS,
            JOINT_UNITS,
            self.modes,
            # one, as both bend alike; its root curvature is not modelled
            Appendages(("appendage",), np.ones((1, 1)), np.zeros((1, 1))),
            scale_stiffness=scale_stiffness,
        )

    def scaled(self, stiffness: float = 1.0, payload: float = 1.0) -> "HubTestbed":
        """Return it with another stiffness, as a factor [-].

        Raises:
            BadInput: if another payload is requested.
        """
        require_no_payload(self.kind, payload)
        p = self.parameters
        return replace(self, parameters=replace(p, elastic_modulus=p.elastic_modulus * stiffness))

    def scene(self) -> Scene:
        """Return how it is drawn."""
        shapes = np.linspace(0.0, 1.0, POINTS)[None, :] ** 2
        p = self.parameters
        radius, length, slug = p.hub_radius * FOOT, p.length * FOOT, FOOT_POUND / FOOT**2
        beam_body = rod(p.linear_density * p.length * slug, length, p.tip_mass * slug)
        base = (p.hub_inertia * FOOT_POUND,) * 3
        return turntable(self.kind, JOINTS, radius, length, shapes, (base,), beam_body)


class EnergyCoefficients(NamedTuple):
    """a = a0 + a2 q^2 + a4 q^4, b = b0 + b2 q^2, c = c0 + c2 q^2 and k_qq in feet and slugs."""

    a0: float
    a2: float
    a4: float
    b0: float
    b2: float
    c0: float
    c2: float
    k_qq: float
    tip: float  # phi(L), what one unit of q moves the tip


def energy_coefficients(p: HubParameters) -> EnergyCoefficients:
    """Return T and U of (22)-(26) for the mode (21) with the paper's own amplitude and units.

    Integrated by Gauss's rule with 40 nodes, exact to rounding for this mode.
    """
    length = p.length
    nodes, weights = np.polynomial.legendre.leggauss(40)
    x, rho = 0.5 * length * (nodes + 1.0), 0.5 * length * weights * p.linear_density
    # the tip is one more mass, at x = L
    x, mass = np.append(x, length), np.append(rho, p.tip_mass)
    z = np.pi * x / length
    phi = 1.0 - np.cos(z) + 0.5 * z**2
    shortening = z / 2.0 - np.sin(2.0 * z) / 4.0 + z**3 / 3.0 + 2.0 * (np.sin(z) - z * np.cos(z))
    beta = np.pi / length * shortening  # integral of phi'^2 from the hub to x
    slope = np.pi / length * (np.sin(z[-1]) + z[-1])  # phi'(L)
    curvature = (np.pi / length) ** 2 * (np.cos(z[:-1]) + 1.0)
    reach = p.hub_radius + x
    return EnergyCoefficients(
        a0=float(p.hub_inertia + 2.0 * mass @ reach**2 + 2.0 * p.tip_inertia),
        a2=float(2.0 * mass @ (phi**2 - reach * beta)),
        a4=float(0.5 * mass @ beta**2),
        b0=float(2.0 * mass @ (reach * phi) + 2.0 * p.tip_inertia * slope),
        b2=float(mass @ (beta * phi)),
        c0=float(2.0 * mass @ phi**2 + 2.0 * p.tip_inertia * slope**2),
        c2=float(2.0 * mass @ beta**2),
        k_qq=float(p.bending_stiffness * (0.5 * length * weights) @ curvature**2),
        tip=float(phi[-1]),
    )


def packed(testbed: HubTestbed) -> Vector:
    """Return [a0, a2, a4, b0, b2, c0, c2, 2 k_qq, d] in SI, q in metres at the tip, shape (9,)."""
    e = energy_coefficients(testbed.parameters)
    s = 1.0 / (FOOT * e.tip)  # the paper's amplitude [ft] of one metre at the tip
    angular = [e.a0, e.a2 * s**2, e.a4 * s**4]
    rest = [e.b0 * s, e.b2 * s**3, e.c0 * s**2, e.c2 * s**4, 2.0 * e.k_qq * s**2]
    numbers = FOOT_POUND * np.array(angular + rest)
    damping = 2.0 * testbed.damping_ratio * np.sqrt(numbers[_STIFFNESS] * numbers[_C0])
    return np.append(numbers, damping)


def scale_stiffness(p: Vector, factor: float) -> Vector:
    """Return the packed parameters with the stiffness k_qq multiplied by factor [-]."""
    scaled = p.copy()
    scaled[_STIFFNESS] *= factor
    scaled[_DAMPING] *= np.sqrt(factor)
    return scaled


def terms(
    p: Vector, t: float, x: Vector, joints: Matrix, coupling: Matrix, modal: Vector, bias: Vector
) -> None:
    """Write M(q) and h(q, v) of M a + h = B u; see csa.equations.terms for the arguments."""
    q, rate, deflection_rate = x[1], x[2], x[3]
    s = q * q
    da = (2.0 * p[_A2] + 4.0 * p[_A4] * s) * q
    db = 2.0 * p[_B2] * q
    dc = 2.0 * p[_C2] * q
    joints[0, 0] = p[_A0] + (p[_A2] + p[_A4] * s) * s
    coupling[0, 0] = p[_B0] + p[_B2] * s
    modal[0] = p[_C0] + p[_C2] * s
    bias[0] = (da * rate + db * deflection_rate) * deflection_rate
    elastic = p[_DAMPING] * deflection_rate + p[_STIFFNESS] * q
    bias[1] = 0.5 * (dc * deflection_rate * deflection_rate - da * rate * rate) + elastic


def residual_jacobian(p: Vector, t: float, x: Vector, a: Vector, dq: Matrix, dv: Matrix) -> None:
    """Write dr/dq and dr/dv of r = M(q) a + h(q, v); see csa.equations.residual_jacobian."""
    q, rate, deflection_rate = x[1], x[2], x[3]
    da = (2.0 * p[_A2] + 4.0 * p[_A4] * q * q) * q
    dda = 2.0 * p[_A2] + 12.0 * p[_A4] * q * q
    db, ddb = 2.0 * p[_B2] * q, 2.0 * p[_B2]
    dc, ddc = 2.0 * p[_C2] * q, 2.0 * p[_C2]
    dq[:] = 0.0
    dq[0, 1] = da * a[0] + db * a[1] + (dda * rate + ddb * deflection_rate) * deflection_rate
    dq[1, 1] = (
        db * a[0] + dc * a[1] + 0.5 * (ddc * deflection_rate * deflection_rate - dda * rate * rate)
    )
    dq[1, 1] += p[_STIFFNESS]
    dv[0, 0] = da * deflection_rate
    dv[0, 1] = da * rate + 2.0 * db * deflection_rate
    dv[1, 0] = -da * rate
    dv[1, 1] = dc * deflection_rate + p[_DAMPING]


def potential(p: Vector, t: float, q: Vector) -> float:
    """Return the strain energy of both appendages (26) [J]."""
    return float(0.5 * p[_STIFFNESS] * q[1] ** 2)


KERNELS = Kernels(terms, residual_jacobian, potential)


HUB = TestbedEntry(HubTestbed)
