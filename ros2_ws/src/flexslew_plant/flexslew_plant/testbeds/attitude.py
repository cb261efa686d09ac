"""The error of an attitude: the rotation from what is measured to what is asked for.

Joints that turn a platform read its rotation vector along their axes. Two of these vectors cannot
be subtracted: the difference is the rotation between them only where both are about one axis, and
fed back beside body rates it is a circulatory stiffness, which can be unstable. Wie, Weiss and
Arapostathis 1989 feed the quaternion of the rotation between them back.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flexslew_plant.arrays import Indices, Matrix, Vector

_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])  # of x, y, z in a cross product


def quaternion(turn: Vector) -> Vector:
    """Return the unit quaternion x y z w of a rotation vector, shapes (..., 3) [rad], (..., 4)."""
    angle = np.linalg.norm(turn, axis=-1, keepdims=True)
    half: Matrix = np.sinc(angle / (2.0 * np.pi)) / 2.0
    return np.concatenate((half * turn, np.cos(angle / 2.0)), axis=-1)


def product(first: Vector, then: Vector) -> Vector:
    """Return the quaternion of one turn and then another about the turned axes, x y z w."""
    a, b = first, then
    va, wa, vb, wb = a[..., :3], a[..., 3:], b[..., :3], b[..., 3:]
    vector = wa * vb + wb * va + cross(va, vb)
    scalar = wa * wb - np.sum(va * vb, axis=-1, keepdims=True)
    return np.concatenate((vector, scalar), axis=-1)


def conjugate(turned: Vector) -> Vector:
    """Return the quaternion of the turn back, x y z w, shape (..., 4)."""
    back: Vector = turned * np.array([-1.0, -1.0, -1.0, 1.0])
    return back


def to_body(turned: Vector) -> Matrix:
    """Return the rotation from inertial to turned axes of a quaternion x y z w, shape (3, 3)."""
    v, w = turned[:3], turned[3]
    rotation: Matrix = (w * w - v @ v) * np.eye(3) + 2.0 * np.outer(v, v) - 2.0 * w * skew(v)
    return rotation


def to_inertial(turned: Matrix, along: Vector) -> Matrix:
    """Return vectors given along turned axes, along inertial ones, shape (k, 3).

    Args:
        turned: quaternions x y z w, shape (k, 4) or (1, 4).
        along: in body axes, shape (3,) or (k, 3).
    """
    across = np.cross(turned[:, :3], along)
    found: Matrix = along + 2.0 * (turned[:, 3:] * across + np.cross(turned[:, :3], across))
    return found


def skew(a: Vector) -> Matrix:
    """Return the matrix of a x, shape (3, 3)."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b, shape (..., 3), to the bit as np.cross, which takes five times as long."""
    across: Vector = a[..., _NEXT] * b[..., _LAST] - a[..., _LAST] * b[..., _NEXT]
    return across


def rotation_vector(turned: Vector) -> Vector:
    """Return the rotation vector of unit quaternions x y z w, no longer than pi, (..., 3) [rad]."""
    return _shorter(turned[..., :3], turned[..., 3:])


def turn_between(measured: Vector, goal: Vector) -> Vector:
    """Return the rotation q_measured^-1 q_goal as a rotation vector in body axes, the shorter way.

    Args:
        measured: rotation vectors, shape (..., 3) [rad].
        goal: rotation vectors, shape (3,) or (..., 3) [rad].

    Returns:
        shape (..., 3), no longer than pi [rad].
    """
    a, b = quaternion(measured), quaternion(goal)
    va, wa, vb, wb = a[..., :3], a[..., 3:], b[..., :3], b[..., 3:]
    vector = wa * vb - wb * va - cross(va, vb)
    scalar = wa * wb + np.sum(va * vb, axis=-1, keepdims=True)
    return _shorter(vector, scalar)


def _shorter(vector: Vector, scalar: Vector) -> Vector:
    """Return the rotation vector of a quaternion, the shorter way round."""
    vector, scalar = np.where(scalar < 0.0, -vector, vector), np.abs(scalar)
    size = np.linalg.norm(vector, axis=-1, keepdims=True)
    ratio = 2.0 * np.arctan2(size, scalar) / np.where(size > 0.0, size, 1.0)
    turn: Vector = np.where(size > 0.0, ratio, 2.0) * vector
    return turn


@dataclass(frozen=True)
class AttitudeJoints:
    """The joints that read a platform's rotation vector, which they tell in all three axes.

    Args:
        axes: of each joint in body axes, shape (joints, 3); zeros: it reads something else.
    """

    axes: Matrix

    @cached_property
    def _other(self) -> Indices:
        """Which joints read something else than the turn."""
        return np.flatnonzero(np.abs(self.axes).max(axis=1) == 0.0)

    @cached_property
    def _from_joints(self) -> Matrix:
        """From the joints' positions to the rotation vector, shape (3, joints)."""
        inverse: Matrix = np.asarray(np.linalg.pinv(self.axes), dtype=np.float64)
        return inverse

    def error(self, measured: Vector, goal: Vector) -> Vector:
        """Return what is left to turn or move, along each joint, shape of measured [rad or m].

        About one axis it is goal - measured to the bit, as long as that is less than half a turn.

        Args:
            measured: positions of the joints, shape (..., joints).
            goal: where they go, shape (joints,) or (..., joints).
        """
        plain = goal - measured
        start, end = self.turn_of(measured), self.turn_of(goal)
        with np.errstate(invalid="ignore"):  # a dead sensor reads NaN
            about_one = np.abs(cross(start, end)).max(axis=-1) == 0.0
            within = np.linalg.norm(end - start, axis=-1) <= np.pi
            turned = turn_between(start, end) @ self.axes.T
        left: Vector = np.where((about_one & within)[..., None], plain, turned)
        left[..., self._other] = plain[..., self._other]
        return left

    def turn_of(self, position: Vector) -> Vector:
        """Return the rotation vector that the joints read, shape (..., 3) [rad]."""
        turn: Vector = position @ self._from_joints.T
        return turn

    def displacement(self, first: Vector, last: Vector) -> Vector:
        """Return how far each joint goes from one position to another, shape (joints,).

        About one axis that is the difference, whole turns included; else it is the error.
        """
        across = np.cross(self.turn_of(first), self.turn_of(last))
        return last - first if not across.any() else self.error(first, last)

    def share(self, error: Vector, move: Vector) -> Vector:
        """Return errors as shares of moves, of the attitude and of each other joint that moves.

        Args:
            error: as `error` gives it, shape (joints,).
            move: as `displacement` gives it, shape (joints,).
        """
        turns = [[float(np.linalg.norm(self.turn_of(one)))] for one in (error, move)]
        off, way = (
            np.concatenate((turn, np.abs(one[self._other])))
            for turn, one in zip(turns, (error, move), strict=True)
        )
        return off[way > 0.0] / way[way > 0.0]

    def about(self, reference: Vector, measured: Vector) -> Vector:
        """Return positions whose difference from the reference is the error, shape (joints,).

        What takes reference - position for its error then feeds the rotation back.
        """
        plain, error = reference - measured, self.error(measured, reference)
        return np.where(error == plain, measured, reference - error)


def attitude_joints(axes: Matrix) -> AttitudeJoints | None:
    """Return the joints that tell an attitude; None: they do not read a turn in all three axes."""
    return AttitudeJoints(axes) if np.linalg.matrix_rank(axes, tol=1e-6) == 3 else None
