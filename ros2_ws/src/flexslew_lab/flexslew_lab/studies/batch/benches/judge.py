"""Whether joint sensors agree, member by member, by the step of the bench.

A member in which they do not is the bench's to fly.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple, cast

import numpy as np

from flexslew_lab.studies.batch.groups.batch_trial import BatchTrial
from flexslew_lab.studies.batch.groups.rows import Rows, Sizes
from flexslew_plant.arrays import Matrix, Vector, vectorised
from flexslew_plant.hardware.plausibility import (
    PlausibilityNumbers,
    compare_rates,
    plausibility_memory,
)
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH

SENSOR_ERROR = 2.0  # in the row `doubt`
_SAFE = 1.0 - 1e-9  # of what is allowed: members differ from the bench by less


class SensorCheck(NamedTuple):
    """What is compared."""

    allowed: Vector  # difference of mean rates over a full window, (members,) [rad/s or m/s]
    window: int  # ticks
    memory: Matrix  # of each joint of each member, (joints * BATCH_WIDTH, numbers)


def sensor_check_of(members: Sequence[BatchTrial]) -> SensorCheck | None:
    """Return what the drives of a group compare; None: they do not."""
    settings = [member.trial.plausibility for member in members]
    if settings[0] is None:
        return None
    window, joints = settings[0].window, members[0].model.joints
    allowed = np.array([_SAFE * one.rate_difference for one in settings if one])
    return SensorCheck(
        allowed, window, np.zeros((joints * BATCH_WIDTH, plausibility_memory(window)))
    )


def sensor_check_step(rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what marks members in which the readings of a tick contradict each other."""
    reading, flag_row, count, has_check = (
        rows.reading,
        rows.doubt,
        sizes.joints * BATCH_WIDTH,
        sizes.checks_joints,
    )

    @vectorised
    def compare(k: int, dt: float, sensor_check: SensorCheck, w: Vector) -> None:
        if not has_check:  # known to the compiler
            return
        for i in range(count):
            numbers = PlausibilityNumbers(
                sensor_check.allowed[i % BATCH_WIDTH], sensor_check.window, dt
            )
            position, rate = w[reading + i], w[reading + count + i]
            _, consistent = compare_rates(numbers, sensor_check.memory[i], k, position, rate)
            w[flag_row + i % BATCH_WIDTH] = (
                w[flag_row + i % BATCH_WIDTH] if consistent else SENSOR_ERROR
            )

    return cast(Callable[..., None], compare)
