"""Where joints read an attitude: their positions as a law sees them, errors being rotations.

The compiled form of Controller and AttitudeJoints.about for one run; member after member, by the
same functions.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple, cast

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, compiled
from flexslew_plant.testbeds.compiled.batch_kernel import member_rows, skip
from flexslew_plant.testbeds.orientation.attitude import AttitudeJoints, apply_attitude_error


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

    @compiled
    def replace_positions(
        w: Vector, rotation_joints: RotationJoints, reference: Vector, filled: int
    ) -> None:
        axes, inverse = rotation_joints.axes, rotation_joints.inverse
        for member in range(filled):
            position = member_rows(w, reading, joints, member)
            apply_attitude_error(axes, inverse, reference, position)

    return cast(Callable[..., None], replace_positions if reads_attitude else skip)
