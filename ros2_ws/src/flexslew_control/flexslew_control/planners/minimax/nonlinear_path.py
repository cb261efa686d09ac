"""The answer of a plant that is not linear: its flight, and the exact derivatives of every tick.

The flight of a member is taken tick by tick as on the bench. Its derivatives by the efforts follow
from those of the integrator's step, x(k + 1) = f(x(k), u(k)):
    dx_i(k + 1) = F_i dx_i(k) + G_i de_i(k),  dc_i(k) = dw + [Kp Kd] (dy_0(k) - dy_i(k)),
    dx_0(k + 1) = F_0 dx_0(k) + G_0 de_0(k),  dc_0(k) = dw,
with 0 the nominal member, whose path is the reference, c what is commanded and e what the motors
give: e = c, or z(k + 1) = A z + B c, e = C z + D c where they have a lag or a delay.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple, cast

import numpy as np
from numba import types

from flexslew_control.analysis.lti import Lti
from flexslew_control.planners.feedforward.shooting import final_sensitivity, roll_out
from flexslew_control.planners.minimax.response import Grid, Indices
from flexslew_control.planners.motors import Matrices, give, matrices
from flexslew_plant.arrays import Matrix, Tensor, Vector, compiled
from flexslew_plant.testbeds import Model
from flexslew_plant.testbeds.compiled.bound import ADVANCE
from flexslew_plant.testbeds.compiled.dynamics import STAGES


class MemberFlight(NamedTuple):
    """One member under the efforts of a plan and the feedback about the nominal path."""

    states: Matrix  # at the ticks, (ticks + 1, 2 n)
    commanded: Matrix  # feedforward and feedback, (ticks, joints) [N m or N]
    applied: Matrix  # what the motors give, (ticks, joints) [N m or N]
    motors: Vector  # their states at the last tick, (s,)


def flight(
    model: Model, start: Vector, efforts: Matrix, gains: Matrix, path: Matrix | None, motors: Lti
) -> MemberFlight:
    """Return the flight of a member.

    Args:
        model: equations of motion.
        start: state at the first tick, shape (2 n,).
        efforts: of the plan, shape (ticks, joints).
        gains: [Kp Kd], shape (joints, 2 joints).
        path: of the nominal member, (ticks + 1, 2 n); None: this is the nominal member.
        motors: from commands to efforts, tick by tick.
    """
    m, n = model.joints, model.coordinates
    if path is None:
        gains, path = np.zeros_like(gains), np.zeros((len(efforts) + 1, start.size))
    drive = efforts + np.hstack((path[:-1, :m], path[:-1, n : n + m])) @ gains.T
    flown = _kernel()(
        model.integrate, model.packed, start, np.ascontiguousarray(drive),
        np.ascontiguousarray(gains), matrices(motors), motors.period, n, model.before_modes,
    )  # fmt: skip
    return MemberFlight(*flown)


@lru_cache
def _kernel() -> Callable[..., tuple[Matrix, Matrix, Matrix, Vector]]:
    """Return _flown as machine code, the same for all testbeds."""
    vector, matrix = types.Array(types.float64, 1, "C"), types.Array(types.float64, 2, "C")
    kernel: Any = compiled(_flown)
    sizes = types.float64, types.int64, types.int64
    found = types.Tuple((matrix, matrix, matrix, vector))
    motors = types.UniTuple(matrix, 4)
    kernel.compile(found(ADVANCE, vector, vector, matrix, matrix, motors, *sizes))
    kernel.disable_compile()  # never for the type of one testbed's function
    return cast(Callable[..., tuple[Matrix, Matrix, Matrix, Vector]], kernel)


def _flown(
    advance: Callable[..., None],
    p: Vector,
    start: Vector,
    drive: Matrix,
    gains: Matrix,
    motors: Matrices,
    period: float,
    n: int,
    before_modes: int,
) -> tuple[Matrix, Matrix, Matrix, Vector]:
    """Return states, commands, efforts and the motors' states under u = drive - [Kp Kd] y."""
    ticks, m = drive.shape
    path, x, u = np.empty((ticks + 1, start.size)), start.copy(), np.empty(m)
    commanded, applied = np.empty((ticks, m)), np.empty((ticks, m))
    z = np.zeros(len(motors[0]))
    path[0] = x
    for k in range(ticks):
        for j in range(m):
            u[j] = drive[k, j]
            for i in range(m):
                u[j] -= gains[j, i] * x[i] + gains[j, m + i] * x[n + i]
            commanded[k, j] = u[j]
        give(motors, z, u)
        applied[k] = u
        advance(p, k * period, u, period, 1, before_modes, x)
        path[k + 1] = x
    return path, commanded, applied, z


def step_derivatives(
    model: Model, start: Vector, applied: Matrix, period: float
) -> tuple[Tensor, Tensor]:
    """Return F and G of every tick, (ticks, 2 n, 2 n) and (ticks, 2 n, joints).

    Args:
        model: equations of motion.
        start: state at the first tick, shape (2 n,).
        applied: efforts held over each tick, shape (ticks, joints).
        period: one tick [s].
    """
    n, m, ticks = model.coordinates, model.joints, len(applied)
    sizes, none = ((0,) * n, (0,) * m), np.zeros(m)
    edges = period * np.arange(ticks + 1, dtype=np.float64)
    states, accelerations = np.empty((ticks * STAGES, 2 * n)), np.empty((ticks * STAGES, n))
    drive = np.repeat(applied, STAGES, axis=0)
    kernels, p = model.kernels, model.packed
    roll_out(kernels, p, start, edges, drive, none, none, sizes, states, accelerations)
    by_stage, flat = np.empty((ticks * STAGES, m * 2 * n)), np.empty((ticks, 4 * n * n))
    final_sensitivity(
        kernels, p, edges, none, none, sizes, states, accelerations, by_stage, flat
    )  # fmt: skip
    by_joint = by_stage.reshape(ticks, STAGES, m, 2 * n).sum(axis=1)
    return flat.reshape(ticks, 2 * n, 2 * n).swapaxes(1, 2), by_joint.swapaxes(1, 2)


@compiled
def path_derivatives(
    f: Tensor,
    g: Tensor,
    gains: Matrix,
    motors: Matrices,
    reference: Tensor,
    edges: Vector,
    out: Tensor,
) -> Matrix:
    """Write the derivatives of the states at all ticks by the weights.

    Args:
        f: of every tick, shape (ticks, 2 n, 2 n).
        g: of every tick, shape (ticks, 2 n, joints).
        gains: [Kp Kd], shape (joints, 2 joints).
        motors: A, B, C and D from commands to efforts.
        reference: derivatives of the nominal path, (ticks + 1, 2 n, weights).
        edges: ticks at which pieces begin, and the end, shape (pieces + 1,).
        out: for the derivatives of the states at all ticks by the weights, shape
            (ticks + 1, 2 n, weights).

    Returns:
        of the motors' last states, (s, weights).
    """
    ticks, size, m = g.shape
    n, weights = size // 2, out.shape[2]
    effort, late = np.empty((m, weights)), np.zeros((weights, len(motors[0])))
    out[0] = 0.0
    piece = 0
    for k in range(ticks):
        if k >= edges[piece + 1]:
            piece += 1
        known = (piece + 1) * m  # later weights have moved nothing yet
        for j in range(m):
            for w in range(known):
                value = 0.0
                for i in range(m):
                    value += gains[j, i] * (reference[k, i, w] - out[k, i, w])
                    value += gains[j, m + i] * (reference[k, n + i, w] - out[k, n + i, w])
                effort[j, w] = value
            effort[j, piece * m + j] += 1.0
        for w in range(known):
            give(motors, late[w], effort[:, w])
        for r in range(size):
            for w in range(weights):
                out[k + 1, r, w] = 0.0
            for c in range(size):
                factor = f[k, r, c]
                if factor != 0.0:
                    for w in range(known):
                        out[k + 1, r, w] += factor * out[k, c, w]
            for j in range(m):
                factor = g[k, r, j]
                for w in range(known):
                    out[k + 1, r, w] += factor * effort[j, w]
    return late.T


@dataclass(frozen=True)
class TabledPath:
    """The answer of a member about one flight; see response.ResponsePath.

    Args:
        grid: the ticks and pieces.
        about: weights of the flight, shape (weights,).
        values: the channels at every tick but the last, (ticks, channels).
        slopes: derivatives of the channels that have limits, each (ticks, weights).
        end: the deviation from the rest at the goal at the last tick: derivatives and offsets.
    """

    grid: Grid
    about: Vector
    values: Matrix
    slopes: Mapping[int, Matrix]
    end: tuple[Matrix, Vector]

    def flown(self, weights: Vector) -> Matrix:
        """Return the channels at every tick but the last, (ticks, channels)."""
        found, change = self.values.copy(), weights - self.about
        for channel, slopes in self.slopes.items():
            found[:, channel] += slopes @ change
        return found

    def rows(self, ticks: Indices, channel: int) -> tuple[Matrix, Vector]:
        """Return the derivatives of a channel at some ticks, (k, weights), and its offsets."""
        slopes = self.slopes[channel][ticks]
        return slopes, self.values[ticks, channel] - slopes @ self.about


def channels(model: Model, flown: MemberFlight) -> Matrix:
    """Return the channels at every tick but the last, (ticks, channels)."""
    m, n = model.joints, model.coordinates
    states = flown.states[:-1]
    tips, rates = states[:, m:n] @ model.appendages.tip.T, states[:, n : n + m]
    return np.hstack((tips, flown.commanded, states[:, :m], rates))


def deviation(flown: MemberFlight, goal: Vector) -> Vector:
    """Return how far a flight ends from the rest at the goal, shape (2 n + s,)."""
    away: Vector = np.concatenate((flown.states[-1], flown.motors))
    away[: goal.size] -= goal
    return away


class Derived(NamedTuple):
    """A member's path and the derivatives of its states."""

    path: TabledPath
    states: Tensor  # (ticks + 1, 2 n, weights)


def tabled(
    model: Model,
    flown: MemberFlight,
    nominal: Tensor | None,
    gains: Matrix,
    motors: Lti,
    goal: Vector,
    grid: Grid,
    weights: Vector,
    requested: Sequence[int],
) -> Derived:
    """Return the answer of a member about a flight.

    Args:
        model: of the member.
        flown: its flight.
        nominal: derivatives of the nominal member's states; None: this is the nominal member.
        gains: [Kp Kd], shape (joints, 2 joints).
        motors: from commands to efforts, tick by tick.
        goal: joint positions, shape (joints,).
        grid: the ticks and pieces.
        weights: of the flight.
        requested: channels that have limits.
    """
    n = model.coordinates
    f, g = step_derivatives(model, flown.states[0], flown.applied, grid.period)
    states = np.empty((grid.ticks + 1, 2 * n, grid.size))
    edges = np.array(grid.edges, dtype=np.float64)
    own = gains if nominal is not None else np.zeros_like(gains)
    about = nominal if nominal is not None else states
    f, g = np.ascontiguousarray(f), np.ascontiguousarray(g)
    late = path_derivatives(f, g, own, matrices(motors), about, edges, states)
    slopes = {channel: _slopes(model, channel, states, nominal, own, grid) for channel in requested}
    last = np.vstack((states[-1], late))  # a view would keep the other ticks
    offset = deviation(flown, goal) - last @ weights
    path = TabledPath(grid, weights, channels(model, flown), slopes, (last, offset))
    return Derived(path, states)


def _slopes(
    model: Model,
    channel: int,
    states: Tensor,
    nominal: Tensor | None,
    gains: Matrix,
    grid: Grid,
) -> Matrix:
    """Return the derivatives of a channel at every tick but the last, (ticks, weights).

    Args:
        model: of the member.
        channel: which one.
        states: derivatives of the member's states.
        nominal: derivatives of the nominal member's states; None: this is the nominal member.
        gains: [Kp Kd], shape (joints, 2 joints).
        grid: the ticks and pieces.
    """
    m, n, tip = model.joints, model.coordinates, model.appendages.tip
    before = states[:-1]
    if channel < len(tip):
        return np.tensordot(before[:, m:n], tip[channel], axes=(1, 0))
    kind, j = divmod(channel - len(tip), m)
    if kind:
        return before[:, j + (kind - 1) * n].copy()
    found = np.zeros((grid.ticks, grid.size))
    if nominal is not None:
        for i in range(m):
            for gain, row in ((gains[j, i], i), (gains[j, m + i], n + i)):
                if gain:
                    found += gain * (nominal[:-1, row] - before[:, row])
    piece = np.repeat(np.arange(grid.pieces), np.diff(grid.edges))
    found[np.arange(grid.ticks), piece * m + j] += 1.0
    return found
