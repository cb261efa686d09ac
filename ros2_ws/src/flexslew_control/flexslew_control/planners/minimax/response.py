"""How one member answers the efforts of a slew: affine in them, tick by tick as on the bench.

Every member flies the same drive under the joint feedback,
    u_i(k) = w(k) + Kp (r(k) - y_i(k)) + Kd (r'(k) - y_i'(k)),
held over each tick, where w are the efforts of the plan and r the path of the nominal member under
them alone. So the feedback has nothing to do on the nominal member. After the last tick N the
reference is the goal at rest and w is zero: the deviation e from the rest at the goal obeys
    e(k + 1) = (F - G [Kp Kd]) e(k).
Where the motors have a lag or a delay, u is what is commanded, and their states come after those
of the member: s of them in all.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from scipy.linalg import solve_sylvester

from flexslew_control.analysis.lti import Lti
from flexslew_control.linear.zero_order_hold import zero_order_hold
from flexslew_plant.arrays import Matrix, Tensor, Vector
from flexslew_plant.testbeds.linearisation import Linearisation

Indices = Sequence[int] | np.ndarray


class Grid(NamedTuple):
    """The ticks of a slew, cut into pieces of whole ticks over which the efforts are held."""

    edges: tuple[int, ...]  # ticks at which pieces begin, and the end, rising
    joints: int
    period: float  # [s]
    monitored: int  # ticks after the end of the pieces
    rest: int = 0  # ticks after the end of the pieces from which on a residual counts

    @property
    def over(self) -> int:
        """The tick from which on a residual counts."""
        return self.ticks + self.rest

    @property
    def ticks(self) -> int:
        """N, of the slew."""
        return self.edges[-1]

    @property
    def pieces(self) -> int:
        """How many pieces each joint has."""
        return len(self.edges) - 1

    @property
    def size(self) -> int:
        """How many weights: those of the first piece's joints, then the next one's."""
        return self.pieces * self.joints

    def tick_efforts(self, weights: Vector) -> Matrix:
        """Return the efforts of every tick, shape (ticks, joints)."""
        return np.repeat(weights.reshape(self.pieces, self.joints), np.diff(self.edges), axis=0)

    def extend_until(self, ticks: int) -> "Grid":
        """Return the same pieces in a slew of so many ticks, at rest after the pieces."""
        rest = ticks - self.ticks
        return self._replace(rest=rest, monitored=self.monitored - self.rest + rest)


def grid_of(duration: float, pieces: int, joints: int, period: float, monitored: float) -> Grid:
    """Return the ticks of a duration, cut into at most so many pieces of nearly equal length.

    Args:
        duration: of the slew [s].
        pieces: at most; no piece is shorter than a tick.
        joints: how many.
        period: one tick [s].
        monitored: after the end [s].
    """
    ticks = max(int(np.ceil(duration / period - 1e-9)), 1)
    edges = np.unique(np.round(np.linspace(0.0, ticks, min(pieces, ticks) + 1)).astype(int))
    return Grid(tuple(edges.tolist()), joints, period, int(np.ceil(monitored / period)))


class AtRest(NamedTuple):
    """The motion about the rest at the goal, after the last tick.

    The channels are the tips, then of every joint the demand, the position and the rate, then what
    else has limits along the path, see motion.MemberMotion.along.
    """

    # from deviation to the channels some ticks later, (watched + 1, channels, 2 n + s)
    reads: Tensor
    modes: Matrix  # from deviation to eta and eta'/w of every flexible mode, (2 modes, 2 n + s)
    tip_of_modes: Matrix  # |tips| of one unit of every amplitude, (tips, modes)
    rigid: Matrix  # from deviation to position and rate of rigid motions, (2 rigid, 2 n + s)
    # from deviation to the one that goes on alike without the motors' states, (2 n, 2 n + s)
    settled: Matrix
    bound: bool  # whether a spring holds a joint
    along: Vector  # what the last channels read at the goal


class RestMotion(NamedTuple):
    """The small motions about the rest at the goal: of k coordinates and their rates."""

    linear: Linearisation
    seen: Matrix  # positions and rates of the joints, (2 joints, 2 k)
    tip: Matrix  # (tips, 2 k)
    free: int  # coordinates that no spring holds, unless one holds a joint
    along: Matrix  # what else has limits, by coordinates and rates, (readings, 2 k)
    level: Vector  # what it reads at the goal, (readings,)


def at_rest(motion: RestMotion, gains: Matrix, motors: Lti, monitored: int) -> AtRest:
    """Return the motion after the last tick.

    With K phi = w^2 M phi, phi^T M phi = 1 the amplitude of a free mode is |(eta, eta'/w)|,
    eta = phi^T M e; what moves without being bent has w = 0.

    Args:
        motion: about the goal.
        gains: [Kp Kd] on positions and rates of the joints, shape (joints, 2 joints).
        motors: from commands to efforts, tick by tick.
        monitored: ticks after the last one.
    """
    linear = motion.linear
    f, g = zero_order_hold(linear.state_matrix, linear.state_input_matrix, motors.period)
    reduction = _motor_reduction(f, g, motors)
    f, g = with_motors(f, g, motors)
    parts = (motion.tip, motion.seen, motion.along)
    tip, seen, along = (np.pad(part, ((0, 0), (0, len(motors.a)))) for part in parts)
    factor = np.linalg.cholesky(linear.mass)
    inner = np.linalg.solve(factor, linear.stiffness)
    square, vectors = np.linalg.eigh(np.linalg.solve(factor, inner.T))
    shapes = np.linalg.solve(factor.T, vectors)
    rest = square <= 1e-9 * max(float(square[-1]), 1e-300)
    left = shapes.T @ linear.mass
    zeros = np.zeros_like(left)
    position, rate = np.hstack((left, zeros)), np.hstack((zeros, left))
    w = np.sqrt(square[~rest])
    return AtRest(
        _reads(np.vstack((tip, -gains @ seen, seen, along)), f - g @ gains @ seen, monitored + 1),
        np.vstack((position[~rest], rate[~rest] / w[:, None])) @ reduction,
        np.abs(tip[:, : len(shapes)] @ shapes[:, ~rest]),
        np.vstack((position[rest], rate[rest])) @ reduction,
        reduction,
        int(rest.sum()) < motion.free,
        motion.level,
    )


def with_motors(f: Matrix, g: Matrix, motors: Lti) -> tuple[Matrix, Matrix]:
    """Return F and G of x+ = F x + G u with the motors' states z after those of x.

    x+ = F x + G (C z + D u),  z+ = A z + B u.
    """
    below = np.hstack((np.zeros((len(motors.a), len(f))), motors.a))
    return (
        np.vstack((np.hstack((f, g @ motors.c)), below)),
        np.vstack((g @ motors.d, motors.b)),
    )


def _motor_reduction(f: Matrix, g: Matrix, motors: Lti) -> Matrix:
    """Return [1 S] so that y = x + S z obeys y+ = F y when nothing more is commanded.

    F S - S A = G C; as z vanishes, y becomes x.
    """
    if not len(motors.a):
        return np.eye(len(f))
    return np.hstack((np.eye(len(f)), solve_sylvester(f, -motors.a, g @ motors.c)))


def _reads(read: Matrix, closed: Matrix, count: int) -> Tensor:
    """Return read closed^k for k = 0, 1, ..., shape (count, channels, 2 n)."""
    found = np.empty((count, *read.shape))
    found[0], power, known = read, closed, 1
    while known < count:
        more = min(known, count - known)
        found[known : known + more] = found[:more] @ power
        power, known = power @ power, known + more
    return found


def joint_outputs(n: int, m: int, states: int) -> Matrix:
    """Return what reads positions and rates of the joints off all states, (2 m, states)."""
    seen = np.zeros((2 * m, states))
    seen[:m, :m] = seen[m:, n : n + m] = np.eye(m)
    return seen


class ResponsePath(Protocol):
    """The answer of one member up to the last tick, affine in the weights."""

    def simulate(self, weights: Vector) -> Matrix:
        """Return the channels at every tick but the last, (ticks, channels)."""

    def rows(self, ticks: Indices, channel: int) -> tuple[Matrix, Vector]:
        """Return the derivatives of a channel at some ticks, (k, weights), and its offsets."""

    @property
    def end(self) -> tuple[Matrix, Vector]:
        """The deviation from the rest at the goal at the last tick: derivatives and offsets."""


@dataclass(frozen=True)
class Response:
    """The answer of one member: up to the last tick, and about the rest at the goal after it.

    Args:
        path: up to the last tick.
        rest: after it.
        grid: the ticks.
        goal: joint positions, shape (joints,).
    """

    path: ResponsePath
    rest: AtRest
    grid: Grid
    goal: Vector

    @property
    def tips(self) -> int:
        """How many tips are read: the first channels; demands and joints follow."""
        return len(self.rest.tip_of_modes)

    @cached_property
    def level(self) -> Vector:
        """What the channels read at rest at the goal, shape (channels,)."""
        m = self.goal.size
        zeros = np.zeros(self.tips + m)
        return np.concatenate((zeros, self.goal, np.zeros(m), self.rest.along))

    def simulate(self, weights: Vector) -> Matrix:
        """Return the channels at all ticks, shape (ticks + watched + 1, channels)."""
        slope, offset = self.path.end
        return np.vstack((self.path.simulate(weights), self.later(slope @ weights + offset)))

    def later(self, end: Vector) -> Matrix:
        """Return the channels from the last tick on, shape (watched + 1, channels).

        Args:
            end: deviation from the rest at the goal at the last tick, shape (2 n + s,).
        """
        return np.asarray(self.rest.reads @ end + self.level)

    def rows(self, ticks: Indices, channel: int) -> tuple[Matrix, Vector]:
        """Return the derivatives of a channel at some ticks, (k, weights), and its offsets."""
        ticks = np.asarray(ticks, dtype=int)
        over = ticks >= self.grid.ticks
        slopes, offsets = np.empty((ticks.size, self.grid.size)), np.empty(ticks.size)
        if not over.all():
            slopes[~over], offsets[~over] = self.path.rows(ticks[~over], channel)
        if over.any():
            reads = self.rest.reads[ticks[over] - self.grid.ticks, channel]
            slope, offset = self.path.end
            slopes[over] = reads @ slope
            offsets[over] = reads @ offset + self.level[channel]
        return slopes, offsets
