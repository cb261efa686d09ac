"""Forward dynamics of every testbed and the fixed-step integration, as compiled kernels.

A testbed is M(q, t) a + h(q, v, t) = B u, x = [q, v], with the joints first and the modes after
them. The equations are those of `kernels`.
"""

from typing import NamedTuple

import numpy as np
from scipy.integrate import DOP853

from flexslew_plant.arrays import Matrix, Vector, compiled_once, inline, merged
from flexslew_plant.testbeds.compiled import interface, mass
from flexslew_plant.testbeds.kernels import Kernels

# Dormand and Prince's method of order 8, without its error estimate: 12 stages
STAGES = 12
STAGE_TIMES: Vector = np.array(DOP853.C[:STAGES], dtype=np.float64)
STAGE_WEIGHTS: Matrix = np.array(DOP853.A[:STAGES, :STAGES], dtype=np.float64)
STEP_WEIGHTS: Vector = np.array(DOP853.B[:STAGES], dtype=np.float64)


class MassBlocks(NamedTuple):
    """Work arrays for the blocks of a mass matrix, s = interface.square."""

    joints: Matrix  # (s, s)
    coupling: Matrix  # (s, n - s)
    modal: Vector  # the diagonal, (n - s,)


class HeldEffort(NamedTuple):
    """A testbed under a constant effort."""

    kernels: Kernels  # its equations
    p: Vector  # its packed parameters
    effort: Vector  # of the actuators, shape (actuators,) [N m or N]


class StepWork(NamedTuple):
    """Work arrays for steps of the integration."""

    slopes: Matrix  # (STAGES, size of a state)
    at: Vector  # a state
    a: Vector  # accelerations, (n,)
    blocks: MassBlocks


# not strided: what a testbed's author has compiled would be compiled for parts of matrices, too
@merged("out", strided=False)
def acceleration(
    kernels: Kernels,
    p: Vector,
    t: float,
    x: Vector,
    effort: Vector,
    blocks: MassBlocks,
    out: Vector,
) -> None:
    """Write a = M^-1 (B u - h); blocks are left holding M after `factor`."""
    joints, coupling, modal = blocks
    interface.terms(kernels, p, t, x, joints, coupling, modal, out)
    for i in range(out.size):
        out[i] = -out[i]
    interface.actuation(kernels, p, t, x, effort, out)
    mass.factor(joints, coupling, modal)
    mass.solve(joints, coupling, modal, out)


@compiled_once()
def derivative(
    kernels: Kernels, p: Vector, t: float, x: Vector, effort: Vector, joints: int
) -> Vector:
    """Return f(t, x, u) = [q', M^-1 (B u - h)], shape of x.

    Args:
        kernels: the testbed's equations.
        p: its packed parameters.
        t: time [s].
        x: state [q, v], joints before modes.
        effort: of the actuators, shape (actuators,) [N m or N].
        joints: how many coordinates stand before the modes.
    """
    n = (x.size - interface.extra(kernels)) // 2
    s = interface.square(kernels, n, joints)
    a, rate = np.empty(n), np.empty(x.size)
    blocks = MassBlocks(np.empty((s, s)), np.empty((s, n - s)), np.empty(n - s))
    acceleration(kernels, p, t, x, effort, blocks, a)
    interface.position_rates(kernels, p, t, x, rate)
    for k in range(n):
        rate[x.size - n + k] = a[k]
    return rate


@inline
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


@inline
def complete_step(x: Vector, slopes: Matrix, h: float) -> None:
    """Replace x by the state at the end of the step of length h."""
    for j in range(STAGES):
        weight = h * STEP_WEIGHTS[j]
        if weight != 0.0:
            for k in range(slopes.shape[1]):
                x[k] += weight * slopes[j, k]


@inline
def take_steps(held: HeldEffort, t: float, h: float, steps: int, n: int, m: int, x: Vector) -> None:
    """Replace x by the state after `steps` steps of length h with the effort held.

    Args:
        held: testbed and effort.
        t: time [s].
        h: length of a step [s].
        steps: how many.
        n, m: coordinates and joints.
        x: in and out, state [q, v].
    """
    s, size = interface.square(held.kernels, n, m), n + n + interface.extra(held.kernels)
    work = np.empty((STAGES + 2, size))  # one allocation instead of four
    modal = work[STAGES + 1, n : 2 * n - s]
    blocks = MassBlocks(np.empty((s, s)), np.empty((s, n - s)), modal)
    arrays = StepWork(work[:STAGES], work[STAGES], work[STAGES + 1, :n], blocks)
    step_in_place(held, t, h, steps, n, x, arrays)


@inline
def step_in_place(
    held: HeldEffort, t: float, h: float, steps: int, n: int, x: Vector, work: StepWork
) -> None:
    """Take steps as take_steps does, within arrays that are there."""
    kernels, p, effort = held
    slopes, at, a, blocks = work
    first = n + interface.extra(kernels)  # of v in x
    for step in range(steps):
        for i in range(STAGES):
            stage_state(x, slopes, i, h, at)
            now = t + (step + STAGE_TIMES[i]) * h
            acceleration(kernels, p, now, at, effort, blocks, a)
            interface.position_rates(kernels, p, now, at, slopes[i])
            for k in range(n):
                slopes[i, first + k] = a[k]
        complete_step(x, slopes, h)


@compiled_once("dx", "du")
def jacobian(
    kernels: Kernels,
    p: Vector,
    t: float,
    x: Vector,
    effort: Vector,
    joints: int,
    dx: Matrix,
    du: Matrix,
) -> None:
    """Write df/dx, shape (2 n, 2 n), and df/du, shape (2 n, actuators), of derivative.

    From M da = -dr at fixed a, where r = M(q) a + h(q, v) - B u; for testbeds with q' = v.
    """
    n = x.size // 2
    s = interface.square(kernels, n, joints)
    block, coupling, modal = np.empty((s, s)), np.empty((s, n - s)), np.empty(n - s)
    a, column, one = np.empty(n), np.empty(n), np.zeros(effort.size)
    dq, dv = np.empty((n, n)), np.empty((n, n))
    acceleration(kernels, p, t, x, effort, MassBlocks(block, coupling, modal), a)
    interface.residual_jacobian(kernels, p, t, x, a, dq, dv)
    dx[:] = 0.0
    du[:] = 0.0
    for j in range(n):
        dx[j, n + j] = 1.0
        for i in range(n):
            column[i] = -dq[i, j]
        mass.solve(block, coupling, modal, column)
        for i in range(n):
            dx[n + i, j] = column[i]
            column[i] = -dv[i, j]
        mass.solve(block, coupling, modal, column)
        for i in range(n):
            dx[n + i, n + j] = column[i]
    for j in range(effort.size):
        column[:] = 0.0
        one[:] = 0.0
        one[j] = 1.0
        interface.actuation(kernels, p, t, x, one, column)
        mass.solve(block, coupling, modal, column)
        for i in range(n):
            du[n + i, j] = column[i]


@compiled_once()
def energy(kernels: Kernels, p: Vector, t: float, x: Vector, joints: int) -> float:
    """Return v^T M(q) v / 2 + U(q) [J] of the state x = [q, v]."""
    n = (x.size - interface.extra(kernels)) // 2
    s, first = interface.square(kernels, n, joints), x.size - n
    block, coupling, modal = np.empty((s, s)), np.empty((s, n - s)), np.empty(n - s)
    bias = np.empty(n)
    interface.terms(kernels, p, t, x, block, coupling, modal, bias)
    total = 0.0
    for i in range(s):
        for j in range(s):
            total += 0.5 * x[first + i] * block[i, j] * x[first + j]
        for j in range(n - s):
            total += x[first + i] * coupling[i, j] * x[first + s + j]
    for j in range(n - s):
        total += 0.5 * modal[j] * x[first + s + j] ** 2
    return total + interface.potential(kernels, p, t, x[:first])
