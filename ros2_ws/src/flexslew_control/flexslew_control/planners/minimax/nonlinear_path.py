"""The answer of a plant that is not linear: its flight, and the derivatives of every tick.

The flight of a member is taken tick by tick as on the bench. Its derivatives by the efforts follow
from those of the integrator's step, x(k + 1) = f(x(k), u(k)), and of the feedback c(x, x_0):
    dx_i(k + 1) = F_i dx_i(k) + G_i de_i(k),  dc_i(k) = dw + H_i dx_i(k) + H_0i dx_0(k),
    dx_0(k + 1) = F_0 dx_0(k) + G_0 de_0(k),  dc_0(k) = dw,
with 0 the nominal member, its path the reference, c the commands and e the efforts of the motors:
e = c, or z(k + 1) = A z + B c, e = C z + D c where they have a lag or a delay.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flexslew_control.analysis.lti import Lti
from flexslew_control.planners.minimax.motion import MemberMotion
from flexslew_control.planners.minimax.response import Grid, Indices
from flexslew_control.planners.residual.closed_loop import ClosedLoopResponse
from flexslew_control.planners.residual.motors import Matrices, matrices, motor_step
from flexslew_plant.arrays import Matrix, Tensor, Vector, called, compiled
from flexslew_plant.testbeds import Model


@called
def _feedback_derivatives(
    by_member: Vector, member: Matrix, by_nominal: Vector, nominal: Matrix, effort: Vector
) -> None:
    """Write the derivatives of one joint's feedback by the first weights, shape (known,)."""
    effort[:] = 0.0
    for i in range(len(by_member)):
        if by_member[i] != 0.0 or by_nominal[i] != 0.0:
            for w in range(len(effort)):
                effort[w] += by_member[i] * member[i, w] + by_nominal[i] * nominal[i, w]


@compiled
def path_derivatives(
    f: Tensor,
    g: Tensor,
    by_member: Tensor,
    by_nominal: Tensor,
    motors: Matrices,
    reference: Tensor,
    edges: Vector,
    out: Tensor,
) -> Matrix:
    """Write the derivatives of the states at all ticks by the weights.

    Args:
        f: of every tick, shape (ticks, size, size).
        g: of every tick, shape (ticks, size, joints).
        by_member: of the feedback by the own state, shape (ticks, joints, size).
        by_nominal: of the feedback by the nominal member's state, of the same shape.
        motors: A, B, C and D from commands to efforts.
        reference: derivatives of the nominal path, (ticks + 1, size, weights).
        edges: ticks at which pieces begin, and the end, shape (pieces + 1,).
        out: for the derivatives of the states at all ticks by the weights, shape
            (ticks + 1, size, weights).

    Returns:
        of the motors' last states, (s, weights).
    """
    ticks, size, m = g.shape
    weights = out.shape[2]
    effort, late = np.empty((m, weights)), np.zeros((weights, len(motors[0])))
    out[0] = 0.0
    piece = 0
    for k in range(ticks):
        if k >= edges[piece + 1]:
            piece += 1
        known = (piece + 1) * m  # later weights have moved nothing yet
        for j in range(m):
            _feedback_derivatives(
                by_member[k, j], out[k], by_nominal[k, j], reference[k], effort[j, :known]
            )
            effort[j, piece * m + j] += 1.0
        for w in range(known):
            motor_step(motors, late[w], effort[:, w])
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
class AffinePath:
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

    def simulate(self, weights: Vector) -> Matrix:
        """Return the channels at every tick but the last, (ticks, channels)."""
        found, change = self.values.copy(), weights - self.about
        for channel, slopes in self.slopes.items():
            found[:, channel] += slopes @ change
        return found

    def rows(self, ticks: Indices, channel: int) -> tuple[Matrix, Vector]:
        """Return the derivatives of a channel at some ticks, (k, weights), and its offsets."""
        slopes = self.slopes[channel][ticks]
        return slopes, self.values[ticks, channel] - slopes @ self.about


def channels(motion: MemberMotion, model: Model, trajectory: ClosedLoopResponse) -> Matrix:
    """Return the channels at every tick but the last, (ticks, channels)."""
    read = trajectory.states[:-1] @ motion.outputs(model).T
    tips, along = len(model.appendages.names), motion.along(trajectory.states[:-1])
    return np.hstack((read[:, :tips], trajectory.commands, read[:, tips:], along))


def deviation(motion: MemberMotion, model: Model, trajectory: ClosedLoopResponse) -> Vector:
    """Return how far a flight ends from the rest at the goal, shape (2 k + s,)."""
    return np.concatenate((motion.deviation(model, trajectory.states[-1]), trajectory.motors))


class PathDerivatives(NamedTuple):
    """A member's path and the derivatives of its states."""

    path: AffinePath
    states: Tensor  # (ticks + 1, size, weights)
    flown: ClosedLoopResponse


class PathProblem(NamedTuple):
    """What the paths of all members of a slew share."""

    motion: MemberMotion  # how the members move
    gains: Matrix  # [Kp Kd], shape (joints, 2 joints)
    motors: Lti  # from commands to efforts, tick by tick
    grid: Grid  # the ticks and pieces
    limited: Sequence[int]  # channels that have limits


def affine_path(
    problem: PathProblem,
    model: Model,
    trajectory: ClosedLoopResponse,
    nominal: PathDerivatives | None,
    weights: Vector,
) -> PathDerivatives:
    """Return the answer of a member about a flight.

    Args:
        problem: of all members.
        model: of the member.
        trajectory: its flight.
        nominal: the answer of the nominal member; None: this is the nominal member.
        weights: of the flight.
    """
    motion, gains, motors, grid, requested = problem
    slopes_of_ticks = trajectory.tick_derivatives(model, grid.period, motion.columns)
    f, g = map(np.ascontiguousarray, slopes_of_ticks)
    states = np.empty((grid.ticks + 1, trajectory.states.shape[1], grid.size))
    if nominal is None:
        by_member = by_nominal = np.zeros(g.swapaxes(1, 2).shape)
        reference = states
    else:
        path = nominal.flown.states[:-1]
        by_member, by_nominal = motion.feedback_derivatives(gains, trajectory.states[:-1], path)
        reference = nominal.states
    edges = np.array(grid.edges, dtype=np.float64)
    late = path_derivatives(f, g, by_member, by_nominal, matrices(motors), reference, edges, states)
    outputs = motion.outputs(model)
    tips, m = len(model.appendages.names), grid.joints
    slopes, others = dict[int, Matrix](), tips + 3 * m
    if any(channel >= others for channel in requested):
        along = motion.along_slopes(trajectory.states[:-1])
    for channel in requested:
        j = channel - tips
        if 0 <= j < m:
            slopes[channel] = _command_derivatives(
                j, states, reference, by_member, by_nominal, grid
            )
        elif channel >= others:
            slopes[channel] = np.zeros((grid.ticks, grid.size))
            _add(along[:, channel - others], states, slopes[channel])
        else:
            slopes[channel] = outputs[channel - m * (j >= m)] @ states[:-1]
    last = np.vstack((motion.deviation_slopes(model, trajectory.states[-1]) @ states[-1], late))
    offset = deviation(motion, model, trajectory) - last @ weights
    found = AffinePath(grid, weights, channels(motion, model, trajectory), slopes, (last, offset))
    return PathDerivatives(found, states, trajectory)


def _command_derivatives(
    j: int, states: Tensor, nominal: Tensor, by_member: Tensor, by_nominal: Tensor, grid: Grid
) -> Matrix:
    """Return the derivatives of the demand on a joint at every tick, (ticks, weights)."""
    found = np.zeros((grid.ticks, grid.size))
    for slopes, by in ((states, by_member[:, j]), (nominal, by_nominal[:, j])):
        _add(by, slopes, found)
    piece = np.repeat(np.arange(grid.pieces), np.diff(grid.edges))
    found[np.arange(grid.ticks), piece * grid.joints + j] += 1.0
    return found


def _add(by: Matrix, states: Tensor, found: Matrix) -> None:
    """Add the derivatives by the weights, (ticks, weights), of what has derivatives by the states.

    Args:
        by: of every tick but the last, shape (ticks, size).
        states: derivatives of the states, shape (ticks + 1, size, weights).
        found: to which they are added.
    """
    for i in np.flatnonzero(by.any(axis=0)):
        found += by[:, i, None] * states[:-1, i]
