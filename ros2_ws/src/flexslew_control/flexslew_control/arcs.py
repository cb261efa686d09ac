"""Arcs of constant effort flown as kernels: final state, exact sensitivities and the costate.

Every arc is integrated from its beginning to its end by steps of order 8, so no step ever crosses
a switch and the durations may be any real numbers.
"""

import numpy as np

from flexslew_plant import dynamics
from flexslew_plant.arrays import Matrix, Vector, compiled
from flexslew_plant.dynamics import STAGE_WEIGHTS, STAGES, STEP_WEIGHTS


@compiled
def final_state(
    kind: int, p: Vector, start: Vector, efforts: Matrix, durations: Vector, step: float
) -> Vector:
    """Return the state after all arcs, shape (2 n,).

    Args:
        kind, p: the model's kernels and numbers, as in dynamics.derivative.
        start: state at the beginning of the first arc, shape (2 n,).
        efforts: one row an arc, shape (arcs, joints) [N m or N].
        durations: shape (arcs,) [s].
        step: longest step of the integration [s].
    """
    x = start.copy()
    for i in range(durations.size):
        steps = max(1, int(np.ceil(abs(durations[i]) / step)))
        x = dynamics.advance(kind, p, x, efforts[i], durations[i], steps)
    return x


@compiled
def final_sensitivity(
    kind: int, p: Vector, start: Vector, efforts: Matrix, durations: Vector, step: float
) -> tuple[Vector, Matrix]:
    """Return the state after all arcs and its derivatives by their durations.

    With x' = f(x, u_i) on arc i: dx/dd_i = f at the end of the arc, then S' = (df/dx) S.

    Args:
        kind, p, start, efforts, durations, step: as in final_state.

    Returns:
        the state, shape (2 n,), and dx_f/dd, shape (2 n, arcs).
    """
    arcs, n, m = durations.size, start.size // 2, efforts.shape[1]
    joints, coupling, modal = np.empty((m, m)), np.empty((m, n - m)), np.empty(n - m)
    dq, dv, a, r = np.empty((n, n)), np.empty((n, n)), np.empty(n), np.empty(n)
    slopes, at = np.empty((STAGES, 2 * n)), np.empty(2 * n)
    s, s_at = np.zeros((arcs, 2 * n)), np.zeros((arcs, 2 * n))  # one row a duration
    s_slopes = np.empty((STAGES, arcs, 2 * n))
    x = start.copy()
    for arc in range(arcs):
        steps = max(1, int(np.ceil(abs(durations[arc]) / step)))
        h = durations[arc] / steps
        for _ in range(steps):
            for stage in range(STAGES):
                dynamics.stage_state(x, slopes, stage, h, at)
                dynamics.acceleration(kind, p, at, efforts[arc], joints, coupling, modal, a)
                for k in range(n):
                    slopes[stage, k] = at[n + k]
                    slopes[stage, n + k] = a[k]
                if arc == 0:
                    continue
                dynamics.residual_jacobian(kind, p, at, a, dq, dv)
                for c in range(arc):
                    for k in range(2 * n):
                        s_at[c, k] = s[c, k]
                for j in range(stage):
                    weight = h * STAGE_WEIGHTS[stage, j]
                    if weight != 0.0:
                        for c in range(arc):
                            for k in range(2 * n):
                                s_at[c, k] += weight * s_slopes[j, c, k]
                for c in range(arc):
                    for i in range(n):
                        r[i] = 0.0
                        for k in range(n):
                            r[i] -= dq[i, k] * s_at[c, k] + dv[i, k] * s_at[c, n + k]
                    dynamics.solve(joints, coupling, modal, r)
                    for k in range(n):
                        s_slopes[stage, c, k] = s_at[c, n + k]
                        s_slopes[stage, c, n + k] = r[k]
            dynamics.complete_step(x, slopes, h)
            for j in range(STAGES):
                weight = h * STEP_WEIGHTS[j]
                if weight != 0.0:
                    for c in range(arc):
                        for k in range(2 * n):
                            s[c, k] += weight * s_slopes[j, c, k]
        s[arc] = dynamics.derivative(kind, p, x, efforts[arc])
    return x, s.T.copy()


@compiled
def costate_backwards(
    kind: int,
    p: Vector,
    final: Vector,
    costate: Vector,
    efforts: Matrix,
    durations: Vector,
    step: float,
) -> tuple[Vector, Matrix]:
    """Return the times and lambda^T df/du along the arcs, from the end to the beginning.

    lambda' = -(df/dx)^T lambda is integrated backwards together with the state.

    Args:
        kind, p, efforts, durations, step: as in final_state.
        final: state at the end, shape (2 n,).
        costate: lambda at the end, shape (2 n,).

    Returns:
        falling times, shape (samples,) [s]; lambda^T df/du, shape (samples, joints).
    """
    n2, m = final.size, efforts.shape[1]
    counts = np.empty(durations.size, dtype=np.int64)
    for i in range(durations.size):
        counts[i] = max(1, int(np.ceil(abs(durations[i]) / step)))
    times, values = np.empty(counts.sum() + 1), np.empty((counts.sum() + 1, m))
    dx, du = np.empty((n2, n2)), np.empty((n2, m))
    y, at = np.concatenate((final, costate)), np.empty(2 * n2)
    slopes = np.empty((STAGES, 2 * n2))
    row, t = 0, durations.sum()
    for back in range(durations.size):
        arc = durations.size - 1 - back
        h = -durations[arc] / counts[arc]
        for _ in range(counts[arc]):
            for stage in range(STAGES):
                dynamics.stage_state(y, slopes, stage, h, at)
                dynamics.jacobian(kind, p, at[:n2], efforts[arc], dx, du)
                if stage == 0:
                    times[row] = t
                    values[row] = du.T @ y[n2:]
                slopes[stage, :n2] = dynamics.derivative(kind, p, at[:n2], efforts[arc])
                slopes[stage, n2:] = -(dx.T @ at[n2:])
            dynamics.complete_step(y, slopes, h)
            row += 1
            t += h
    dynamics.jacobian(kind, p, y[:n2], efforts[0], dx, du)
    times[row] = t
    values[row] = du.T @ y[n2:]
    return times, values
