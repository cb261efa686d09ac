"""Members that turn in three axes: the feedback is of the rotation to the nominal attitude.

    u_i(k) = w(k) + A (Kp theta(q_i(k)^-1 q_0(k)) + Kd (w_0(k) - w_i(k))),  joint by joint,
with theta the rotation vector of a quaternion and A the joints' axes. About the rest at the goal
the coordinates are the turn from there, in body axes, and the modes. Where the craft floats and how
far its wheels have turned decides nothing; both follow from what momentum is conserved.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space

from flexslew_control.analysis.lti import Lti
from flexslew_control.linear.free_platform import rate_outputs
from flexslew_control.planners.minimax.response import RestMotion
from flexslew_control.planners.residual.closed_loop import (
    ClosedLoopResponse,
    FeedbackNumbers,
    closed_loop,
    feedback,
)
from flexslew_control.planners.time_optimal.three_axes.path_limits import FREE, PathLimits
from flexslew_control.planners.time_optimal.three_axes.reorientation import Reorientation
from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import Model, Testbed
from flexslew_plant.testbeds.contract import CanFloat
from flexslew_plant.testbeds.linearisation import Linearisation
from flexslew_plant.testbeds.orientation.attitude import conjugate, product
from flexslew_plant.testbeds.orientation.quaternions import multiply, rotation_vector_of

_SMALL_ANGLE = 1e-4  # half angle below which a rotation has the slopes of its series [rad]
_SPRING = 1e-9  # of the largest stiffness: none, but for rounding


class PlatformEntries(NamedTuple):
    """Where a state holds the platform's attitude and rate."""

    attitude: Indices  # of the quaternion x y z w, (4,)
    rate: Indices  # of the body rates, (3,)


def platform_of(testbed: Testbed) -> PlatformEntries:
    """Return where a testbed's state holds its platform.

    Raises:
        BadInput: it does not float.
    """
    floating = testbed.floating() if isinstance(testbed, CanFloat) else None
    if floating is None:
        words = "its platform does not float; take moving, about the eigenaxis"
        raise BadInput(words, "plan", "drives", "all")
    model = testbed.model()
    place = floating.motion(np.arange(model.positions + model.coordinates, dtype=np.float64))
    return PlatformEntries(place.attitude.astype(int), place.rate.astype(int))


@dataclass(frozen=True)
class RotationMotion:
    """See motion.MemberMotion.

    Args:
        nominal: from rest to rest, on the model that the planner believes in.
        platform: where a state holds it.
        limits: that every member keeps to all along its path.
    """

    nominal: Reorientation
    platform: PlatformEntries
    limits: PathLimits = FREE

    @cached_property
    def _axes(self) -> Matrix:
        """Of the joints, shape (joints, 3)."""
        return np.ascontiguousarray(self.nominal.attitude.axes)

    def _of(self, model: Model) -> Reorientation:
        """Return the same turn of a member."""
        n = self.nominal
        return n if model is n.model else Reorientation(model, n.first, n.last, n.amplitude)

    def at_rest(self, model: Model) -> RestMotion:
        """Return the small motions of turn and modes about the rest at the goal.

        With v = Y y' + S s', where y are turn and modes, S reads neither, and Y^T M S = 0, no
        spring or damper acts on s, and y moves by itself.

        Raises:
            BadInput: a hinge on a spring moves besides.
        """
        place = self._of(model).rest[: model.positions]
        linear = model.linearise(place)
        n, modes, joints = model.coordinates, model.modes, len(self._axes)
        rotation = self.nominal.attitude.rotation_vector_of(rate_outputs(model, place).T).T
        read = np.vstack((rotation, np.eye(n)[n - modes :]))
        other, local = null_space(read), np.linalg.pinv(read)
        if abs(other.T @ linear.stiffness).max(initial=0.0) > _SPRING * abs(linear.stiffness).max():
            words = "a hinge on a spring moves besides; take moving, about the eigenaxis"
            raise BadInput(words, "plan", "drives", "all")
        mass = linear.mass
        local = local - other @ np.linalg.solve(other.T @ mass @ other, other.T @ mass @ local)
        inner = [local.T @ part @ local for part in (mass, linear.damping, linear.stiffness)]
        mass, damping, stiffness = (0.5 * (part + part.T) for part in inner)
        k = len(read)
        seen = np.zeros((2 * joints, 2 * k))
        seen[:joints, :3] = seen[joints:, k : k + 3] = self._axes
        tip = np.zeros((len(model.appendages.names), 2 * k))
        tip[:, 3:k] = model.appendages.tip
        rest_state = self._of(model).rest[None]
        along = np.zeros((len(self.limits.names), 2 * k))
        [by] = self.limits.reading_slopes(rest_state[:, self.platform.attitude], np.zeros((1, 3)))
        along[:, :3], along[:, k : k + 3] = by[:, :3], by[:, 3:]
        rest = Linearisation(mass, damping, stiffness, local.T @ linear.input_matrix)
        return RestMotion(rest, seen, tip, 3, along, self.along(rest_state)[0])

    def flight(
        self, model: Model, efforts: Matrix, gains: Matrix, path: Matrix | None, motors: Lti
    ) -> ClosedLoopResponse:
        """Return the flight of a member."""
        start, joints = self._of(model).start, len(self._axes)
        if path is None:
            gains, path = np.zeros_like(gains), np.zeros((len(efforts) + 1, start.size))
        axis_gains = np.hstack((gains[:, :joints] @ self._axes, gains[:, joints:] @ self._axes))
        fed_back = FeedbackNumbers(path, axis_gains, self._places)
        return closed_loop(model, start, efforts, _by_rotation, fed_back, motors)

    @property
    def _places(self) -> Indices:
        """Of the quaternion and the body rates, shape (7,)."""
        return np.concatenate(self.platform)

    @property
    def columns(self) -> Indices:
        """The entries of a state that decide about the turn."""
        return self.nominal.columns

    def feedback_derivatives(
        self, gains: Matrix, states: Matrix, path: Matrix
    ) -> tuple[Tensor, Tensor]:
        """Return those of the feedback."""
        (ticks, size), joints = states.shape, len(self._axes)
        kp = gains[:, :joints] @ self._axes
        kd = gains[:, joints:] @ self._axes
        at, rate = self.platform
        local, nominal = np.zeros((2, ticks, joints, size))
        by_member, by_nominal = _slopes(states[:, at], path[:, at])
        local[:, :, at], nominal[:, :, at] = kp @ by_member, kp @ by_nominal
        local[:, :, rate], nominal[:, :, rate] = -kd, kd
        return local, nominal

    def outputs(self, model: Model) -> Matrix:
        """Return what reads tips and rates off a state; positions, of no limit, read as zero."""
        joints, tips = len(self._axes), len(model.appendages.names)
        n, q = model.coordinates, model.positions
        found = np.zeros((tips + 2 * joints, n + q))
        found[:tips, q - model.modes : q] = model.appendages.tip
        found[tips + joints :, self.platform.rate] = self._axes
        return found

    def along(self, states: Matrix) -> Matrix:
        """Return what the limits of the path read, (k, limits) [rad, rad/s]."""
        at, rate = self.platform
        return self.limits.outputs(states[:, at], states[:, rate])

    def along_slopes(self, states: Matrix) -> Tensor:
        """Return its derivatives by the states, (k, limits, size)."""
        at, rate = self.platform
        by = self.limits.reading_slopes(states[:, at], states[:, rate])
        found = np.zeros((*by.shape[:2], states.shape[1]))
        found[:, :, at] = by[:, :, :3] @ _slopes(states[:, at], states[:, at])[1]
        found[:, :, rate] = by[:, :, 3:]
        return found

    def deviation(self, model: Model, x: Vector) -> Vector:
        """Return turn and modes from the rest at the goal, and their rates, shape (2 k,)."""
        error: Vector = self._of(model).rest_error(x[None])[0, self._order(model)]
        return error

    def deviation_slopes(self, model: Model, x: Vector) -> Matrix:
        """Return the derivatives of the deviation by the state, shape (2 k, size)."""
        k, q = 3 + model.modes, model.positions
        at, rate = self.platform
        found = np.zeros((2 * k, x.size))
        found[:3, at] = -_slopes(x[None, at], self._of(model).rest[None, at])[0][0]
        found[k : k + 3, rate] = np.eye(3)
        modes = np.arange(model.modes)
        found[3 + modes, q - model.modes + modes] = 1.0
        found[k + 3 + modes, x.size - model.modes + modes] = 1.0
        return found

    def _order(self, model: Model) -> Indices:
        """Return coordinates first, then rates: indices of Reorientation.missed."""
        modes = np.arange(model.modes)
        return np.concatenate(([0, 1, 2], 6 + modes, [3, 4, 5], 6 + model.modes + modes))


@feedback
def _by_rotation(
    x: Vector, reference: Vector, gains: Matrix, places: Indices, effort: Vector
) -> None:
    """Add A (Kp theta + Kd (w_0 - w)); places are the indices of attitude and rates in a state."""
    r, (a, b, c, d) = reference, places[:4]
    rotation = rotation_vector_of(multiply((-x[a], -x[b], -x[c], x[d]), (r[a], r[b], r[c], r[d])))
    for j in range(effort.size):
        for i in range(3):
            w = places[4 + i]
            effort[j] += gains[j, i] * rotation[i] + gains[j, 3 + i] * (r[w] - x[w])


def _slopes(measured: Matrix, goal: Matrix) -> tuple[Tensor, Tensor]:
    """Return the derivatives of the rotation vectors of q_measured^-1 q_goal by either, (k, 3, 4).

    With p = q_measured^-1 q_goal = (v, w), |v| = s and theta = f v, f = 2 atan2(s, w) / s:
        d theta = f dv + v (f_s (v . dv) / s + f_w dw),
        f_s / s = (2 w / (s^2 + w^2) - f) / s^2,  f_w = -2 / (s^2 + w^2).
    """
    difference = product(conjugate(measured), goal)
    sign = np.where(difference[:, 3:] < 0.0, -1.0, 1.0)  # the shorter way round
    v, w = sign * difference[:, :3], abs(difference[:, 3])
    s, size = np.linalg.norm(v, axis=1), np.sum(difference**2, axis=1)
    some, is_small = np.where(s > 0.0, s, 1.0), s < _SMALL_ANGLE
    f = np.where(s > 0.0, 2.0 * np.arctan2(s, w) / some, 2.0 / np.sqrt(size))
    by_size = np.where(is_small, -4.0 / (3.0 * size**1.5), (2.0 * w / size - f) / some**2)
    by = np.empty((len(v), 3, 4))
    by[:, :, :3] = f[:, None, None] * np.eye(3)
    by[:, :, :3] += by_size[:, None, None] * (v[:, :, None] * v[:, None])
    by[:, :, 3] = -2.0 / size[:, None] * v
    by *= sign[:, :, None]
    local = [product(conjugate(one), goal) for one in np.eye(4)]
    other = [product(conjugate(measured), one) for one in np.eye(4)]
    return by @ np.stack(local, axis=2), by @ np.stack(other, axis=2)
