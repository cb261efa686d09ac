"""Random spacecraft, their flights by the shared method and what must stay constant."""

import numpy as np
from scipy.integrate import DOP853

from flexslew_plant.arrays import Matrix, Vector, compiled
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
from flexslew_plant.testbeds.spacecraft.equations.actuation import actuation
from flexslew_plant.testbeds.spacecraft.equations.kinematics import kinematics, potential
from flexslew_plant.testbeds.spacecraft.equations.terms import terms
from flexslew_plant.testbeds.spacecraft.shapes.integrals import Points, integrals_of
from flexslew_plant.testbeds.spacecraft.shapes.shape import AppendagePoint


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


_STAGES = 12
_C: Vector = np.array(DOP853.C[:_STAGES])
_A: Matrix = np.array(DOP853.A[:_STAGES, :_STAGES])
_B: Vector = np.array(DOP853.B[:_STAGES])


@compiled
def _rate(p: Vector, t: float, x: Vector, effort: Vector, nv: int) -> Vector:
    nq = x.size - nv
    n = int(p[at.MODES])
    m = nv - n
    mass, bias, modal = np.zeros((nv, nv)), np.empty(nv), np.empty(n)
    terms(p, t, x, mass[:m, :m], mass[:m, m:], modal, bias)
    mass[m:, :m] = mass[:m, m:].T
    for i in range(n):
        mass[m + i, m + i] = modal[i]
    force = -bias
    actuation(p, t, x, effort, force)
    rate = np.empty(x.size)
    kinematics(p, t, x, rate)
    rate[nq:] = np.linalg.solve(mass, force)
    return rate


@compiled
def fly(p: Vector, t: float, x: Vector, effort: Vector, nv: int, dt: float, steps: int) -> Vector:
    """Return the state after `steps` steps of order 8 and length dt."""
    x = x.copy()
    slopes = np.empty((_STAGES, x.size))
    for k in range(steps):
        for i in range(_STAGES):
            now = x.copy()
            for j in range(i):
                now += dt * _A[i, j] * slopes[j]
            slopes[i] = _rate(p, t + (k + _C[i]) * dt, now, effort, nv)
        for i in range(_STAGES):
            x += dt * _B[i] * slopes[i]
    return x


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
