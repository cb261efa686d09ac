"""The closed loop over a manoeuvre and its exact sensitivities, as compiled kernels.

The drives apply u = d(t) - Kp q - Kd v to the joints, which is (12), (13) of Gorinevsky and
Vukovich (1998) with d = u_ff + Kp q_ref + Kd v_ref gathered in one table `drive` at the stages of
the integrator.
So the kernels know neither the reference nor the basis of the feedforward.
"""

from typing import NamedTuple, TypeAlias

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, compiled
from flexslew_plant.testbeds.compiled import dynamics, interface, mass
from flexslew_plant.testbeds.compiled.dynamics import (
    STAGE_TIMES,
    STAGE_WEIGHTS,
    STAGES,
    STEP_WEIGHTS,
)
from flexslew_plant.testbeds.kernels import Kernels
from flexslew_plant.testbeds.model import Model

# JointLoop without its kernels and StageRecord, as plain tuples
_Loop: TypeAlias = tuple[Vector, Vector, Vector, tuple[int, ...], tuple[int, ...]]
_Record: TypeAlias = tuple[Matrix, Matrix, Matrix]


class JointLoop(NamedTuple):
    """A testbed in the loop that its joint feedback closes.

    Their lengths make n and the joints constants to the compiler, which unrolls the short loops:
    three times faster than with sizes read from arrays.
    """

    kernels: Kernels
    p: Vector  # packed parameters
    kp: Vector  # shape (joints,) [N m/rad]
    kd: Vector  # shape (joints,) [N m s/rad]
    coordinates: tuple[int, ...]  # n zeros
    joints: tuple[int, ...]  # as many zeros as joints


class StageRecord(NamedTuple):
    """The states at every stage of a roll-out, and d, from which they follow."""

    inputs: Matrix  # d, shape (STAGES steps, joints) [N m or N]
    states: Matrix  # shape (STAGES steps, 2 n)
    accelerations: Matrix  # shape (STAGES steps, n)


def joint_loop(model: Model, kp: Vector, kd: Vector) -> JointLoop:
    """Return a model in the loop of these gains."""
    zeros = (0,) * model.coordinates, (0,) * model.joints
    return JointLoop(model.kernels, model.packed, kp, kd, *zeros)


def stage_record(inputs: Matrix, coordinates: int) -> StageRecord:
    """Return a record with room for the states and accelerations that follow from d."""
    stages = len(inputs)
    return StageRecord(inputs, np.empty((stages, 2 * coordinates)), np.empty((stages, coordinates)))


def roll_out(loop: JointLoop, start: Vector, edges: Vector, record: StageRecord) -> Matrix:
    """Return the states at the edges, shape (steps + 1, 2 n), one step of order 8 between each two.

    Args:
        loop: testbed and feedback.
        start: state [q, v] at edges[0], shape (2 n,).
        edges: rising times, shape (steps + 1,) [s].
        record: d, and out: the states and accelerations.
    """
    # plain tuples, which Numba recognises in a fiftieth of the time of named ones
    return _roll_out(loop.kernels, loop[1:], start, edges, record[:])


@compiled
def _roll_out(
    kernels: Kernels, loop: _Loop, start: Vector, edges: Vector, record: _Record
) -> Matrix:
    """See roll_out."""
    (p, kp, kd, coordinates, joints), (inputs, states, accelerations) = loop, record
    n, m, steps = len(coordinates), len(joints), edges.size - 1
    s = interface.square(kernels, n, m)
    blocks = dynamics.MassBlocks(np.empty((s, s)), np.empty((s, n - s)), np.empty(n - s))
    slopes, at, a, effort = np.empty((STAGES, 2 * n)), np.empty(2 * n), np.empty(n), np.empty(m)
    now, path = start.copy(), np.empty((steps + 1, 2 * n))
    for k in range(2 * n):
        path[0, k] = now[k]
    for step in range(steps):
        h = edges[step + 1] - edges[step]
        for i in range(STAGES):
            row = step * STAGES + i
            dynamics.stage_state(now, slopes, i, h, at)
            for j in range(m):
                effort[j] = inputs[row, j] - kp[j] * at[j] - kd[j] * at[n + j]
            now_at = edges[step] + STAGE_TIMES[i] * h
            dynamics.acceleration(kernels, p, now_at, at, effort, blocks, a)
            for k in range(n):
                slopes[i, k] = at[n + k]
                slopes[i, n + k] = a[k]
                states[row, k] = at[k]
                states[row, n + k] = at[n + k]
                accelerations[row, k] = a[k]
        dynamics.complete_step(now, slopes, h)
        for k in range(2 * n):
            path[step + 1, k] = now[k]
    return path


def final_sensitivity(
    loop: JointLoop, edges: Vector, record: StageRecord, out: Matrix, transitions: Matrix
) -> None:
    """Write d x(T) / d drive, the exact derivative of roll_out, by its adjoint.

    Backwards through every stage, with g = A^T k and k = h b_i L + h sum_l a_li g_l, where L is
    the adjoint of the step's end and A = [[0, I], [P, Q]], M [P Q] = -[dr/dq + Kp, dr/dv + Kd].
    One pass serves all 2 n components of x(T), for any number of inputs.

    With room in `transitions` every step is taken for the last one: then `out` holds the
    derivatives of the state at the step's own end.

    Args:
        loop, edges, record: of the roll_out.
        out: shape (STAGES steps, joints 2 n): per stage and joint the 2 n derivatives.
        transitions: out, shape (steps, (2 n)^2): entry k 2 n + r of a row is the derivative of
            component r at the step's end by component k at its start; or shape (0, 0).
    """
    _final_sensitivity(loop.kernels, loop[1:], edges, record[:], out, transitions)


@compiled
def _final_sensitivity(
    kernels: Kernels,
    loop: _Loop,
    edges: Vector,
    record: _Record,
    out: Matrix,
    transitions: Matrix,
) -> None:
    """See final_sensitivity."""
    (p, kp, kd, coordinates, joints), (_, states, accelerations) = loop, record
    n, m, steps = len(coordinates), len(joints), edges.size - 1
    rows = 2 * n
    half = n * rows  # where the velocity components start
    s = interface.square(kernels, n, m)
    block, coupling, modal = np.empty((s, s)), np.empty((s, n - s)), np.empty(n - s)
    x, a, column = np.empty(rows), np.empty(n), np.empty(n)
    dq, dv, scale = np.empty((n, n)), np.empty((n, n)), np.empty(n - s)
    # flat: entry k rows + r is component k of the adjoint of x_r(T)
    g, adjoint, mu = np.empty((STAGES, 2 * half)), np.empty(2 * half), np.empty(half)
    end = np.eye(rows).ravel()
    for step in range(steps - 1, -1, -1):
        h = edges[step + 1] - edges[step]
        for i in range(STAGES - 1, -1, -1):
            row = step * STAGES + i
            weight = h * STEP_WEIGHTS[i]
            for k in range(2 * half):
                adjoint[k] = weight * end[k]
            for later in range(i + 1, STAGES):
                weight = h * STAGE_WEIGHTS[later, i]
                if weight != 0.0:
                    for k in range(2 * half):
                        adjoint[k] += weight * g[later, k]
            for k in range(n):
                x[k], x[n + k], a[k] = states[row, k], states[row, n + k], accelerations[row, k]
            now = edges[step] + STAGE_TIMES[i] * h
            interface.terms(kernels, p, now, x, block, coupling, modal, column)
            interface.residual_jacobian(kernels, p, now, x, a, dq, dv)
            for j in range(m):
                dq[j, j] += kp[j]
                dv[j, j] += kd[j]
            for k in range(half):
                g[i, k] = 0.0
                g[i, half + k] = adjoint[k]
            # mu = M^-1 k_v
            for k in range(half):
                mu[k] = adjoint[half + k]
            mass.solve_rows(block, coupling, modal, scale, mu, rows)
            for k in range(m * rows):
                out[row, k] = mu[k]
            for j in range(n):
                for k in range(n):
                    entry = dq[j, k]
                    if entry != 0.0:
                        for r in range(rows):
                            g[i, k * rows + r] -= entry * mu[j * rows + r]
                    entry = dv[j, k]
                    if entry != 0.0:
                        for r in range(rows):
                            g[i, half + k * rows + r] -= entry * mu[j * rows + r]
        for i in range(STAGES):
            for k in range(2 * half):
                end[k] += g[i, k]
        if transitions.size:
            for k in range(2 * half):
                transitions[step, k] = end[k]
                end[k] = 0.0
            for k in range(rows):
                end[k * rows + k] = 1.0
