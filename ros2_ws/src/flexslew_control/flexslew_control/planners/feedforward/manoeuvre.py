"""A slew of the closed loop as a map from feedforward weights to the terminal error (18)-(21)."""

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from flexslew_control.planners.feedforward.basis import Basis
from flexslew_control.planners.feedforward.shooting import (
    JointLoop,
    StageRecord,
    final_sensitivity,
    joint_loop,
    roll_out,
    stage_record,
)
from flexslew_control.planners.slew import Slew
from flexslew_control.planners.trajectories import Profile, rest_to_rest
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.compiled.dynamics import STAGE_TIMES, STAGES
from flexslew_plant.testbeds.model import Model

_STEP_ANGLE = 0.95  # largest step times fastest closed-loop rate [-]: error in Y below 1e-8
_STEPS_A_SLEW = 25  # at least, for the motion itself


@dataclass(frozen=True)
class Manoeuvre:
    """A rest-to-rest slew under the feedback (12), (13).

    Args:
        model: the equations of motion.
        kp, kd: joint gains, shape (joints,) [N m/rad, N m s/rad].
        start, goal: joint positions, shape (joints,) [rad].
        duration: T_c [s].
        reference: the profile of the reference.
    """

    model: Model
    kp: Vector
    kd: Vector
    start: Vector
    goal: Vector
    duration: float
    reference: Profile

    @property
    def loop(self) -> JointLoop:
        """The model in the loop that its feedback closes."""
        return joint_loop(self.model, self.kp, self.kd)

    @property
    def initial_state(self) -> Vector:
        """At rest at the start with straight appendages, shape (2 n,)."""
        return np.concatenate((self.start, np.zeros(2 * self.model.coordinates - len(self.start))))

    @property
    def final_state(self) -> Vector:
        """At rest at the goal with straight appendages, shape (2 n,)."""
        return np.concatenate((self.goal, np.zeros(2 * self.model.coordinates - len(self.goal))))

    @property
    def largest_pole(self) -> float:
        """Largest |pole| of the linearised loop at the start, midway and at the goal [1/s]."""
        middle = 0.5 * (self.start + self.goal)
        return max(
            _largest_pole(self.model, self.kp, self.kd, joints)
            for joints in (self.start, middle, self.goal)
        )

    def fly(self, edges: Vector, feedforward: Matrix) -> Matrix:
        """Return the states [q, v] at the edges, shape (steps + 1, 2 n).

        Args:
            edges: rising times from 0 on, shape (steps + 1,) [s].
            feedforward: at the stage_times of the edges, shape (STAGES steps, joints) [N m].
        """
        r = rest_to_rest(self.reference, self.start, self.goal, self.duration, stage_times(edges))
        command = feedforward + self.kp * r.position + self.kd * r.velocity
        record = stage_record(command, self.model.coordinates)
        return roll_out(self.loop, self.initial_state, edges, record)

    def efforts(self, edges: Vector, feedforward: Matrix, path: Matrix) -> Matrix:
        """Return feedforward and feedback (16) at the edges, shape (steps + 1, joints) [N m].

        Args:
            edges: shape (steps + 1,) [s].
            feedforward: at the edges, shape (steps + 1, joints) [N m].
            path: the states there, shape (steps + 1, 2 n).
        """
        n, joints = self.model.coordinates, self.model.joints
        requested = rest_to_rest(self.reference, self.start, self.goal, self.duration, edges)
        feedback = self.kp * (requested.position - path[:, :joints])
        feedback += self.kd * (requested.velocity - path[:, n : n + joints])
        return np.asarray(feedforward + feedback)


def manoeuvre_of(slew: Slew, duration: float, reference: Profile) -> Manoeuvre:
    """Return a slew as the motion of the loop closed by its feedback.

    Args:
        slew: the requested slew.
        duration: T_c [s].
        reference: the profile of the reference.
    """
    return Manoeuvre(slew.model, slew.kp, slew.kd, slew.start, slew.goal, duration, reference)


def _largest_pole(model: Model, kp: Vector, kd: Vector, joints: Vector) -> float:
    """Return the largest |pole| about the rest at joints, from M x'' + (D + Kd) x' + (K + Kp) x."""
    n, m = model.coordinates, model.joints
    open_loop = model.linearise(np.concatenate((joints, np.zeros(n - m))))
    right = np.hstack((open_loop.stiffness, open_loop.damping))
    for j in range(m):
        right[j, j] += kp[j]
        right[j, n + j] += kd[j]
    companion = np.zeros((2 * n, 2 * n))
    companion[:n, n:] = np.eye(n)
    companion[n:] = -np.linalg.solve(open_loop.mass, right)
    return float(np.abs(np.linalg.eigvals(companion)).max())


def stage_times(edges: Vector) -> Vector:
    """Return when the stages of each step lie, shape (STAGES steps,), strictly inside the step.

    Strictly, so that a jump of a basis at an edge is seen from the right side.
    """
    clipped = np.clip(STAGE_TIMES, 1e-12, 1.0 - 1e-12)
    return np.asarray((edges[:-1, None] + np.diff(edges)[:, None] * clipped).ravel())


@lru_cache(maxsize=16)
def _tables(basis: Basis, profile: Profile, substeps: int) -> tuple[Vector, Matrix, Vector, Vector]:
    """Return edges, the basis at the stages, and the unit reference p, dp/dt there."""
    nodes = basis.nodes
    edges = np.linspace(0.0, basis.duration, (len(nodes) - 1) * substeps + 1)
    times = stage_times(edges)
    unit = rest_to_rest(profile, np.zeros(1), np.ones(1), basis.duration, times)
    return edges, basis.values(times), unit.position, unit.velocity


@lru_cache(maxsize=16)
def _at_edges(basis: Basis, substeps: int) -> Matrix:
    """Return the basis at the edges of the integration, shape (steps + 1, n_u)."""
    nodes = basis.nodes
    return basis.values(np.linspace(0.0, basis.duration, (len(nodes) - 1) * substeps + 1))


def substeps_for(manoeuvre: Manoeuvre, basis: Basis) -> int:
    """Return into how many steps each piece of the basis is cut for an error in Y below 1e-8."""
    piece = basis.duration / (len(basis.nodes) - 1)
    step = min(_STEP_ANGLE / manoeuvre.largest_pole, basis.duration / _STEPS_A_SLEW)
    return int(np.ceil(piece / step))


@dataclass(frozen=True)
class TerminalMap:
    """Y = S(U) (21): the terminal error (20) as a function of the weights (19), on a fixed grid.

    Args:
        manoeuvre: the slew.
        basis: of the feedforward of every joint.
        substeps: integration steps in each piece of the basis.
    """

    manoeuvre: Manoeuvre
    basis: Basis
    substeps: int
    _work: dict[str, Matrix] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        m = self.manoeuvre
        _, table, position, velocity = _tables(self.basis, m.reference, self.substeps)
        reference = m.start + position * (m.goal - m.start)
        n, stages = m.model.coordinates, len(table)
        self._work["drive"] = m.kp * reference + m.kd * (velocity * (m.goal - m.start))
        self._work["states"] = np.empty((stages, 2 * n))
        self._work["accelerations"] = np.empty((stages, n))
        self._work["adjoint"] = np.empty((stages, m.model.joints * 2 * n))
        self._work["path"] = np.empty((0, 2 * n))

    @property
    def steps(self) -> int:
        """Integration steps of one evaluation."""
        return len(self._work["drive"]) // STAGES

    def terminal_error(self, weights: Vector) -> Vector:
        """Return Y (20): joints, modes, then their rates at T_c, minus the goal, shape (2 n,).

        Args:
            weights: U (19), the first joint's n_u weights, then the next one's [N m].
        """
        m = self.manoeuvre
        edges, table, _, _ = _tables(self.basis, m.reference, self.substeps)
        command = table @ weights.reshape(m.model.joints, -1).T
        command += self._work["drive"]
        self._work["command"] = command
        path = self._work["path"] = roll_out(m.loop, m.initial_state, edges, self._record)
        return np.asarray(path[-1] - m.final_state)

    def sensitivity(self) -> Matrix:
        """Return G = dY/dU (24) at the weights of the last terminal_error, exact, (2 n, N_U)."""
        m = self.manoeuvre
        table = _tables(self.basis, m.reference, self.substeps)[1]
        self._differentiate(np.empty((0, 0)))
        by_joint = (self._work["adjoint"].T @ table).reshape(m.model.joints, -1, table.shape[1])
        return np.concatenate(by_joint, axis=1)

    def efforts(self, weights: Vector) -> Matrix:
        """Return feedforward and feedback (16) at the edges of the last terminal_error.

        Args:
            weights: U, those of the last terminal_error.

        Returns:
            shape (steps + 1, joints) [N m].
        """
        m = self.manoeuvre
        edges = _tables(self.basis, m.reference, self.substeps)[0]
        feedforward = _at_edges(self.basis, self.substeps) @ weights.reshape(m.model.joints, -1).T
        return m.efforts(edges, feedforward, self._work["path"])

    @property
    def positions(self) -> Matrix:
        """The joints at the edges of the last terminal_error, shape (steps + 1, joints)."""
        return self._work["path"][:, : self.manoeuvre.model.joints]

    def sensitivities(self) -> tuple[Matrix, Matrix, Matrix]:
        """Return the derivatives of terminal_error, efforts and positions by the weights, exact.

        Returns:
            G = dY/dU, shape (2 n, N_U), and those along the path, (steps + 1, joints, N_U) each.
        """
        m = self.manoeuvre
        n, joints, steps = m.model.coordinates, m.model.joints, self.steps
        table = _tables(self.basis, m.reference, self.substeps)[1].reshape(steps, STAGES, -1)
        flat = np.empty((steps, 4 * n * n))
        self._differentiate(flat)
        transitions = flat.reshape(steps, 2 * n, 2 * n).swapaxes(1, 2)
        by_stage = self._work["adjoint"].reshape(steps, STAGES, joints * 2 * n).swapaxes(1, 2)
        by_joint = (by_stage @ table).reshape(steps, joints, 2 * n, -1)
        stage_terms = np.concatenate(by_joint.swapaxes(0, 1), axis=2)
        path = np.zeros((steps + 1, *stage_terms.shape[1:]))
        for k in range(steps):
            path[k + 1] = transitions[k] @ path[k] + stage_terms[k]
        efforts = -m.kp[:, None] * path[:, :joints] - m.kd[:, None] * path[:, n : n + joints]
        rows = _at_edges(self.basis, self.substeps)
        for j in range(joints):
            efforts[:, j, j * rows.shape[1] : (j + 1) * rows.shape[1]] += rows
        return path[-1], efforts, path[:, :joints]

    def secant(self, weights: Vector, error: Vector, change: float = 1e-2) -> Matrix:
        """Return G by the paper's finite differences: each weight in turn changed [N m]."""
        columns = [
            (self.terminal_error(weights + step) - error) / change
            for step in change * np.eye(len(weights))
        ]
        return np.array(columns).T

    def _differentiate(self, transitions: Matrix) -> None:
        """Write the adjoint of the last roll-out into the work space."""
        m = self.manoeuvre
        edges = _tables(self.basis, m.reference, self.substeps)[0]
        final_sensitivity(m.loop, edges, self._record, self._work["adjoint"], transitions)

    @property
    def _record(self) -> StageRecord:
        """The stages of the last roll-out."""
        work = self._work
        return StageRecord(work["command"], work["states"], work["accelerations"])
