"""What is sought: one slew for an ensemble, in a given time, and its programs."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flexslew_control.planners.minimax.joint_motion import JointMotion
from flexslew_control.planners.minimax.linear_path import is_linear, linear_path
from flexslew_control.planners.minimax.members import Ensemble, Member
from flexslew_control.planners.minimax.motion import MemberMotion
from flexslew_control.planners.minimax.program import ConeProgram, Limits
from flexslew_control.planners.minimax.response import AtRest, Grid, Response, at_rest, grid_of
from flexslew_control.planners.minimax.turn import AllDrivesTurn
from flexslew_control.planners.residual.prediction import monitor_time
from flexslew_control.planners.slew import Slew
from flexslew_control.planners.trajectories import rigid_duration
from flexslew_plant.arrays import Matrix
from flexslew_plant.testbeds import Model

_PIECES, _NONLINEAR_PIECES = 60, 40  # of a linear plant, of another one
_PIECE = 0.75  # of the period of the fastest mode, longest of a plant that is not linear [-]
_FINE = 0.125  # of that period, at which shorter pieces gain nothing [-]
_BOUND_FRACTION = 0.95  # of the fastest turn that was found of a rigid craft, that none takes [-]
_RIGID = 2.0  # times that a rigid body needs, for which efforts are applied at least


@dataclass(frozen=True)
class Question:
    """The problem of the planner.

    Args:
        slew: the requested slew.
        ensemble: the `ensemble` section.
        duration: duration of the slew [s].
        pieces: most pieces of each effort; None: as many as suit the plant.
        limits: limits of every member.
        exact: whether the nominal member ends at rest, modes included.
        rho: price of effort [m/N^2 or m/(N m)^2].
        steps: most steps on a plant that is not linear.
        feasible: whether any efforts do that keep to the limits.
        turn: the turn in three axes; None: joints move one by one.
    """

    slew: Slew
    ensemble: Ensemble
    duration: float
    pieces: int | None
    limits: Limits
    exact: bool
    rho: float
    steps: int
    feasible: bool = False
    turn: AllDrivesTurn | None = None

    @property
    def gains(self) -> Matrix:
        """[Kp Kd], shape (joints, 2 joints)."""
        return np.hstack((np.diag(self.slew.kp), np.diag(self.slew.kd)))

    @cached_property
    def motion(self) -> MemberMotion:
        """How the members move."""
        if self.turn is not None:
            return self.turn.motion
        return JointMotion(self.slew.start, self.slew.goal)

    @property
    def span(self) -> float:
        """Farthest way of a joint, or the angle of a turn in three axes [rad or m]."""
        if self.turn is not None:
            return self.turn.angle
        return float(np.abs(self.slew.goal - self.slew.start).max()) or 1.0

    @property
    def ticks(self) -> int:
        """Of the duration."""
        return max(int(np.ceil(self.duration / self.slew.period - 1e-9)), 1)

    @cached_property
    def linear(self) -> bool:
        """Whether the model believed in is linear."""
        return is_linear(self.slew.model)

    @cached_property
    def count(self) -> int:
        """How many pieces, at most."""
        return self.pieces or (_PIECES if self.linear else _NONLINEAR_PIECES)

    @cached_property
    def fastest(self) -> float:
        """The period of the fastest mode about the goal [s]; infinite: there is none."""
        model = self.slew.model
        if not model.modes:
            return np.inf
        linear = model.linearise(model.rest(self.slew.named(self.slew.goal)))
        return 2.0 * np.pi / float(linear.frequencies[-1])

    @cached_property
    def rigid(self) -> float:
        """The least duration of a rigid body within the limits [s]."""
        slew = self.slew
        if self.turn is not None:
            return self.turn.rigid
        return rigid_duration(slew.model, slew.start, slew.goal, self.limits.demand)

    @property
    def too_short(self) -> float:
        """A duration in which no slew is [s]."""
        return self.rigid * (1.0 if self.turn is None else _BOUND_FRACTION)

    @cached_property
    def actuation(self) -> float:
        """How long efforts are applied; after it a plant that is not linear only settles [s].

        Pieces that are long compared with the period of a mode cannot hold it still.
        """
        if self.linear or not self.slew.model.modes:
            return self.duration
        return min(self.duration, max(self.count * _PIECE * self.fastest, _RIGID * self.rigid))

    @property
    def fine(self) -> bool:
        """Whether the pieces are so short that shorter ones gain nothing."""
        return self.duration <= self.count * _FINE * self.fastest

    @cached_property
    def monitored(self) -> float:
        """How long after the end a residual is looked for [s]."""
        rest = self.motion.at_rest(self.slew.model)
        a = rest.linear.state_matrix - rest.linear.state_input_matrix @ self.gains @ rest.seen
        return monitor_time(np.linalg.eigvals(a).astype(np.complex128), self.slew.period)

    def grid(self, stride: int = 1) -> Grid:
        """Return pieces of all ticks, or of coarse ticks, so many ticks each, as far as they go."""
        period = stride * self.slew.period
        ticks = max(self.ticks // stride, 1)
        return grid_of(ticks * period, self.count, self.slew.goal.size, period, self.monitored)


def convex_program(question: Question, members: Sequence[Member]) -> ConeProgram:
    """Return the program of an ensemble with linear members only."""
    slew, grid = question.slew, question.grid()
    gains, ends = question.gains, (slew.start, slew.goal)
    rest_models = rest_models_of(question, members, grid)
    motors = slew.motors(grid.period)
    paths = (linear_path(m.model, slew.model, ends, gains, motors, grid) for m in members)
    responses = [Response(p, r, grid, slew.goal) for p, r in zip(paths, rest_models, strict=True)]
    return program_of(question, members, grid, responses)


def rest_models_of(question: Question, members: Sequence[Member], grid: Grid) -> list[AtRest]:
    """Return the motion of every member about its rest at the goal."""
    motors = question.slew.motors(grid.period)
    linearized = (question.motion.at_rest(member.model) for member in members)
    return [at_rest(motion, question.gains, motors, grid.monitored) for motion in linearized]


def program_of(
    question: Question, members: Sequence[Member], grid: Grid, responses: Sequence[Response]
) -> ConeProgram:
    """Return the program of the responses of an ensemble."""
    slew = question.slew
    no_damping = not question.gains.any() and not any(_has_damping(m.model, slew) for m in members)
    limits, exact = question.limits, question.exact
    return ConeProgram(responses, grid, limits, exact, no_damping, question.span, question.rho)


def _has_damping(model: Model, slew: Slew) -> bool:
    return bool(model.linearise(model.rest(slew.named(slew.goal))).damping.any())
