"""How model predictive control foresees a craft that turns: by its deviation from the plan."""

from dataclasses import dataclass, field

import numpy as np

from flexslew_control.controllers.model_predictive.ahead import (
    HorizonLimits,
    HorizonProblem,
    HorizonQuestion,
    Steps,
    program,
)
from flexslew_control.controllers.model_predictive.prediction import (
    Costs,
    Program,
    varying_horizon,
)
from flexslew_control.law import Reference
from flexslew_control.linear.free_platform import nominal
from flexslew_control.linear.rate_dependent_platform import RateDependentPlatform
from flexslew_control.linear.zero_order_hold import zero_order_hold
from flexslew_plant.arrays import Matrix, Tensor, Vector
from flexslew_plant.testbeds.orientation.attitude import AttitudeJoints

_ROTATION_STEP = 1e-4  # of the differences of what joints read [rad]


@dataclass
class PlanPrediction:
    """(e, e')(k + 1) = F(w) (e, e')(k) + G(w) (v - u_d)(k), w the mean rates of the plan in a step.

    e of the attitude is a rotation in body axes, see rate_dependent_platform, so nothing here
    depends on
    the inertial frame but the limits of what joints read. A plan that the craft can fly within the
    limits is left alone: all e are zero under its own efforts.

    The program is built again once a step, as F and G change along the plan. What the last answer
    leads to is followed at every tick with F, G and readings as they then are, so what is predicted
    of an answer is exact where the answers settle.

    Args:
        craft: A(w) and B.
        attitude: what its joints read of a turn.
        costs: costs of a step.
        limits: limits at the end of a step; their rows are joints'.
        steps: the horizon.
    """

    craft: RateDependentPlatform
    attitude: AttitudeJoints
    costs: Costs
    limits: HorizonLimits
    steps: Steps
    _step_cache: dict[bytes, tuple[Matrix, Matrix]] = field(init=False, default_factory=dict)
    _made: tuple[int, int] | None = field(init=False, default=None)  # which step, how many move
    _forced: Matrix = field(init=False)
    _program: Program = field(init=False)

    def restart(self) -> None:
        """Forget the program."""
        self._made = None

    def predict(self, question: HorizonQuestion) -> HorizonProblem:
        """Return what efforts do from this tick on."""
        q, n, m = question, self.steps.count, self.limits.effort.size
        at = np.array([one.velocity for one in q.references])
        steps = [self._step(w) for w in 0.5 * (at[:-1] + at[1:])]
        excess = q.last - np.array([one.effort for one in q.references[:-1]])
        x = np.concatenate((q.estimate.position, q.estimate.velocity))
        x, path = x - nominal(self.craft.small, q.references[0]), []
        for (f, g), effort in zip(steps, excess, strict=True):
            x = f @ x + g @ effort
            path.append(x)
        off = np.array(path)
        read = np.zeros((n, 0))
        rows = np.zeros((n, 0, m))
        if self.limits.names:
            read, rows = self._read(q.references[1:], off[:, :m])
        shared = self.steps.on_the_way != 1.0
        which = q.tick // self.steps.ticks, q.moving if shared else 0
        if self._made != which:
            self._forced = varying_horizon(steps)
            self._program = program(
                self._forced, self.costs, self.steps.shares(which[1]), self.steps, self.limits,
                _along(rows, off.shape[1]),
            )  # fmt: skip
            self._made = which
        outputs = read - (self._program.soft @ q.last.ravel()).reshape(read.shape)
        off = off - (self._forced @ q.last.ravel()).reshape(off.shape)
        return HorizonProblem(self._program, off, outputs)

    def _step(self, rates: Vector) -> tuple[Matrix, Matrix]:
        """Return F and G of a step about these rates."""
        key = rates.tobytes()
        if key not in self._step_cache:
            if len(self._step_cache) > 2 * self.steps.count * self.steps.ticks:
                self._step_cache = {}
            a, b = self.craft.state_matrix(rates), self.craft.input_matrix
            self._step_cache[key] = zero_order_hold(a, b, self.steps.length)
        return self._step_cache[key]

    def _read(self, references: list[Reference], e: Matrix) -> tuple[Matrix, Tensor]:
        """Return what the limited joints read, and how it changes with e.

        Args:
            references: of N.
            e: turns and moves from there, shape (N, joints).

        Returns:
            shapes (N, s) and (N, s, joints).
        """
        limited = self.limits.rows.argmax(axis=1)
        desired = np.array([one.position for one in references])
        slopes = np.empty((len(e), len(limited), e.shape[1]))
        for k, one in enumerate(_ROTATION_STEP * np.eye(e.shape[1])):
            forward, backward = (self.attitude.add_error(desired, e + s * one) for s in (1.0, -1.0))
            slopes[:, :, k] = (forward - backward)[:, limited] / (2.0 * _ROTATION_STEP)
        return self.attitude.add_error(desired, e)[:, limited], slopes


def _along(rows: Tensor, states: int) -> Matrix:
    """Return rows on the joints of each step as rows of all states, shape (N s, N k)."""
    n, s, m = rows.shape
    out = np.zeros((n, s, n, states))
    out[np.arange(n), :, np.arange(n), :m] = rows
    return out.reshape(n * s, n * states)
