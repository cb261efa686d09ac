"""The complete or printed CSA testbed for many trials at once: one lane per trial, SIMD across.

One flat array holds everything, row after row with LANES neighbours each: all offsets are constants
of the compiler, so that each innermost loop becomes vector instructions without a look at whether
arrays overlap. At 10 ms the metrics are those of the bench's order 8 to 1e-11.
"""

from functools import lru_cache
from math import ceil, sqrt
from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, vectorised
from flexslew_plant.testbeds.compiled.lane_steps import STAGES, OnRows, order_five
from flexslew_plant.testbeds.compiled.lanes import LANES, Advance, LaneKernel

# pi / 2 in three parts, the first two short, so that multiples of them are exact (Cody and Waite)
_P1, _P2, _P3 = 1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21
_ROUND = 6755399441055744.0  # 1.5 * 2**52: adding and subtracting it rounds to an integer
_REACH = 0.1  # largest frequency times step at which the scheme is good for 1e-11 [-]


class _Rows(NamedTuple):
    """Where in the flat array everything begins, see `rows_of`."""

    effort: int
    constants: int
    coupling: int  # m of each mode, and so on: see `constants`
    share: int
    stiff: int
    damp: int
    at: int  # the state of a stage
    turned: int  # pitch, its sine and its cosine at the step's begin
    slope: int  # accelerations of a stage
    kept: int  # those of the stages but the last
    end: int


def rows_of(modes: int) -> _Rows:
    """Return where in the array of so many modes everything begins, the states at 0."""
    n = 2 + modes
    counts = (2 * n, 2, 7, modes, modes, modes, modes, 2 * n, 3, n, (STAGES - 1) * n)
    return _Rows(*(LANES * sum(counts[: k + 1]) for k in range(len(counts))))


def constants(packed: Matrix) -> Matrix:
    """Return the constants of `advance` from packed parameters, shape (7 + 4 modes, LANES).

    1 + complete, complete, J_a - sum of m^2 / M_qq, J_1, J_2, J_a, 1 - complete, then of each mode
    m, m / M_qq, K_qq / M_qq and C_qq / M_qq.
    """
    m, mass, stiffness, damping = packed[4:].reshape(4, -1, packed.shape[1])
    arm = packed[1] - (m * m / mass).sum(axis=0)
    complete = packed[0]
    head = (1.0 + complete, complete, arm, packed[2], packed[3], packed[1], 1.0 - complete)
    return np.vstack((*head, m, m / mass, stiffness / mass, damping / mass))


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
    rows = rows_of(modes)
    turned = rows.turned

    @vectorised
    def begin(w: Vector) -> None:
        for k in range(LANES):
            angle = w[LANES + k]
            w[turned + k] = angle
            w[turned + LANES + k], w[turned + 2 * LANES + k] = sine_cosine(angle)

    half = (2 + modes) * LANES
    return order_five(half, rows.at, rows.slope, rows.kept, begin, _accelerations(modes))


def _accelerations(modes: int) -> OnRows:
    """Return what writes M^-1 (u - h) of equations.terms for every lane."""
    half = (2 + modes) * LANES
    rows = rows_of(modes)
    effort, given, coupling, share = rows.effort, rows.constants, rows.coupling, rows.share
    stiff, damp, at, turned, slope = rows.stiff, rows.damp, rows.at, rows.turned, rows.slope

    @vectorised
    def accelerate(w: Vector) -> None:
        for k in range(LANES):
            # the angle moves little within a step: sine and cosine come from those at its begin
            moved = w[at + LANES + k] - w[turned + k]
            z = moved * moved
            sin = moved + moved * z * (-1.0 / 6.0 + z * (1.0 / 120.0 - z * (1.0 / 5040.0)))
            less = z * (-0.5 + z * (1.0 / 24.0 - z * (1.0 / 720.0)))
            s = w[turned + LANES + k]
            cos = w[turned + 2 * LANES + k]
            s, cos = s + (s * less + cos * sin), cos + (cos * less - s * sin)
            yaw_rate, pitch_rate = w[at + half + k], w[at + half + LANES + k]
            turned_yaw = s * yaw_rate
            twist = w[given + k] * turned_yaw
            twisting = twist * pitch_rate
            sway, swaying = 0.0, 0.0  # m^T q and m^T q'
            driven = 0.0  # m^T of the modes' accelerations with the joints held
            for j in range(modes):
                row = j * LANES + k
                m = w[coupling + row]
                deflection, rate = w[at + 2 * LANES + row], w[at + half + 2 * LANES + row]
                sway += m * deflection
                swaying += m * rate
                held = (
                    twisting * w[share + row] - w[stiff + row] * deflection - w[damp + row] * rate
                )
                driven += m * held
                w[slope + 2 * LANES + row] = held
            turning = cos * w[given + 5 * LANES + k] * turned_yaw
            yaw = w[given + 3 * LANES + k] + w[given + 2 * LANES + k] * (cos * cos)
            pitch = w[given + 4 * LANES + k]
            swayed = w[given + LANES + k] * sway
            cross = s * swayed
            carried = (
                2.0 * turning
                - cos * (pitch_rate * swayed)
                + s * (w[given + 6 * LANES + k] * swaying)
            )
            pull_yaw = w[effort + k] - cos * driven + pitch_rate * carried
            pull_pitch = w[effort + LANES + k] - turning * yaw_rate - twist * swaying
            scale = 1.0 / (yaw * pitch - cross * cross)
            turn = (pitch * pull_yaw - cross * pull_pitch) * scale
            w[slope + k] = turn
            w[slope + LANES + k] = (yaw * pull_pitch - cross * pull_yaw) * scale
            along = cos * turn
            for j in range(modes):
                row = j * LANES + k
                w[slope + 2 * LANES + row] -= w[share + row] * along

    return accelerate


def needed_steps(p: Vector, dt: float) -> int:
    """Return how many steps of order 5 an interval needs for packed parameters, shape (P,).

    The highest frequency is below max(K_qq / M_qq) / (1 - sum of m^2 / (M_qq J)), J all that turns.
    """
    n = (p.size - 4) // 4
    m, mass, stiffness = p[4 : 4 + n], p[4 + n : 4 + 2 * n], p[4 + 2 * n : 4 + 3 * n]
    held = float(m @ (m / mass)) / float(p[1] + p[2])
    fastest = sqrt(float((stiffness / mass).max()) / max(1.0 - held, 1e-3))
    return max(1, ceil(fastest * dt / _REACH))


@lru_cache  # one for all of them, so that they share one compiled loop
def lane_kernel(modes: int) -> LaneKernel:
    """Return how a testbed with so many modes flies in lanes."""
    rows = rows_of(modes)

    def place(packed: Matrix) -> Vector:
        w = np.zeros(rows.end)
        w[rows.constants : rows.at] = constants(packed).ravel()
        return w

    return LaneKernel(advance(modes), rows.end, place, needed_steps)
