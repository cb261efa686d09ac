"""Where joints read an attitude: their positions as a law sees them, errors being rotations.

The compiled form of Controller and AttitudeJoints.about for one run; member after member, by the
same functions.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple, cast

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, compiled
from flexslew_plant.testbeds.attitude import AttitudeJoints, joint_rotation_vector
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH
from flexslew_plant.testbeds.quaternions import way


class RotationJoints(NamedTuple):
    """The joints that read a rotation vector; none of either where no joints do."""

    axes: Matrix  # (joints, 3), see AttitudeJoints
    inverse: Matrix  # from the joints to the rotation vector, (3, joints)


def rotation_joints_of(attitude: AttitudeJoints | None, joints: int) -> RotationJoints:
    """Return the joints of a model with so many of them."""
    if attitude is None:
        return RotationJoints(np.zeros((0, 3)), np.zeros((3, 0)))
    return RotationJoints(
        np.ascontiguousarray(attitude.axes),
        np.ascontiguousarray(attitude.rotation_vector_of(np.eye(joints)).T),
    )


@lru_cache
def relative_to_reference(joints: int, reading: int, reads_attitude: bool) -> Callable[..., None]:
    """Return what replaces positions such that their differences from the reference are errors.

    It takes (w, RotationJoints, reference, number of members in use).

    Args:
        joints: how many.
        reading: where in the flat array their positions begin.
        reads_attitude: whether they read an attitude; else all stays.
    """
    if not reads_attitude:

        @compiled
        def no_op(
            w: Vector, rotation_joints: RotationJoints, reference: Vector, filled: int
        ) -> None:
            pass

        return cast(Callable[..., None], no_op)

    @compiled
    def replace_positions(
        w: Vector, rotation_joints: RotationJoints, reference: Vector, filled: int
    ) -> None:
        axes, inverse = rotation_joints.axes, rotation_joints.inverse
        goal = joint_rotation_vector(inverse, reference)
        for member in range(filled):
            ax, ay, az = 0.0, 0.0, 0.0
            for i in range(joints):
                measured = w[reading + i * BATCH_WIDTH + member]
                ax += inverse[0, i] * measured
                ay += inverse[1, i] * measured
                az += inverse[2, i] * measured
            plain, (x, y, z) = way((ax, ay, az), goal)
            if plain:
                continue
            for i in range(joints):
                if axes[i, 0] != 0.0 or axes[i, 1] != 0.0 or axes[i, 2] != 0.0:
                    error = axes[i, 0] * x + axes[i, 1] * y + axes[i, 2] * z
                    w[reading + i * BATCH_WIDTH + member] = reference[i] - error

    return cast(Callable[..., None], replace_positions)
