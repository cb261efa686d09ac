"""The equations of a linear plant in second-order form, and their exact solution, as kernels.

With the effort held over h, a pair of poles s +- i w with the coordinates z moves as
    z(h) = e^(l h) z + (e^(l h) - 1)/l g,  z = z_1 + i z_2,  l = s - i w,
and the block of real and slow poles by the series of its exponential.
"""

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, called
from flexslew_plant.testbeds.kernels import Kernels
from flexslew_plant.testbeds.linear.blocks import blocks
from flexslew_plant.testbeds.linear.second_order import SecondOrder

_TERMS = 20  # of the series at |S h| = 1, to rounding
HEAD = 3  # numbers before the matrices: joints m, coordinates n, states of the first block k


def packed(form: SecondOrder) -> Vector:
    """Return m, n, k, then J, L, K, D, E, the blocks, L B, L and R of the state, row by row."""
    m, n = len(form.joints), len(form.stiffness)
    mass = np.block([[form.joints, form.coupling], [form.coupling.T, np.eye(n - m)]])
    right = np.hstack((-form.stiffness, -form.damping, form.effort))
    lower = np.linalg.solve(mass, right)
    a = np.vstack((np.hstack((np.zeros((n, n)), np.eye(n))), lower[:, : 2 * n]))
    parts = blocks(a)
    entry = parts.left[:, n:] @ lower[:, 2 * n :]
    arrays = (form.joints, form.coupling, form.stiffness, form.damping, form.effort, parts.first,
              parts.damping, parts.frequency, entry, parts.left, parts.right)  # fmt: skip
    return np.concatenate(([m, n, len(parts.first)], *(one.ravel() for one in arrays)))


def scale_stiffness(p: Vector, factor: float) -> Vector:
    """Return p with the stiffness times factor [-], damping ratios kept."""
    m, n = int(p[0]), int(p[1])
    sizes = (m * m, m * (n - m), n * n, n * n, n * m)
    parts = np.split(p[HEAD : HEAD + sum(sizes)], np.cumsum(sizes)[:-1])
    joints, coupling, stiffness, damping, effort = (
        part.reshape(shape)
        for part, shape in zip(parts, ((m, m), (m, n - m), (n, n), (n, n), (n, m)), strict=True)
    )
    form = SecondOrder(joints, coupling, stiffness, damping, effort, np.zeros((0, 0)), False)
    return packed(scaled(form, factor))


def scaled(form: SecondOrder, factor: float) -> SecondOrder:
    """Return a form with all its poles times the root of a factor [-]."""
    root = float(np.sqrt(factor))
    return form._replace(stiffness=form.stiffness * factor, damping=form.damping * root)


def terms(
    p: Vector, t: float, x: Vector, joints: Matrix, coupling: Matrix, modal: Vector, bias: Vector
) -> None:
    """Write M and h = K q + D q'; see kernels.Kernels for the arguments."""
    m, n = int(p[0]), int(p[1])
    first_coupling = HEAD + m * m
    stiffness = first_coupling + m * (n - m)
    damping = stiffness + n * n
    for i in range(m):
        for j in range(m):
            joints[i, j] = p[HEAD + i * m + j]
        for j in range(n - m):
            coupling[i, j] = p[first_coupling + i * (n - m) + j]
    for i in range(n - m):
        modal[i] = 1.0
    for i in range(n):
        force = 0.0
        for j in range(n):
            force += p[stiffness + i * n + j] * x[j] + p[damping + i * n + j] * x[n + j]
        bias[i] = force


def residual_jacobian(p: Vector, t: float, x: Vector, a: Vector, dq: Matrix, dv: Matrix) -> None:
    """Write the partial derivatives of M a + h at fixed a: K and D."""
    m, n = int(p[0]), int(p[1])
    stiffness = HEAD + m * m + m * (n - m)
    for i in range(n):
        for j in range(n):
            dq[i, j] = p[stiffness + i * n + j]
            dv[i, j] = p[stiffness + n * n + i * n + j]


def potential(p: Vector, t: float, q: Vector) -> float:
    """Return q^T K q / 2 [J], which only a symmetric K conserves."""
    m, n = int(p[0]), int(p[1])
    stiffness = HEAD + m * m + m * (n - m)
    energy = 0.0
    for i in range(n):
        for j in range(n):
            energy += 0.5 * q[i] * p[stiffness + i * n + j] * q[j]
    return energy


def actuation(p: Vector, t: float, x: Vector, effort: Vector, force: Vector) -> None:
    """Add E u."""
    m, n = int(p[0]), int(p[1])
    first = HEAD + m * m + m * (n - m) + 2 * n * n
    for i in range(n):
        for j in range(m):
            force[i] += p[first + i * m + j] * effort[j]


@called
def _move_first(p: Vector, at: int, k: int, push: Vector, dt: float, z: Vector) -> None:
    """Move the first k entries of z by the series of e^(S h), in steps that S h is small in."""
    largest = 0.0
    for i in range(k):
        row = 0.0
        for j in range(k):
            row += abs(p[at + i * k + j])
        largest = max(largest, row)
    steps = max(int(np.ceil(largest * abs(dt))), 1)
    h, term, after = dt / steps, np.zeros(k), np.zeros(k)
    for _ in range(steps):
        for i in range(k):
            term[i] = h * push[i]
            for j in range(k):
                term[i] += h * p[at + i * k + j] * z[j]
        for order in range(2, _TERMS):
            for i in range(k):
                z[i] += term[i]
                after[i] = 0.0
                for j in range(k):
                    after[i] += h * p[at + i * k + j] * term[j] / order
            for i in range(k):
                term[i] = after[i]


@called
def _move_pair(s: float, w: float, dt: float, push: Vector, z: Vector) -> None:
    """Move the two coordinates z of a pair of poles s +- i w."""
    growth = np.exp(s * dt)
    cosine, sine = growth * np.cos(w * dt), -growth * np.sin(w * dt)
    half = np.sin(0.5 * w * dt)
    change = np.expm1(s * dt) - 2.0 * growth * half * half  # cosine - 1 without its rounding
    square = s * s + w * w
    real, imaginary = (change * s - sine * w) / square, (sine * s + change * w) / square
    one, two = z[0], z[1]
    z[0] = cosine * one - sine * two + real * push[0] - imaginary * push[1]
    z[1] = sine * one + cosine * two + imaginary * push[0] + real * push[1]


def advance(p: Vector, t: float, effort: Vector, dt: float, x: Vector) -> None:
    """Replace x by the state dt later with the effort held, exactly but for rounding."""
    m, n, k = int(p[0]), int(p[1]), int(p[2])
    size, pairs = 2 * n, (2 * n - k) // 2
    block = HEAD + m * m + m * (n - m) + 2 * n * n + n * m
    damping = block + k * k
    entry = damping + 2 * pairs
    left = entry + size * m
    right = left + size * size
    z, push = np.zeros(size), np.zeros(size)
    for i in range(size):
        for j in range(size):
            z[i] += p[left + i * size + j] * x[j]
        for j in range(m):
            push[i] += p[entry + i * m + j] * effort[j]
    _move_first(p, block, k, push, dt, z)
    for i in range(pairs):
        at = k + 2 * i
        s, w = p[damping + i], p[damping + pairs + i]
        _move_pair(s, w, dt, push[at : at + 2], z[at : at + 2])
    for i in range(size):
        x[i] = 0.0
        for j in range(size):
            x[i] += p[right + i * size + j] * z[j]


IN_JOINTS = Kernels(terms, residual_jacobian, potential, advance=advance)
ANYWHERE = Kernels(terms, residual_jacobian, potential, actuation, advance=advance)
