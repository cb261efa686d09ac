"""A member of an ensemble: one model under the feedback, and the vibration that it is left with."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from flexslew_control.planners.feedforward.basis import Basis
from flexslew_control.planners.feedforward.manoeuvre import Manoeuvre, stage_times, substeps_for
from flexslew_control.planners.residual.prediction import monitor_time
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.linearisation import Linearisation

_DOUBLINGS = 14  # of the first interval of the Gramian
_RESIDUAL_TIME = 75.0  # after the end, for the residual of the summary, at least [s]


class FeedforwardFlight(NamedTuple):
    """What one member does."""

    residual: float  # largest |tip deflection| after the end [m]
    deflection: float  # largest |tip deflection| of the whole flight [m]
    peak: Vector  # efforts, shape (joints,) [N m or N]
    swing: Matrix  # lowest and highest positions of the joints, (2, joints) [rad or m]


@dataclass(frozen=True)
class FeedforwardMember:
    """One model of the ensemble, as a slew.

    Args:
        stiffness_error: of its EI [-].
        payload_error: of its hub's inertias [-].
        manoeuvre: the slew under the feedback.
        lever: tip deflection that one radian is worth [m/rad].
    """

    stiffness_error: float
    payload_error: float
    manoeuvre: Manoeuvre
    lever: float

    @cached_property
    def tips(self) -> Matrix:
        """Return the tips by the modes, each motion once, shape (tips, modes).

        Two tips that always deflect alike, or opposite to each other, count as one.
        """
        tip = self.manoeuvre.model.appendages.tip
        tip = tip[tip.any(axis=1)]
        if not len(tip):
            return tip
        first = np.take_along_axis(tip, (tip != 0.0).argmax(axis=1)[:, None], axis=1)
        return np.unique(np.sign(first) * tip + 0.0, axis=0)

    @property
    def _goal_model(self) -> Linearisation:
        """The small motions about the goal under the feedback."""
        m = self.manoeuvre
        rest = np.concatenate((m.goal, np.zeros(m.model.coordinates - m.model.joints)))
        return m.model.linearise(rest).with_feedback(m.kp, m.kd)

    @property
    def weight(self) -> Matrix:
        """W^(1/2), shape (2 n, 2 n): |W^(1/2) Y| is the later vibration [m]."""
        m = self.manoeuvre
        n, joints = m.model.coordinates, m.model.joints
        a = self._goal_model.state_matrix
        seen = np.zeros((joints + len(self.tips), 2 * n))
        seen[:joints, :joints] = self.lever * np.eye(joints)
        seen[joints:, joints:n] = self.tips
        # integral of e^(A^T t) C^T C e^(A t), doubled again and again; it needs no damping
        h = m.duration / 2.0**_DOUBLINGS
        step, one = a * h, np.eye(2 * n)
        power = one + step @ (one + step @ (one + step @ (one + step / 4.0) / 3.0) / 2.0)
        gramian = h / m.duration * seen.T @ seen
        for _ in range(_DOUBLINGS):
            gramian = gramian + power.T @ gramian @ power
            power = power @ power
        values, vectors = np.linalg.eigh(0.5 * (gramian + gramian.T))
        return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T)

    def simulate(self, basis: Basis, weights: Matrix) -> FeedforwardFlight:
        """Return what the member does under the feedforward and its feedback.

        Args:
            basis: of the feedforward.
            weights: shape (n_u, joints) [N m].
        """
        m = self.manoeuvre
        n, joints = m.model.coordinates, m.model.joints
        pieces = (len(basis.nodes) - 1) * substeps_for(m, basis)
        step = m.duration / pieces
        after = max(_RESIDUAL_TIME, monitor_time(self._goal_model.eigenvalues, step))
        edges = step * np.arange(pieces + int(np.ceil(after / step)) + 1, dtype=np.float64)
        path = m.fly(edges, basis.values(stage_times(edges)) @ weights)
        effort = m.efforts(edges, basis.values(edges) @ weights, path)
        tip = np.abs(path[:, joints:n] @ self.tips.T)
        return FeedforwardFlight(
            float(tip[pieces:].max(initial=0.0)),
            float(tip.max(initial=0.0)),
            np.abs(effort).max(axis=0),
            np.array((path[:, :joints].min(axis=0), path[:, :joints].max(axis=0))),
        )
