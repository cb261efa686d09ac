"""The error of an attitude: the rotation from the measured to the demanded attitude.

Joints that turn a platform read its rotation vector along their axes. Two of these vectors cannot
be subtracted: the difference is the rotation between them only where both are about one axis, and
fed back with body rates it is a circulatory stiffness, which can be unstable. Wie, Weiss and
Arapostathis 1989 feed the quaternion of the rotation between them back.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexslew_plant.arrays import Indices, Matrix, Vector, called, compiled_once
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.orientation.quaternions import (
    RotationVector,
    multiply,
    quaternion_of,
    rotation_vector_of,
    way,
)

_ROUNDED = 1e-3  # what positions of joints may lie apart that one attitude has [rad or m]
_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])  # of x, y, z in a cross product
_CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])  # what turns a quaternion x y z w round


def quaternion(rotation: Vector) -> Vector:
    """Return the unit quaternion x y z w of a rotation vector, shapes (..., 3) [rad], (..., 4)."""
    attitude = np.empty((*rotation.shape[:-1], 4))
    _write_quaternions(_rows(rotation), attitude.reshape(-1, 4))
    return attitude


@compiled_once("attitude")
def _write_quaternions(rotation: Matrix, attitude: Matrix) -> None:
    for k in range(len(rotation)):
        attitude[k, 0], attitude[k, 1], attitude[k, 2], attitude[k, 3] = quaternion_of(
            rotation[k, 0], rotation[k, 1], rotation[k, 2]
        )


def product(first: Vector, then: Vector) -> Vector:
    """Return the quaternion of one turn and then another about the turned axes, x y z w."""
    a, b = np.broadcast_arrays(first, then) if first.shape != then.shape else (first, then)
    result = np.empty(a.shape)
    _write_products(_rows(a), _rows(b), result.reshape(-1, 4))
    return result


@compiled_once("result")
def _write_products(a: Matrix, b: Matrix, result: Matrix) -> None:
    for k in range(len(a)):
        result[k, 0], result[k, 1], result[k, 2], result[k, 3] = multiply(
            (a[k, 0], a[k, 1], a[k, 2], a[k, 3]), (b[k, 0], b[k, 1], b[k, 2], b[k, 3])
        )


def conjugate(attitude: Vector) -> Vector:
    """Return the quaternion of the turn back, x y z w, shape (..., 4)."""
    inverse: Vector = attitude * _CONJUGATE
    return inverse


def to_body(attitude: Vector) -> Matrix:
    """Return the rotation from inertial to turned axes of a quaternion x y z w, shape (3, 3)."""
    v, w = attitude[:3], attitude[3]
    rotation: Matrix = (w * w - v @ v) * np.eye(3) + 2.0 * np.outer(v, v) - 2.0 * w * skew(v)
    return rotation


def to_inertial(attitude: Matrix, along: Vector) -> Matrix:
    """Return vectors given along turned axes, along inertial ones, shape (..., 3).

    Args:
        attitude: quaternions x y z w, shape (..., 4).
        along: in body axes, shape (3,) or (..., 3).
    """
    cross_product = cross(attitude[..., :3], along)
    found = along + 2.0 * (
        attitude[..., 3:] * cross_product + cross(attitude[..., :3], cross_product)
    )
    return np.ascontiguousarray(found)  # the layout decides the last bits of products with it


def skew(a: Vector) -> Matrix:
    """Return the matrix of a x, shape (3, 3)."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b, shape (..., 3), to the bit as np.cross, which takes five times as long."""
    cross_product: Vector = a[..., _NEXT] * b[..., _LAST] - a[..., _LAST] * b[..., _NEXT]
    return cross_product


def rotation_vector(attitude: Vector) -> Vector:
    """Return the rotation vector of unit quaternions x y z w, no longer than pi, (..., 3) [rad]."""
    rotation = np.empty((*attitude.shape[:-1], 3))
    _write_rotation_vectors(_rows(attitude), rotation.reshape(-1, 3))
    return rotation


@compiled_once("rotation")
def _write_rotation_vectors(attitude: Matrix, rotation: Matrix) -> None:
    for k in range(len(attitude)):
        rotation[k, 0], rotation[k, 1], rotation[k, 2] = rotation_vector_of(
            (attitude[k, 0], attitude[k, 1], attitude[k, 2], attitude[k, 3])
        )


@compiled_once("left")
def _write_errors(axes: Matrix, start: Matrix, end: Matrix, left: Matrix) -> None:
    """Write the errors of joints that read a turn over their differences, row by row."""
    for k in range(len(start)):
        a, b = (start[k, 0], start[k, 1], start[k, 2]), (end[k, 0], end[k, 1], end[k, 2])
        plain, (x, y, z) = way(a, b)
        if plain:
            continue
        for j in range(len(axes)):
            if axes[j, 0] != 0.0 or axes[j, 1] != 0.0 or axes[j, 2] != 0.0:
                left[k, j] = axes[j, 0] * x + axes[j, 1] * y + axes[j, 2] * z


@called
def joint_rotation_vector(inverse: Matrix, position: Vector) -> RotationVector:
    """Return the rotation vector that joints read, in compiled code [rad].

    Args:
        inverse: from their positions to it, shape (3, joints).
        position: of the joints, shape (joints,).
    """
    x, y, z = 0.0, 0.0, 0.0
    for j in range(position.size):
        x += inverse[0, j] * position[j]
        y += inverse[1, j] * position[j]
        z += inverse[2, j] * position[j]
    return x, y, z


@called
def apply_attitude_error(
    axes: Matrix, inverse: Matrix, reference: Vector, position: Vector
) -> None:
    """Replace positions by AttitudeJoints.about, in compiled code.

    Args:
        axes: of the joints, shape (joints, 3).
        inverse: see joint_rotation_vector.
        reference: where they shall be, shape (joints,).
        position: measured, in and out, shape (joints,).
    """
    plain, (x, y, z) = way(
        joint_rotation_vector(inverse, position), joint_rotation_vector(inverse, reference)
    )
    if plain:
        return
    for j in range(len(axes)):
        if axes[j, 0] != 0.0 or axes[j, 1] != 0.0 or axes[j, 2] != 0.0:
            position[j] = reference[j] - (axes[j, 0] * x + axes[j, 1] * y + axes[j, 2] * z)


def _rows(vectors: Vector) -> Matrix:
    """Return the last axes of an array, one after another."""
    return np.ascontiguousarray(vectors).reshape(-1, vectors.shape[-1])


@dataclass(frozen=True)
class AttitudeJoints:
    """The joints that read a platform's rotation vector, and determine it in all three axes.

    Args:
        axes: axis of each joint in body axes, shape (joints, 3); zeros: it reads something else.
    """

    axes: Matrix

    @cached_property
    def _other(self) -> Indices:
        """Which joints read something else than the turn."""
        return np.flatnonzero(~self.reads)

    @cached_property
    def reads(self) -> NDArray[np.bool_]:
        """Whether a joint reads the turn, shape (joints,)."""
        reads: NDArray[np.bool_] = np.any(self.axes, axis=1)
        return reads

    @cached_property
    def _from_joints(self) -> Matrix:
        """From the joints' positions to the rotation vector, shape (3, joints)."""
        inverse: Matrix = np.asarray(np.linalg.pinv(self.axes), dtype=np.float64)
        return inverse

    def together(self, position: Vector, named: NDArray[np.bool_], first: Vector) -> Vector:
        """Return positions that one attitude has, with the named joints where they are demanded.

        More joints than axes cannot have arbitrary positions. Those that are not named then follow,
        by the least turn from `first`.

        Args:
            position: demanded positions, shape (joints,) [rad or m].
            named: whether each of them is named, shape (joints,).
            first: present positions of the joints, shape (joints,) [rad or m].

        Raises:
            BadInput: no attitude has the named ones.
        """
        if not self._mismatch(self.axes @ self.rotation_vector_of(position), position, self.reads):
            return position
        requested, start = named & self.reads, self.rotation_vector_of(first)
        rows = self.axes[requested]
        rotation = start + np.linalg.pinv(rows) @ (position[requested] - rows @ start)
        target: Vector = np.where(self.reads, self.axes @ rotation, position)
        if self._mismatch(target, position, requested):
            nearest = ", ".join(f"{at:.6g}" for at in target[requested])
            raise BadInput(f"no attitude has these joints there; the nearest has {nearest}")
        return target

    @staticmethod
    def _mismatch(target: Vector, position: Vector, which: NDArray[np.bool_]) -> bool:
        """Return whether positions differ by more than their rounding in a file."""
        return bool(abs(target - position)[which].max(initial=0.0) > _ROUNDED)

    def error(self, measured: Vector, goal: Vector) -> Vector:
        """Return what is left to turn or move, along each joint, shape of measured [rad or m].

        About one axis it is goal - measured to the bit, as long as that is less than half a turn.

        Args:
            measured: positions of the joints, shape (..., joints).
            goal: where they go, shape (joints,) or (..., joints).
        """
        left: Vector = np.ascontiguousarray(goal - measured)
        start = _rows(self.rotation_vector_of(measured))
        end = self.rotation_vector_of(goal)
        if goal.shape != left.shape:
            end = np.broadcast_to(end, (*left.shape[:-1], 3))
        _write_errors(self.axes, start, _rows(end), left.reshape(-1, left.shape[-1]))
        return left

    def add_error(self, position: Vector, by: Vector) -> Vector:
        """Return positions of which `error`, from these, is `by`, shape (..., joints).

        Args:
            position: of the joints, shape (..., joints).
            by: a turn in body axes along the joints that read it, moves of others, same shape.
        """
        rotations = (
            quaternion(self.rotation_vector_of(position)),
            quaternion(self.rotation_vector_of(by)),
        )
        attitude = rotation_vector(product(*rotations)) @ self.axes.T
        target: Vector = np.where(self.reads, attitude, position + by)
        return target

    def rotation_vector_of(self, position: Vector) -> Vector:
        """Return the rotation vector that the joints read, shape (..., 3) [rad]."""
        rotation: Vector = position @ self._from_joints.T
        return rotation

    def orientation(self, position: Vector) -> Vector:
        """Return the attitude that the joints read, quaternions x y z w, shape (..., 4)."""
        return quaternion(self.rotation_vector_of(position))

    def displacement(self, first: Vector, last: Vector) -> Vector:
        """Return how far each joint goes from one position to another, shape (joints,).

        About one axis that is the difference, whole turns included; else it is the error.
        """
        cross_product = np.cross(self.rotation_vector_of(first), self.rotation_vector_of(last))
        return last - first if not cross_product.any() else self.error(first, last)

    def share(self, error: Vector, move: Vector) -> Vector:
        """Return errors as shares of moves, of the attitude and of each other joint that moves.

        Args:
            error: as `error` gives it, shape (joints,).
            move: as `displacement` gives it, shape (joints,).
        """
        rotations = [[float(np.linalg.norm(self.rotation_vector_of(one)))] for one in (error, move)]
        off, way = (
            np.concatenate((rotation, np.abs(one[self._other])))
            for rotation, one in zip(rotations, (error, move), strict=True)
        )
        return off[way > 0.0] / way[way > 0.0]

    def about(self, reference: Vector, measured: Vector) -> Vector:
        """Return positions that differ from the reference by the error, shape (joints,).

        A law that takes reference - position for its error then feeds the rotation back.
        """
        plain, error = reference - measured, self.error(measured, reference)
        return np.where(error == plain, measured, reference - error)


def attitude_joints(axes: Matrix) -> AttitudeJoints | None:
    """Return the joints that determine an attitude; None: they do not read a turn in all axes."""
    return AttitudeJoints(axes) if np.linalg.matrix_rank(axes, tol=1e-6) == 3 else None
