"""The data of model predictive control at a tick of the horizon, about a rest or about the plan."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from flexslew_control.controllers.model_predictive.prediction import Costs, Program, horizon
from flexslew_control.law import Estimate, Reference
from flexslew_control.linear.design_checks import LinearDesignModel
from flexslew_control.linear.free_platform import nominal_states
from flexslew_plant.arrays import Matrix, Vector


class HorizonLimits(NamedTuple):
    """What a law keeps to, as rows of the prediction."""

    effort: Vector  # (m,)
    rate: float | None  # [N m/s or N/s]
    rows: Matrix  # of one state, (s, k): those that are soft
    lower: Vector  # (s,)
    upper: Vector  # (s,)
    names: tuple[str, ...]  # of the rows, for the log


@dataclass(frozen=True)
class Steps:
    """A horizon of N steps."""

    count: int  # N
    ticks: int  # in a step
    period: float  # one tick [s]
    on_the_way: float  # share of the weights while the reference moves [-]
    iterations: int  # of the solver in a tick, at most

    @property
    def length(self) -> float:
        """Of a step [s]."""
        return self.ticks * self.period

    def shares(self, steps_left: int) -> Vector:
        """Return the factor of the weights of each step's state, of which some move, (N,)."""
        return np.where(np.arange(self.count) < steps_left, self.on_the_way, 1.0)


class HorizonQuestion(NamedTuple):
    """The input of a horizon's prediction."""

    tick: int
    time: float  # [s]
    estimate: Estimate
    references: list[Reference]  # now, and at the end of each step, N + 1
    moving: int  # steps until the reference has come to its end
    last: Matrix  # V, about which a non-linear prediction is linear, (N, m)


class HorizonProblem(NamedTuple):
    """The program of a tick, and what it starts from."""

    program: Program
    off: Matrix  # x(1 ... N) - x* with V = 0, (N, k)
    outputs: Matrix  # of the soft rows with V = 0, (N, s)


class HorizonPrediction(Protocol):
    """Predicts the effect of efforts over the horizon."""

    @property
    def limits(self) -> HorizonLimits:
        """The limits at the end of each step."""

    @property
    def steps(self) -> Steps:
        """The horizon."""

    def restart(self) -> None:
        """Forget what was prepared for the steps that came next."""

    def predict(self, question: HorizonQuestion) -> HorizonProblem:
        """Return the effect of efforts from this tick on."""


def program(
    forced: Matrix,
    costs: Costs,
    weight_factors: Vector,
    steps: Steps,
    limits: HorizonLimits,
    soft: Matrix,
) -> Program:
    """Return the program of a horizon, with the differences of efforts as its hard rows.

    Args:
        forced: of the horizon, shape (N k, N m).
        costs: of a step.
        weight_factors: factor of the weights of each step's state, shape (N,).
        steps: the horizon.
        limits: of the efforts and of their rate.
        soft: rows C of C X, shape (N s, N k).
    """
    n, m = steps.count, limits.effort.size
    hard = np.zeros((0, n * m))
    if limits.rate is not None:
        hard = np.eye((n - 1) * m, n * m, m) - np.eye((n - 1) * m, n * m)
    return Program(forced, costs, weight_factors, limits.effort, hard, soft, steps.iterations)


@dataclass
class RestPrediction:
    """The prediction by the small motions about an operating point.

    Args:
        model: for the nominal state.
        rest: x about which it is linear, shape (k,).
        step: F and G of x+ = F x + G v over a step.
        costs: of a step.
        limits: that hold at its end.
        steps: the horizon.
        substeps: of the integration of a step.
    """

    model: LinearDesignModel
    rest: Vector
    step: tuple[Matrix, Matrix]
    costs: Costs
    limits: HorizonLimits
    steps: Steps
    substeps: int

    def __post_init__(self) -> None:
        """Prepare the programs of all shares."""
        s = self.steps
        self._forced = horizon(*self.step, s.count)
        soft = np.asarray(np.kron(np.eye(s.count), self.limits.rows), dtype=np.float64)
        self._programs = [
            program(self._forced, self.costs, s.shares(steps_left), s, self.limits, soft)
            for steps_left in (range(s.count + 1) if s.on_the_way != 1.0 else (0,))
        ]
        for one in self._programs:
            one.prepare()

    def restart(self) -> None:
        """Nothing to forget."""

    def predict(self, question: HorizonQuestion) -> HorizonProblem:
        """Return what efforts do from this tick on.

        The model itself is followed under the last answer's efforts; so what is predicted of the
        answer is right to the first order about it, and exact where the answers settle.
        """
        s, q = self.steps, question
        x = np.concatenate((q.estimate.position, q.estimate.velocity))
        free = self.model.path(x, q.last, s.length, self.substeps, q.time) - self.rest
        free = free - (self._forced @ q.last.ravel()).reshape(free.shape)
        target = nominal_states(self.model, q.references[1:]) - self.rest
        selected = self._programs[min(q.moving, len(self._programs) - 1)]
        return HorizonProblem(selected, free - target, free @ self.limits.rows.T)
