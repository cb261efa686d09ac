"""The convex program of an ensemble: the responses of the members, the limits, the end."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flexslew_control.planners.minimax.response import Grid, Response
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import PlanFailed


class Infeasible(PlanFailed):
    """No efforts within the limits lead to the goal in this time."""


@dataclass(frozen=True)
class Limits:
    """The limits of every member at every tick; infinite where there is no limit.

    Args:
        demand: largest efforts of the drives, shape (joints,) [N m or N].
        joint: lowest and highest positions, shape (2, joints) [rad or m].
        rate: largest rates of the joints, shape (joints,) [rad/s or m/s].
        tip: largest |tip| of the whole flight [m].
        along: lowest and highest other readings of the motion, shape (2, readings).
        margin: share of rates and of `along` that is kept free, for the motion between the ticks
            and for the tolerance of a search [-].
    """

    demand: Vector
    joint: Matrix
    rate: Vector
    tip: float
    along: Matrix = field(default_factory=lambda: np.zeros((2, 0)))
    margin: float = 0.0

    @property
    def of_path(self) -> bool:
        """Whether there are limits to spare."""
        return bool(np.isfinite(self.rate).any()) or self.along.size > 0

    def of(self, tips: int) -> tuple[Vector, Vector, Vector]:
        """Return the lowest and highest values of each channel, and their size, (channels,) each.

        Args:
            tips: how many tips are read.
        """
        tip = np.full(tips, self.tip)
        less, more = 1.0 - self.margin, 1.0 + self.margin
        rate = less * self.rate
        high = np.concatenate((tip, self.demand, self.joint[1], rate, less * self.along[1]))
        low = np.concatenate((-tip, -self.demand, self.joint[0], -rate, more * self.along[0]))
        size = np.max(np.abs(np.where(np.isfinite((low, high)), (low, high), 0.0)), axis=0)
        return low, high, np.where(size > 0.0, size, 1.0)


class TrustRegion(NamedTuple):
    """Where the responses of a plant that is not linear are good enough.

    The end and all limits may be missed inside it, by a share that is priced.
    """

    about: Vector  # weights [N m or N]
    radius: float  # of the limit of each drive [-]
    price: float  # of missing [m]


@dataclass(frozen=True)
class ConeProgram:
    """The data of the program.

    Args:
        responses: responses of the members, the nominal one first.
        grid: the pieces of constant effort.
        limits: limits of every member.
        exact: whether the nominal member ends at rest, modes included; one with springs at its
            joints always does.
        no_damping: whether nothing damps the members, so that amplitudes count.
        span: farthest way of a joint [rad or m].
        rho: price of effort [m/N^2 or m/(N m)^2].
        trust: where the responses are good enough; None: everywhere.
    """

    responses: Sequence[Response]
    grid: Grid
    limits: Limits
    exact: bool
    no_damping: bool
    span: float
    rho: float = 0.0
    trust: TrustRegion | None = None

    @property
    def end_rows(self) -> Matrix:
        """What of the nominal member's deviation from the rest at the goal is zero at the end."""
        rest = self.responses[0].rest
        return rest.settled if self.exact or rest.bound else rest.rigid  # what is bound is led

    def end_error(self, end: Vector) -> Vector:
        """Return what is not zero of a deviation at the end, as shares of the whole way.

        Args:
            end: of the nominal member, shape (2 n + s,) or (2 n + s, k).
        """
        rows, n = self.end_rows, len(self.responses[0].rest.settled) // 2
        duration = self.grid.ticks * self.grid.period
        position, rate = (
            np.linalg.norm(part, axis=1) for part in (rows[:, :n], rows[:, n : 2 * n])
        )
        error: Vector = ((rows @ end).T / (self.span * (position + rate / duration))).T
        return error


class ProgramKey(NamedTuple):
    """Which row of the whole program a row is."""

    member: int
    channel: int
    tick: int
    side: float  # 1 below the highest value, -1 above the lowest; 0 within the residual


class Optimum(NamedTuple):
    """The efforts of a program."""

    weights: Vector  # of the pieces, see Grid [N m or N]
    residuals: Vector  # of the members, (members,) [m]
    bound: float  # that no efforts of these pieces pass below, of g + rho |p|^2 [m]
    missed: float  # share of the end and the limits that is missed inside a Trust [-]
    rows: tuple[ProgramKey, ...] = ()  # that held it up

    @property
    def worst(self) -> float:
        """The largest residual of a member [m]."""
        return float(self.residuals.max())


def residual(response: Response, end: Vector, no_damping: bool, signals: Matrix) -> float:
    """Return the largest |tip| of a member after the end [m].

    Args:
        response: of the member.
        end: its deviation from the rest at the goal at the last tick, shape (2 n + s,).
        no_damping: whether nothing damps it, so that the sum of the amplitudes counts.
        signals: its channels at all ticks.
    """
    if no_damping:
        amplitude = np.hypot(*(response.rest.modes @ end).reshape(2, -1))
        return float((response.rest.tip_of_modes @ amplitude).max(initial=0.0))
    return float(np.abs(signals[response.grid.over :, : response.tips]).max(initial=0.0))
