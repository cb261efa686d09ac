"""The answer of a plant that is linear: shifted responses to one step of each effort."""

from dataclasses import dataclass

import numpy as np

from flexslew_control.analysis.lti import Lti
from flexslew_control.controllers.sampled_loop import LinearPlant
from flexslew_control.planners.minimax.response import Grid, Indices, joint_outputs, with_motors
from flexslew_plant.arrays import Matrix, Tensor, Vector
from flexslew_plant.testbeds import Model

_SAME = 1e-9  # relative difference of Jacobians at different states


def is_linear(model: Model) -> bool:
    """Return whether the equations of motion are linear and do not depend on time.

    Their exact Jacobian is then the same at every state; it is compared at some random ones.
    """
    if model.time_varying or model.kernels.extra_positions:
        return False
    rest = np.zeros(2 * model.coordinates)
    effort = np.zeros(model.efforts)
    first = np.hstack(model.jacobian(rest, effort))
    rng = np.random.default_rng(0)
    for _ in range(3):
        x, u = rng.standard_normal(rest.size), rng.standard_normal(effort.size)
        other = np.hstack(model.jacobian(x, u))
        if np.abs(other - first).max() > _SAME * np.abs(first).max():
            return False
    return True


@dataclass(frozen=True)
class LinearPath:
    """A member that is linear; see response.ResponsePath.

    Args:
        grid: the ticks and pieces.
        steps: the channels after a step of each effort at tick 0, at the ticks
            from 0 on, shape (ticks + 1, channels, joints); of a demand without the step itself.
        ends: the state after such a step, shape (ticks + 1, 2 n + s, joints).
        level: what the channels read at rest at the start, shape (channels,).
        away: the rest at the start as a deviation from the goal's, shape (2 n + s,).
        tips: how many tips.
    """

    grid: Grid
    steps: Tensor
    ends: Tensor
    level: Vector
    away: Vector
    tips: int

    def simulate(self, weights: Vector) -> Matrix:
        """Return the channels at every tick but the last, (ticks, channels)."""
        edges, m = self.grid.edges, self.grid.joints
        u = weights.reshape(-1, m)
        found = np.tile(self.level, (self.grid.ticks, 1))
        for begin, step in zip(edges[:-1], np.diff(u, axis=0, prepend=0.0), strict=True):
            found[begin:] += self.steps[: self.grid.ticks - begin] @ step
        found[:, self.tips : self.tips + m] += self.grid.tick_efforts(weights)
        return found

    def rows(self, ticks: Indices, channel: int) -> tuple[Matrix, Vector]:
        """Return the derivatives of a channel at some ticks, (k, weights), and its offsets."""
        at, m = np.asarray(ticks, dtype=int), self.grid.joints
        slopes = _of_pieces(self.steps[:, channel], at, self.grid)
        if self.tips <= channel < self.tips + m:
            piece = np.searchsorted(self.grid.edges, at, side="right") - 1
            slopes[np.arange(at.size), piece * m + channel - self.tips] += 1.0
        return slopes, np.full(at.size, self.level[channel])

    @property
    def end(self) -> tuple[Matrix, Vector]:
        """The deviation from the rest at the goal at the last tick: derivatives and offsets."""
        last = np.array([self.grid.ticks])
        columns = [
            _of_pieces(self.ends[:, row], last, self.grid)[0] for row in range(len(self.away))
        ]
        return np.array(columns), self.away


def _of_pieces(steps: Tensor, ticks: np.ndarray, grid: Grid) -> Matrix:
    """Return what the effort of each piece adds at some ticks, shape (k, weights).

    A piece is a step at its begin and the opposite one at its end.

    Args:
        steps: at the ticks after a step of each effort, shape (ticks + 1, joints).
        ticks: shape (k,).
        grid: the pieces.
    """
    since = ticks[:, None] - np.array(grid.edges)
    found = np.where(since[:, :, None] > 0, steps[np.maximum(since, 0)], 0.0)
    return np.asarray(found[:, :-1] - found[:, 1:]).reshape(ticks.size, -1)


def linear_path(
    model: Model,
    nominal: Model,
    ends: tuple[Vector, Vector],
    gains: Matrix,
    motors: Lti,
    grid: Grid,
) -> LinearPath:
    """Return the answer of a linear member under the feedback about the nominal member's path.

    Args:
        model: model of the member.
        nominal: nominal model; the feedback follows its path under the plan's efforts.
        ends: joint positions at the start and at the goal, shape (joints,) each.
        gains: [Kp Kd], shape (joints, 2 joints).
        motors: motors from commands to efforts, tick by tick.
        grid: the ticks and pieces.
    """
    n, m = model.coordinates, model.joints
    place = model.rest({})
    (f, g), (f0, g0) = (
        with_motors(*LinearPlant(one, place).step(grid.period), motors) for one in (model, nominal)
    )
    size = len(f)
    seen = joint_outputs(n, m, size)
    feedback = g @ gains @ seen
    augmented = np.block([[f - feedback, feedback], [np.zeros((size, size)), f0]])
    states = _after_a_step(augmented, np.vstack((g, g0)), grid.ticks + 1)
    tip = np.zeros((len(model.appendages.names), 2 * size))
    tip[:, m:n] = model.appendages.tip
    command_rows = np.hstack((-gains @ seen, gains @ seen))
    member_rows = np.hstack((seen, np.zeros((2 * m, size))))
    start, goal = ends
    deviation = np.zeros(size)
    deviation[:m] = start - goal
    level = np.concatenate((np.zeros(len(tip) + m), start, np.zeros(m)))
    steps = np.vstack((tip, command_rows, member_rows)) @ states
    return LinearPath(grid, steps, states[:, :size], level, deviation, len(tip))


def _after_a_step(f: Matrix, g: Matrix, count: int) -> Tensor:
    """Return x(0), x(1), ... of x+ = F x + G u from rest under u = 1, (count, states, inputs).

    x(j + k) = F^k x(j) + x(k), so that every round doubles what is known.
    """
    found = np.zeros((count, *g.shape))
    first, power, known = g.copy(), f, 1  # first: x(known)
    while known < count:
        more = min(known, count - known)
        found[known : known + more] = power @ found[:more] + first
        first = power @ first + first
        power, known = power @ power, known + more
    return found
