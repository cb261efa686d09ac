"""A bang-bang slew of one joint and its end conditions (Liu and Singh 1997, sections 2 and 3).

The unknowns are the durations d of the arcs between the switches. The end conditions are rest at
the goal and, for a robust slew, no sensitivity to the stiffness k:
    r(d) = x(t_f) - x_goal = 0,    dx/dk(t_f) = 0    (5), (13), (30),
where x are the modes or the whole state. The sensitivity is that of a bench which follows the
slew under its feedback; without gains, of the open loop, as in the paper.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np
from scipy.linalg import block_diag

from flexslew_control.planners.time_optimal.arcs import (
    ModelEnsemble,
    final_sensitivity,
    final_states,
)
from flexslew_control.planners.time_optimal.reachable import reachable_combinations
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.linearisation import Linearisation
from flexslew_plant.testbeds.model import Model

Insensitive: TypeAlias = Literal["modes", "state"]

# fourth-order difference by the stiffness factor: exact to about 1e-11 of the derivative
_CHANGE = 1e-3
STENCIL = tuple(
    (1.0 + j * _CHANGE, w / (12.0 * _CHANGE))
    for j, w in ((1, 8.0), (-1, -8.0), (2, -1.0), (-2, 1.0))
)
_STEP = 0.25  # longest integration step, as an angle of the fastest mode [rad]
_RIGID_STEP = 0.05  # longest one of a rigid body, of its slew [-]
# a rough slew, to find the arcs that an exact one settles
_COARSE_STENCIL = ((1.0 + _CHANGE, 0.5 / _CHANGE), (1.0 - _CHANGE, -0.5 / _CHANGE))
_COARSE_STEP = 1.2  # as _STEP


@dataclass(frozen=True)
class BangBang:
    """A slew of one joint with its effort at +- amplitude.

    Args:
        model: what is turned.
        joint: which joint.
        start: state at rest, shape (2 n,).
        distance: how far the joint goes [rad or m].
        amplitude: of the effort [N m or N].
        robust: whether the end must not be sensitive to the stiffness.
        kp, kd: gains of the joint's feedback that flies the slew; none: open loop.
        insensitive: what must not be: the modes (5 switches for one) or the whole state.
        coarse: whether longer steps and a coarser difference by the stiffness do, for a search.
    """

    model: Model
    joint: int
    start: Vector
    distance: float
    amplitude: float
    robust: bool
    kp: float = 0.0
    kd: float = 0.0
    insensitive: Insensitive = "modes"
    coarse: bool = False

    @cached_property
    def mode(self) -> tuple[float, float]:
        """Frequency [rad/s] and damping ratio [-] of the first combination, the joints free."""
        m = self.model.joints
        linear = self.model.linearise(self.start[: self.model.coordinates])
        along = block_diag(np.eye(m), np.linalg.pinv(self.combinations))
        mass, damping, stiffness = (
            along.T @ matrix @ along for matrix in (linear.mass, linear.damping, linear.stiffness)
        )
        inputs = along.T @ linear.input_matrix
        frequency = float(Linearisation(mass, damping, stiffness, inputs).frequencies[0])
        coupling = mass[:m, m]
        modal = mass[m, m] - coupling @ np.linalg.solve(mass[:m, :m], coupling)
        return frequency, float(damping[m, m] / (2.0 * modal * frequency))

    @property
    def stencil(self) -> tuple[tuple[float, float], ...]:
        """Factors of the stiffness and weights of their states in the derivative by it."""
        return _COARSE_STENCIL if self.coarse else STENCIL

    @property
    def open_loop(self) -> bool:
        """Whether nothing feeds back."""
        return self.kp == 0.0 and self.kd == 0.0

    @cached_property
    def step(self) -> float:
        """Longest integration step [s]."""
        if not self.model.modes:
            return _RIGID_STEP * self.rigid_duration
        linear = self.model.linearise(self.start[: self.model.coordinates])
        return float((_COARSE_STEP if self.coarse else _STEP) / linear.frequencies[-1])

    @cached_property
    def inertia(self) -> float:
        """Of the whole, appendages straight [kg m^2 or kg]."""
        q = self.start[: self.model.coordinates]
        return float(self.model.mass_matrix(q)[self.joint, self.joint])

    @property
    def rigid_duration(self) -> float:
        """Duration of the rigid body's time-optimal slew [s]."""
        return float(2.0 * np.sqrt(abs(self.distance) * self.inertia / self.amplitude))

    @cached_property
    def combinations(self) -> Matrix:
        """Which combinations of the modes the effort can swing, shape (k, modes)."""
        if not self.model.modes:
            return np.zeros((0, 0))
        q = self.start[: self.model.coordinates]
        period = 2.0 * np.pi / float(self.model.linearise(q).frequencies[0])
        horizon = self.rigid_duration + period
        return reachable_combinations(self.model, q, self.joint, self.amplitude, horizon)

    @cached_property
    def modal_rows(self) -> Matrix:
        """The combinations and their rates as rows of a state, shape (2 k, 2 n)."""
        n, m, k = self.model.coordinates, self.model.joints, len(self.combinations)
        rows = np.zeros((2 * k, 2 * n))
        rows[:k, m:n] = rows[k:, n + m :] = self.combinations
        return rows

    @cached_property
    def rest_rows(self) -> Matrix:
        """What of a state the end conditions hold: joint, combinations, rates, (rows, 2 n)."""
        half, n = len(self.combinations), self.model.coordinates
        joint = np.eye(2 * n)[[self.joint, n + self.joint]]
        modal_rows = self.modal_rows
        return np.vstack((joint[:1], modal_rows[:half], joint[1:], modal_rows[half:]))

    @property
    def sensitivity_rows(self) -> Matrix:
        """What of a state may not be sensitive to the stiffness, shape (rows, 2 n)."""
        return self.modal_rows if self.insensitive == "modes" else self.rest_rows

    @cached_property
    def conditions(self) -> Matrix:
        """C of the end conditions r = C z - goal, z the final states of all copies."""
        size = self.start.size
        nominal = self.rest_rows
        if not self.robust:
            return nominal
        derivative = self.sensitivity_rows
        whole = np.zeros((len(nominal) + len(derivative), size * (1 + len(self.stencil))))
        whole[: len(nominal), :size] = nominal
        for k, (_, weight) in enumerate(self.stencil, start=1):
            whole[len(nominal) :, k * size : (k + 1) * size] = weight * derivative
        return whole

    @cached_property
    def ensemble(self) -> ModelEnsemble:
        """What `arcs` simulates."""
        return self.model_ensemble(
            (1.0, *(factor for factor, _ in self.stencil)) if self.robust else (1.0,)
        )

    def model_ensemble(self, factors: tuple[float, ...]) -> ModelEnsemble:
        """Return an ensemble with the stiffness times these factors, the nominal one first."""
        packed = np.array([self.model.with_stiffness(factor).packed for factor in factors])
        kp, kd = np.zeros(self.model.joints), np.zeros(self.model.joints)
        kp[self.joint], kd[self.joint] = self.kp, self.kd
        return ModelEnsemble(self.model.rates, packed, kp, kd)

    def efforts(self, arcs: int) -> Matrix:
        """Return the effort of each arc, shape (arcs, joints)."""
        out = np.zeros((arcs, self.model.joints))
        signs = np.where(np.arange(arcs) % 2 == 0, 1.0, -1.0)
        out[:, self.joint] = self.amplitude * np.sign(self.distance) * signs
        return out

    def final(self, durations: Vector, factor: float = 1.0, feedback: bool = False) -> Vector:
        """Return the state at the end with the stiffness times factor, shape (2 n,).

        Args:
            durations: of the arcs [s].
            factor: of the stiffness [-].
            feedback: whether the gains hold it to the nominal slew.
        """
        factors = (1.0, factor) if feedback else (factor,)
        efforts = self.efforts(durations.size)
        return np.asarray(
            final_states(self.model_ensemble(factors), self.start, efforts, durations, self.step)[
                -1
            ]
        )

    def residual(self, durations: Vector) -> Vector:
        """Return what misses the end conditions, shape (rows,)."""
        efforts = self.efforts(durations.size)
        z = final_states(self.ensemble, self.start, efforts, durations, self.step)
        return self._end_error(z.ravel())

    def residual_jacobian(self, durations: Vector) -> tuple[Vector, Matrix]:
        """Return the residual (rows,) and its derivatives by the durations (rows, arcs)."""
        efforts = self.efforts(durations.size)
        z, slopes = final_sensitivity(self.ensemble, self.start, efforts, durations, self.step)
        return self._end_error(z), np.asarray(self.conditions @ slopes)

    def _end_error(self, z: Vector) -> Vector:
        goal = self.start.copy()
        goal[self.joint] += self.distance
        r = self.conditions @ z
        r[: len(self.rest_rows)] -= self.rest_rows @ goal
        return np.asarray(r)
