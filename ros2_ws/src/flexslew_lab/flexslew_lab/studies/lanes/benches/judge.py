"""Whether joint sensors agree, lane by lane, by the step of the bench.

A lane in which they do not is the bench's to fly.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple, cast

import numpy as np

from flexslew_lab.studies.lanes.groups.lane_trial import LaneTrial
from flexslew_lab.studies.lanes.groups.rows import Rows, Sizes
from flexslew_plant.arrays import Matrix, Vector, vectorised
from flexslew_plant.hardware.plausibility import (
    PlausibilityNumbers,
    compare_rates,
    plausibility_memory,
)
from flexslew_plant.testbeds.compiled.lanes import LANES

DISTRUSTED = 2.0  # in the row `doubt`
_SAFE = 1.0 - 1e-9  # of what is allowed: lanes differ from the bench by less


class LaneJudge(NamedTuple):
    """What is compared."""

    allowed: Vector  # difference of mean rates over a full window, (lanes,) [rad/s or m/s]
    window: int  # ticks
    memory: Matrix  # of each joint of each lane, (joints * LANES, numbers)


def judge_of(lanes: Sequence[LaneTrial]) -> LaneJudge | None:
    """Return what the drives of a group compare; None: they do not."""
    chosen = [lane.trial.plausibility for lane in lanes]
    if chosen[0] is None:
        return None
    window, joints = chosen[0].window, lanes[0].model.joints
    allowed = np.array([_SAFE * one.rate_difference for one in chosen if one])
    return LaneJudge(allowed, window, np.zeros((joints * LANES, plausibility_memory(window))))


def judging(rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what marks lanes in which the readings of a tick contradict each other."""
    reading, doubt, count, judged = rows.reading, rows.doubt, sizes.joints * LANES, sizes.judged

    @vectorised
    def compare(k: int, dt: float, judge: LaneJudge, w: Vector) -> None:
        if not judged:  # known to the compiler
            return
        for i in range(count):
            numbers = PlausibilityNumbers(judge.allowed[i % LANES], judge.window, dt)
            position, rate = w[reading + i], w[reading + count + i]
            _, agree = compare_rates(numbers, judge.memory[i], k, position, rate)
            w[doubt + i % LANES] = w[doubt + i % LANES] if agree else DISTRUSTED

    return cast(Callable[..., None], compare)
