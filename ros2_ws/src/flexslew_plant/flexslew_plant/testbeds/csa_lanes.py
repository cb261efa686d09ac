"""The complete or printed CSA testbed for many trials at once: one lane per trial, SIMD across.

Arrays are flat, coordinate after coordinate with LANES neighbours each: all offsets are constants
of the compiler, so that each innermost loop becomes vector instructions. The scheme is Dormand
and Prince's of order 5: at 10 ms its metrics are those of the bench's order 8 to 1e-11.
"""

from functools import lru_cache
from typing import cast

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, vectorised
from flexslew_plant.testbeds.lanes import LANES, Advance, LaneKernel

# pi / 2 in three parts, the first two short, so that multiples of them are exact (Cody and Waite)
_P1, _P2, _P3 = 1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21
_ROUND = 6755399441055744.0  # 1.5 * 2**52: adding and subtracting it rounds to an integer
_REACH = 0.1  # largest frequency times step at which the scheme is good for 1e-11 [-]
SCRATCH = 7  # states at a stage, and six slopes


def prepared(packed: Matrix) -> Vector:
    """Return the constants of `advance` from packed parameters, shape (4 + 4 modes, LANES).

    Flat, LANES of each: complete, J_a - sum of m^2 / M_qq, J_1, J_2, J_a, then of each mode m,
    m / M_qq, K_qq / M_qq and C_qq / M_qq.
    """
    m, mass, stiffness, damping = packed[4:].reshape(4, -1, packed.shape[1])
    arm = packed[1] - (m * m / mass).sum(axis=0)
    head = (packed[0], arm, packed[2], packed[3], packed[1])
    return np.vstack((*head, m, m / mass, stiffness / mass, damping / mass)).ravel()


@vectorised
def sine_cosine(angle: float) -> tuple[float, float]:
    """Return sin and cos of an angle below 1e5 rad, to one unit in the last place."""
    turns = (angle * 0.6366197723675814 + _ROUND) - _ROUND
    r = ((angle - turns * _P1) - turns * _P2) - turns * _P3
    z = r * r
    s = r + r * z * (
        -1.66666666666666324348e-01
        + z
        * (
            8.33333333332248946124e-03
            + z
            * (
                -1.98412698298579493134e-04
                + z
                * (
                    2.75573137070700676789e-06
                    + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
                )
            )
        )
    )
    c = (
        1.0
        - 0.5 * z
        + z
        * z
        * (
            4.16666666666666019037e-02
            + z
            * (
                -1.38888888888741095749e-03
                + z
                * (
                    2.48015872894767294178e-05
                    + z
                    * (
                        -2.75573143513906633035e-07
                        + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)
                    )
                )
            )
        )
    )
    quarter = turns - 4.0 * ((0.25 * turns + _ROUND) - _ROUND)  # -2, -1, 0, 1 or 2
    odd = quarter * quarter == 1.0
    a, b = (c if odd else s), (s if odd else c)
    sine = -a if (quarter < -0.5 or quarter > 1.5) else a
    cosine = -b if (quarter > 0.5 or quarter < -1.5) else b
    return sine, cosine


@lru_cache
def advance(modes: int) -> Advance:
    """Return the step of a testbed with so many modes; see lanes.Advance."""
    size = 2 * (2 + modes) * LANES
    yaw_rate, pitch_rate = (2 + modes) * LANES, (3 + modes) * LANES
    deflection, deflecting = 2 * LANES, (4 + modes) * LANES
    coupling, share = 5 * LANES, (5 + modes) * LANES
    stiff, damp = (5 + 2 * modes) * LANES, (5 + 3 * modes) * LANES

    @vectorised
    def slope(c: Vector, x: Vector, effort: Vector, out: Vector) -> None:
        """Write [v, M^-1 (u - h)] of csa.terms for every lane."""
        for k in range(LANES):
            s, cos = sine_cosine(x[LANES + k])
            complete, w, r = c[k], x[yaw_rate + k], x[pitch_rate + k]
            sway, swaying = 0.0, 0.0  # m^T q and m^T q'
            for j in range(modes):
                m = c[coupling + j * LANES + k]
                sway += m * x[deflection + j * LANES + k]
                swaying += m * x[deflecting + j * LANES + k]
            turning = cos * s * c[4 * LANES + k] * w
            yaw, pitch = c[2 * LANES + k] + c[LANES + k] * cos * cos, c[3 * LANES + k]
            cross = complete * s * sway
            pull_yaw = (
                effort[k]
                + 2.0 * turning * r
                - complete * cos * r * r * sway
                + (1.0 - complete) * s * r * swaying
            )
            pull_pitch = effort[LANES + k] - turning * w - (1.0 + complete) * s * w * swaying
            coriolis = -(1.0 + complete) * s * w * r
            driven = 0.0  # m^T of the modes' accelerations with the joints held
            for j in range(modes):
                held = -(
                    coriolis * c[share + j * LANES + k]
                    + c[stiff + j * LANES + k] * x[deflection + j * LANES + k]
                    + c[damp + j * LANES + k] * x[deflecting + j * LANES + k]
                )
                driven += c[coupling + j * LANES + k] * held
            pull_yaw -= cos * driven
            scale = 1.0 / (yaw * pitch - cross * cross)
            turn = (pitch * pull_yaw - cross * pull_pitch) * scale
            out[k] = w
            out[LANES + k] = r
            out[yaw_rate + k] = turn
            out[pitch_rate + k] = (yaw * pull_pitch - cross * pull_yaw) * scale
            for j in range(modes):
                held = -(
                    coriolis * c[share + j * LANES + k]
                    + c[stiff + j * LANES + k] * x[deflection + j * LANES + k]
                    + c[damp + j * LANES + k] * x[deflecting + j * LANES + k]
                )
                out[deflection + j * LANES + k] = x[deflecting + j * LANES + k]
                out[deflecting + j * LANES + k] = held - c[share + j * LANES + k] * cos * turn

    @vectorised
    def step(
        c: Vector, t: float, effort: Vector, dt: float, steps: int, x: Vector, work: Vector
    ) -> None:
        h = dt / steps
        at, k1, k2, k3 = work[:size], work[size:], work[2 * size :], work[3 * size :]
        k4, k5, k6 = work[4 * size :], work[5 * size :], work[6 * size :]
        for _ in range(steps):
            slope(c, x, effort, k1)
            for i in range(size):
                at[i] = x[i] + h * (0.2 * k1[i])
            slope(c, at, effort, k2)
            for i in range(size):
                at[i] = x[i] + h * (3.0 / 40.0 * k1[i] + 9.0 / 40.0 * k2[i])
            slope(c, at, effort, k3)
            for i in range(size):
                at[i] = x[i] + h * (44.0 / 45.0 * k1[i] - 56.0 / 15.0 * k2[i] + 32.0 / 9.0 * k3[i])
            slope(c, at, effort, k4)
            for i in range(size):
                at[i] = x[i] + h * (
                    19372.0 / 6561.0 * k1[i]
                    - 25360.0 / 2187.0 * k2[i]
                    + 64448.0 / 6561.0 * k3[i]
                    - 212.0 / 729.0 * k4[i]
                )
            slope(c, at, effort, k5)
            for i in range(size):
                at[i] = x[i] + h * (
                    9017.0 / 3168.0 * k1[i]
                    - 355.0 / 33.0 * k2[i]
                    + 46732.0 / 5247.0 * k3[i]
                    + 49.0 / 176.0 * k4[i]
                    - 5103.0 / 18656.0 * k5[i]
                )
            slope(c, at, effort, k6)
            for i in range(size):
                x[i] += h * (
                    35.0 / 384.0 * k1[i]
                    + 500.0 / 1113.0 * k3[i]
                    + 125.0 / 192.0 * k4[i]
                    - 2187.0 / 6784.0 * k5[i]
                    + 11.0 / 84.0 * k6[i]
                )

    return cast(Advance, step)


def needed_steps(p: Vector, dt: float) -> int:
    """Return how many steps of order 5 an interval needs for packed parameters, shape (P,).

    The highest frequency is below max(K_qq / M_qq) / (1 - sum of m^2 / (M_qq J)), J all that turns.
    """
    n = (p.size - 4) // 4
    m, mass, stiffness = p[4 : 4 + n], p[4 + n : 4 + 2 * n], p[4 + 2 * n : 4 + 3 * n]
    held = float(np.sum(m * m / mass) / (p[1] + p[2]))
    fastest = np.sqrt(float(np.max(stiffness / mass)) / max(1.0 - held, 1e-3))
    return max(1, int(np.ceil(fastest * dt / _REACH)))


def lane_kernel(modes: int) -> LaneKernel:
    """Return how a testbed with so many modes flies in lanes."""
    return LaneKernel(advance(modes), SCRATCH, prepared, needed_steps)
