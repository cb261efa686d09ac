"""Random spacecraft, their flights by the shared method and what must stay constant."""

from dataclasses import replace

import numpy as np
from numpy.polynomial.legendre import leggauss

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.compiled.bound import bound
from flexslew_plant.testbeds.csa.testbed import CsaTestbed, beam
from flexslew_plant.testbeds.spacecraft.assembly.bodies import rotation_matrix
from flexslew_plant.testbeds.spacecraft.assembly.craft import (
    Appendage,
    MomentGyro,
    PrescribedRotation,
    Spacecraft,
    SpacecraftActuator,
    Wheel,
)
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.equations.kinematics import potential
from flexslew_plant.testbeds.spacecraft.equations.terms import terms
from flexslew_plant.testbeds.spacecraft.shapes.integrals import Points, integrals_of, second_of
from flexslew_plant.testbeds.spacecraft.shapes.shape import AppendagePoint
from flexslew_plant.testbeds.spacecraft.testbed import CONSTRAINED, FLOATING


def direction(rng: np.random.Generator) -> Vector:
    """Return a random unit vector."""
    v = rng.standard_normal(3)
    return v / np.linalg.norm(v)


def random_axes(rng: np.random.Generator) -> Matrix:
    """Return random direction cosines."""
    return rotation_matrix(direction(rng), rng.uniform(0.0, 2.0 * np.pi))


def random_points(rng: np.random.Generator, modes: int, count: int = 15) -> Points:
    """Return mass points with modes of a diagonal modal mass matrix."""
    mass = rng.uniform(0.2, 1.0, count)
    shape = rng.standard_normal((count, 3, modes))
    shape[-1] = 0.0
    if modes:
        modal = np.einsum("k,kai,kaj->ij", mass, shape, shape)
        shape = shape @ np.linalg.inv(np.linalg.cholesky(modal)).T
    drawn = 0.1 * rng.standard_normal((count, 3, modes, modes))
    drawn = drawn + drawn.transpose(0, 1, 3, 2)
    return Points(rng.standard_normal((count, 3)) * 2.0, mass, shape, drawn)


def random_appendage(rng: np.random.Generator, hinge: int, name: str) -> Appendage:
    """Return an appendage with up to four modes."""
    modes = int(rng.integers(0, 5))
    points = random_points(rng, modes)
    half = rng.standard_normal((modes, modes))
    manoeuvres: tuple[PrescribedRotation, ...] = ()
    if hinge == at.PRESCRIBED:
        manoeuvres = (
            PrescribedRotation(0.1, 1.3, rng.uniform(-2, 2), direction(rng), at.SMOOTH),
            PrescribedRotation(1.6, 0.9, rng.uniform(-2, 2), direction(rng), at.BANG_BANG),
        )
    return Appendage(
        name,
        integrals_of(points),
        np.ones(modes),
        rng.uniform(5.0, 60.0, modes),
        0.0 * half @ half.T,
        rng.standard_normal(3),
        random_axes(rng),
        hinge,
        direction(rng),
        rng.uniform(0.0, 3.0),
        0.0,
        True,
        manoeuvres,
    )


def random_craft(
    seed: int, appendages: int, motion: int = at.FREE, hinges: tuple[int, ...] = (0, 2)
) -> Spacecraft:
    """Return a platform with appendages on the kinds of hinges given, a wheel and actuators."""
    rng = np.random.default_rng(seed)
    body = random_points(rng, 0, 9)
    whole = integrals_of(body)
    parts = tuple(
        random_appendage(rng, int(rng.choice(hinges)), f"a{k}") for k in range(appendages)
    )
    wheels = (Wheel("wheel", direction(rng), 0.05, np.inf),)
    drives = [
        SpacecraftActuator("force", at.FORCE, -1, direction(rng), _spot(rng, 0)),
        SpacecraftActuator("torque", at.TORQUE, -1, direction(rng)),
        SpacecraftActuator("spin", at.WHEEL, 0),
    ]
    for k, a in enumerate(parts):
        drives.append(
            SpacecraftActuator(f"f{k}", at.POINT_FORCE, k, direction(rng), _spot(rng, a.modes))
        )
        drives.append(
            SpacecraftActuator(f"t{k}", at.TIP_TORQUE, k, direction(rng), _spot(rng, a.modes))
        )
        if a.hinge == at.DRIVEN:
            drives.append(SpacecraftActuator(f"h{k}", at.HINGE, k))
    return Spacecraft(
        20.0 * whole.mass,
        20.0 * whole.first,
        20.0 * whole.inertia,
        parts,
        wheels,
        tuple(drives),
        motion,
        direction(rng),
        rng.standard_normal(3),
    )


def csa_hub(testbed: CsaTestbed, axis: Vector, second_order: bool, extra: float = 0.0) -> Appendage:
    """Return the hub of the CSA testbed with both beams on a driven hinge.

    Args:
        testbed: the testbed.
        axis: of the hinge.
        second_order: whether terms of second order count, which the CSA model does not have.
        extra: further inertia of the hub about z.
    """
    p, b, modes = testbed.parameters, beam(testbed), testbed.modes
    x, w = leggauss(16)
    edges = np.linspace(0.0, p.length, 4 * modes + 1)
    h = np.diff(edges)[:, None]
    s = (edges[:-1, None] + h * (1.0 + x) / 2.0).ravel()
    drawn = np.zeros((s.size, 3, modes, modes))
    fine = np.linspace(0.0, p.length, 3001)
    steep = b.shape(fine, 1).T
    squares = steep[:, :, None] * steep[:, None, :]
    summed = np.cumsum(0.5 * (squares[1:] + squares[:-1]) * np.diff(fine)[:, None, None], axis=0)
    for row in range(modes):
        for column in range(modes):
            drawn[:, 0, row, column] = -np.interp(s, fine[1:], summed[:, row, column])
    mass = (p.linear_density * h * w / 2.0).ravel()
    place, shape = np.zeros((s.size, 3)), np.zeros((s.size, 3, modes))
    place[:, 0], shape[:, 1] = p.hub_radius + s, b.shape(s).T
    both = Points(place, mass, shape, drawn).extend(Points(-place, mass, -shape, -drawn))
    whole = integrals_of(both)
    i = whole if second_order else whole.first_order()
    own = np.diag([p.hub_inertia_1, p.hub_inertia_2, p.hub_inertia_1 + extra])
    i = replace(i, second=i.second + second_of(own))
    return Appendage(
        "hub",
        i,
        2.0 * p.linear_density * b.integral(0, 2, 0),
        2.0 * p.bending_stiffness * b.integral(0, 2, 2),
        np.zeros((modes, modes)),
        np.zeros(3),
        np.eye(3),
        at.DRIVEN,
        axis,
        second_order=second_order,
    )


def random_gyro(rng: np.random.Generator) -> MomentGyro:
    """Return a control moment gyro along any axes."""
    axes = random_axes(rng)
    return MomentGyro("gyro", axes[0], axes[1], rng.uniform(0.5, 2.0))


def _spot(rng: np.random.Generator, modes: int) -> AppendagePoint:
    draw = rng.standard_normal
    return AppendagePoint(draw(3), draw((3, modes)), draw((3, modes)), np.zeros((2, modes)))


def random_state(craft: Spacecraft, seed: int, size: float = 0.3) -> Vector:
    """Return a state [q, v] with a unit quaternion."""
    nq, nv = craft.sizes
    rng = np.random.default_rng(seed)
    x = size * rng.standard_normal(nq + nv)
    if craft.motion == at.FREE:
        x[3:7] = rng.standard_normal(4)
        x[3:7] /= np.linalg.norm(x[3:7])
    return x


def mass_and_bias(p: Vector, t: float, x: Vector, nv: int) -> tuple[Matrix, Vector]:
    """Return M and h."""
    n = int(p[at.MODES])
    m = nv - n
    joints, coupling, modal, bias = np.empty((m, m)), np.empty((m, n)), np.empty(n), np.empty(nv)
    terms(p, t, x, joints, coupling, modal, bias)
    return np.block([[joints, coupling], [coupling.T, np.diag(modal)]]), bias


def fly(p: Vector, t: float, x: Vector, effort: Vector, nv: int, dt: float, steps: int) -> Vector:
    """Return the state after `steps` steps of length dt, as the bench takes them."""
    kernels, before = FLOATING if x.size > 2 * nv else CONSTRAINED, nv - int(p[at.MODES])
    after = x.copy()
    bound(kernels, nv, before).advance(p, t, effort, dt * steps, steps, before, after)
    return after


def attitude(quaternion: Vector) -> Matrix:
    """Return A, body to inertial space."""
    a, b, c, d = quaternion
    return np.array(
        [
            [1 - 2 * (b * b + c * c), 2 * (a * b - c * d), 2 * (a * c + b * d)],
            [2 * (a * b + c * d), 1 - 2 * (a * a + c * c), 2 * (b * c - a * d)],
            [2 * (a * c - b * d), 2 * (b * c + a * d), 1 - 2 * (a * a + b * b)],
        ]
    )


def momenta(craft: Spacecraft, p: Vector, t: float, x: Vector) -> tuple[Vector, Vector]:
    """Return linear and angular momentum about the origin of inertial space, for fixed hinges
    or driven ones."""
    nq, nv = craft.sizes
    mass, _ = mass_and_bias(p, t, x, nv)
    own = mass @ x[nq:]
    a = attitude(x[3:7])
    linear = a @ own[:3]
    return linear, np.cross(x[:3], linear) + a @ own[3:6]


def energy(craft: Spacecraft, p: Vector, x: Vector) -> float:
    """Return T + U."""
    nq, nv = craft.sizes
    mass, _ = mass_and_bias(p, 0.0, x, nv)
    v = x[nq:]
    return float(0.5 * v @ mass @ v + potential(p, 0.0, x[:nq]))
