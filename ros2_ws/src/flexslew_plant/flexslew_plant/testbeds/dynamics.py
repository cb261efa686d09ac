"""Forward dynamics of every testbed and the fixed-step integration, as compiled kernels.

A testbed is M(q) a + h(q, v) = B u with the joints first and the modes after them; efforts act
on the joints alone. `kind` selects whose terms are used (see TESTBEDS in testbeds).
"""

from collections.abc import Callable
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from scipy.integrate import DOP853

from flexslew_plant.arrays import Matrix, Vector, compiled, inlined
from flexslew_plant.testbeds import csa, floating_oscillator, hub_with_appendages

# Dormand and Prince's method of order 8, without its error estimate: 12 stages
STAGES = 12
STAGE_TIMES: Vector = np.array(DOP853.C[:STAGES], dtype=np.float64)
STAGE_WEIGHTS: Matrix = np.array(DOP853.A[:STAGES, :STAGES], dtype=np.float64)
STEP_WEIGHTS: Vector = np.array(DOP853.B[:STAGES], dtype=np.float64)

# (p, effort, dt, steps, x): see stepper
Stepper: TypeAlias = Callable[[Vector, Vector, float, int, Vector], None]


@inlined
def terms(
    kind: int,
    p: Vector,
    x: Vector,
    joints: Matrix,
    coupling: Matrix,
    modal: Vector,
    bias: Vector,
) -> None:
    """Write the blocks of M(q) and the bias h(q, v) of the testbed; see csa.terms."""
    if kind == csa.KIND:
        csa.terms(p, x, joints, coupling, modal, bias)
    elif kind == hub_with_appendages.KIND:
        hub_with_appendages.terms(p, x, joints, coupling, modal, bias)
    else:
        floating_oscillator.terms(p, x, joints, coupling, modal, bias)


@inlined
def residual_jacobian(kind: int, p: Vector, x: Vector, a: Vector, dq: Matrix, dv: Matrix) -> None:
    """Write d(M a + h)/dq and d(M a + h)/dv at fixed a; see csa.residual_jacobian."""
    if kind == csa.KIND:
        csa.residual_jacobian(p, x, a, dq, dv)
    elif kind == hub_with_appendages.KIND:
        hub_with_appendages.residual_jacobian(p, x, a, dq, dv)
    else:
        floating_oscillator.residual_jacobian(p, x, a, dq, dv)


@inlined
def potential(kind: int, p: Vector, q: Vector) -> float:
    """Return the potential energy [J]."""
    if kind == csa.KIND:
        return csa.potential(p, q)
    if kind == hub_with_appendages.KIND:
        return hub_with_appendages.potential(p, q)
    return floating_oscillator.potential(p, q)


@inlined
def solve(joints: Matrix, coupling: Matrix, modal: Vector, r: Vector) -> None:
    """Replace r by M^-1 r, eliminating the diagonal modal block first (one or two joints)."""
    m, n = coupling.shape
    a, b, d = joints[0, 0], 0.0, 1.0
    if m == 2:
        b, d = joints[0, 1], joints[1, 1]
    for j in range(n):
        f = coupling[0, j] / modal[j]
        a -= f * coupling[0, j]
        r[0] -= f * r[m + j]
        if m == 2:
            g = coupling[1, j] / modal[j]
            b -= f * coupling[1, j]
            d -= g * coupling[1, j]
            r[1] -= g * r[m + j]
    if m == 2:
        determinant = a * d - b * b
        r0 = (d * r[0] - b * r[1]) / determinant
        r[1] = (a * r[1] - b * r[0]) / determinant
        r[0] = r0
    else:
        r[0] /= a
    for j in range(n):
        r[m + j] -= coupling[0, j] * r[0]
        if m == 2:
            r[m + j] -= coupling[1, j] * r[1]
        r[m + j] /= modal[j]


@inlined
def acceleration(
    kind: int,
    p: Vector,
    x: Vector,
    effort: Vector,
    joints: Matrix,
    coupling: Matrix,
    modal: Vector,
    out: Vector,
) -> None:
    """Write a = M(q)^-1 (B u - h(q, v)); joints, coupling and modal are left holding M(q)."""
    n = x.size // 2
    terms(kind, p, x, joints, coupling, modal, out)
    for i in range(n):
        out[i] = -out[i]
    for i in range(effort.size):
        out[i] += effort[i]
    solve(joints, coupling, modal, out)


@compiled
def derivative(kind: int, p: Vector, x: Vector, effort: Vector) -> Vector:
    """Return f(x, u) = [v, M(q)^-1 (B u - h(q, v))], shape (2 n,).

    Args:
        kind: the testbed's number.
        p: its packed parameters.
        x: state [q, v], joints before modes, shape (2 n,).
        effort: joint efforts, shape (joints,) [N m or N].
    """
    n, m = x.size // 2, effort.size
    a = np.empty(n)
    acceleration(kind, p, x, effort, np.empty((m, m)), np.empty((m, n - m)), np.empty(n - m), a)
    return np.concatenate((x[n:], a))


@inlined
def stage_state(x: Vector, slopes: Matrix, stage: int, h: float, at: Vector) -> None:
    """Write the state at which the slope of `stage` is taken."""
    size = slopes.shape[1]  # of an array made in the kernel: the compiler may know it
    for k in range(size):
        at[k] = x[k]
    for j in range(stage):
        weight = h * STAGE_WEIGHTS[stage, j]
        if weight != 0.0:
            for k in range(size):
                at[k] += weight * slopes[j, k]


@inlined
def complete_step(x: Vector, slopes: Matrix, h: float) -> None:
    """Replace x by the state at the end of the step of length h."""
    for j in range(STAGES):
        weight = h * STEP_WEIGHTS[j]
        if weight != 0.0:
            for k in range(slopes.shape[1]):
                x[k] += weight * slopes[j, k]


@inlined
def take_steps(
    kind: int, p: Vector, effort: Vector, h: float, steps: int, n: int, m: int, x: Vector
) -> None:
    """Replace x by the state after `steps` steps of length h with the effort held.

    Args:
        kind, p, effort: as in derivative.
        h: length of a step [s].
        steps: how many.
        n, m: coordinates and joints.
        x: in and out, state [q, v], shape (2 n,).
    """
    work = np.empty((STAGES + 2 + 2 * m, 2 * n))  # one allocation instead of six
    slopes, at, a = work[:STAGES], work[STAGES], work[STAGES + 1, :n]
    modal = work[STAGES + 1, n : 2 * n - m]
    joints = work[STAGES + 2 : STAGES + 2 + m, :m]
    coupling = work[STAGES + 2 + m :, : n - m]
    for _ in range(steps):
        for i in range(STAGES):
            stage_state(x, slopes, i, h, at)
            acceleration(kind, p, at, effort, joints, coupling, modal, a)
            for k in range(n):
                slopes[i, k] = at[n + k]
                slopes[i, n + k] = a[k]
        complete_step(x, slopes, h)


@compiled
def advance(kind: int, p: Vector, x: Vector, effort: Vector, dt: float, steps: int) -> Vector:
    """Return the state after dt with the effort held: `steps` equal steps of order 8.

    Args:
        kind, p, x, effort: as in derivative.
        dt: interval [s].
        steps: how many steps share it.
    """
    now = x.copy()
    take_steps(kind, p, effort, dt / steps, steps, x.size // 2, effort.size, now)
    return now


@lru_cache
def stepper(kind: int, n: int, m: int) -> Stepper:
    """Return `advance` for one size of state, which replaces the state given as last argument.

    The compiler unrolls the short loops of sizes that it knows, and no array need be made for
    Python: half the time of a call of `advance`, to the same bits.

    Args:
        kind: the testbed's number.
        n: coordinates.
        m: joints.
    """

    @compiled
    def advance_in_place(p: Vector, effort: Vector, dt: float, steps: int, x: Vector) -> None:
        take_steps(kind, p, effort, dt / steps, steps, n, m, x)

    return advance_in_place


@compiled
def jacobian(kind: int, p: Vector, x: Vector, effort: Vector, dx: Matrix, du: Matrix) -> None:
    """Write df/dx, shape (2 n, 2 n), and df/du, shape (2 n, joints), of derivative.

    From M da = -dr at fixed a, where r = M(q) a + h(q, v).
    """
    n, m = x.size // 2, effort.size
    joints, coupling, modal = np.empty((m, m)), np.empty((m, n - m)), np.empty(n - m)
    a, column = np.empty(n), np.empty(n)
    dq, dv = np.empty((n, n)), np.empty((n, n))
    acceleration(kind, p, x, effort, joints, coupling, modal, a)
    residual_jacobian(kind, p, x, a, dq, dv)
    dx[:] = 0.0
    du[:] = 0.0
    for j in range(n):
        dx[j, n + j] = 1.0
        for i in range(n):
            column[i] = -dq[i, j]
        solve(joints, coupling, modal, column)
        dx[n:, j] = column
        for i in range(n):
            column[i] = -dv[i, j]
        solve(joints, coupling, modal, column)
        dx[n:, n + j] = column
    for j in range(m):
        column[:] = 0.0
        column[j] = 1.0
        solve(joints, coupling, modal, column)
        du[n:, j] = column


@compiled
def energy(kind: int, p: Vector, x: Vector, joints: int) -> float:
    """Return v^T M(q) v / 2 + U(q) [J] of the state x = [q, v]."""
    n, m = x.size // 2, joints
    block, coupling, modal = np.empty((m, m)), np.empty((m, n - m)), np.empty(n - m)
    bias = np.empty(n)
    terms(kind, p, x, block, coupling, modal, bias)
    total = 0.0
    for i in range(m):
        for j in range(m):
            total += 0.5 * x[n + i] * block[i, j] * x[n + j]
        for j in range(n - m):
            total += x[n + i] * coupling[i, j] * x[n + m + j]
    for j in range(n - m):
        total += 0.5 * modal[j] * x[n + m + j] ** 2
    return total + potential(kind, p, x[:n])
