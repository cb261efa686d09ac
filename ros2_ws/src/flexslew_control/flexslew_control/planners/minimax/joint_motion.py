"""Members with the joints as first coordinates, q' = v: everything but a free platform."""

from dataclasses import dataclass

import numpy as np

from flexslew_control.analysis.lti import Lti
from flexslew_control.planners.minimax.response import RestMotion, joint_outputs
from flexslew_control.planners.residual.closed_loop import (
    ClosedLoopResponse,
    FeedbackNumbers,
    closed_loop,
    feedback,
)
from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector
from flexslew_plant.testbeds import Model


@dataclass(frozen=True)
class JointMotion:
    """See motion.MemberMotion.

    Args:
        start, goal: joint positions, shape (joints,) [rad or m].
    """

    start: Vector
    goal: Vector

    def at_rest(self, model: Model) -> RestMotion:
        """Return the small motions about the rest at the goal."""
        n, m = model.coordinates, model.joints
        place = model.rest(dict(zip(model.joint_names, self.goal.tolist(), strict=True)))
        tip = np.zeros((len(model.appendages.names), 2 * n))
        tip[:, m:n] = model.appendages.tip
        none = np.zeros((0, 2 * n))
        seen = joint_outputs(n, m, 2 * n)
        return RestMotion(model.linearise(place), seen, tip, m, none, none[:, 0])

    def flight(
        self, model: Model, efforts: Matrix, gains: Matrix, path: Matrix | None, motors: Lti
    ) -> ClosedLoopResponse:
        """Return the flight of a member."""
        m, n = model.joints, model.coordinates
        start = np.zeros(2 * n)
        start[:m] = self.start
        if path is None:
            gains, path = np.zeros_like(gains), np.zeros((len(efforts) + 1, start.size))
        inputs = efforts + np.hstack((path[:-1, :m], path[:-1, n : n + m])) @ gains.T
        places, none = np.concatenate((np.arange(m), n + np.arange(m))), np.zeros((len(inputs), 0))
        fed_back = FeedbackNumbers(none, gains, places)
        return closed_loop(model, start, inputs, _by_joint, fed_back, motors)

    @property
    def columns(self) -> None:
        """All entries of a state."""

    def feedback_derivatives(
        self, gains: Matrix, states: Matrix, path: Matrix
    ) -> tuple[Tensor, Tensor]:
        """Return those of Kp (r - y) + Kd (r' - y'), the same at every tick."""
        seen = joint_outputs(states.shape[1] // 2, len(gains), states.shape[1])
        by_path = np.tile(gains @ seen, (len(states), 1, 1))
        return -by_path, by_path

    def outputs(self, model: Model) -> Matrix:
        """Return what reads tips, positions and rates off a state, (tips + 2 joints, size)."""
        rest = self.at_rest(model)
        return np.vstack((rest.tip, rest.seen))

    def along(self, states: Matrix) -> Matrix:
        """Return nothing."""
        return np.zeros((len(states), 0))

    def along_slopes(self, states: Matrix) -> Tensor:
        """Return none."""
        return np.zeros((len(states), 0, states.shape[1]))

    def deviation(self, model: Model, x: Vector) -> Vector:
        """Return how far a state is from the rest at the goal, shape (2 n,)."""
        deviation = x.copy()
        deviation[: self.goal.size] -= self.goal
        return deviation

    def deviation_slopes(self, model: Model, x: Vector) -> Matrix:
        """Return the unit matrix."""
        return np.eye(x.size)


@feedback
def _by_joint(x: Vector, _: Vector, gains: Matrix, places: Indices, effort: Vector) -> None:
    """Subtract [Kp Kd] y, where places are the indices of joint positions and rates in a state."""
    m = effort.size
    for j in range(m):
        for i in range(m):
            effort[j] -= gains[j, i] * x[places[i]] + gains[j, m + i] * x[places[m + i]]
