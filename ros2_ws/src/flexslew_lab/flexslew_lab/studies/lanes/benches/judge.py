"""Whether joint sensors agree, lane by lane, as hardware.plausibility says it of the bench.

A lane in which they do not is the bench's to fly.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple, cast

import numpy as np

from flexslew_lab.studies.lanes.groups.lane_trial import LaneTrial
from flexslew_lab.studies.lanes.groups.rows import Rows, Sizes
from flexslew_plant.arrays import Tensor, Vector, vectorised
from flexslew_plant.testbeds.compiled.lanes import LANES

DISTRUSTED = 2.0  # in the row `doubt`
_SAFE = 1.0 - 1e-9  # of what is allowed: lanes differ from the bench by less


class LaneJudge(NamedTuple):
    """What is compared."""

    allowed: Vector  # difference of mean rates over a full window, times its ticks, (lanes,)
    read: Tensor  # newest positions and rates, each tick over the one that is a window behind


def judge_of(lanes: Sequence[LaneTrial]) -> LaneJudge | None:
    """Return what the drives of a group compare; None: they do not."""
    chosen = [lane.trial.plausibility for lane in lanes]
    if chosen[0] is None:
        return None
    window, joints = chosen[0].window, lanes[0].model.joints
    allowed = np.array([_SAFE * one.rate_difference * window for one in chosen if one])
    return LaneJudge(allowed, np.zeros((window + 1, 2, joints * LANES)))


def judging(rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what marks lanes whose readings of a tick contradict each other."""
    reading, doubt, count, judged = rows.reading, rows.doubt, sizes.joints * LANES, sizes.judged

    @vectorised
    def compare(k: int, dt: float, judge: LaneJudge, w: Vector) -> None:
        if not judged:  # known to the compiler
            return
        read, places = judge.read, judge.read.shape[0]
        now, ticks = k % places, min(k, places - 1)
        for i in range(count):
            read[now, 0, i] = w[reading + i]
            read[now, 1, i] = w[reading + count + i]
        if ticks == 0:
            return
        first = (k - ticks) % places
        for i in range(count):
            total = -0.5 * (read[first, 1, i] + read[now, 1, i])
            for back in range(ticks + 1):
                total += read[(k - back) % places, 1, i]
            moved = (read[now, 0, i] - read[first, 0, i]) / (ticks * dt)
            agree = abs(moved - total / ticks) * ticks <= judge.allowed[i % LANES]  # NaN is not
            w[doubt + i % LANES] = w[doubt + i % LANES] if agree else DISTRUSTED

    return cast(Callable[..., None], compare)
