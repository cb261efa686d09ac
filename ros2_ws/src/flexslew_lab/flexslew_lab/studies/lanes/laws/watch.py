"""Whether innovations are as large as a filter states, lane by lane, as estimators.monitor says it.

A lane in which they are not is the bench's to fly.
"""

from collections.abc import Callable
from typing import NamedTuple, cast

from flexslew_control.estimators.gained_filter import GainedFilter
from flexslew_control.estimators.monitor import Monitor
from flexslew_control.linear_form import KalmanForm, Observer, OnModelForm, SteadyForm
from flexslew_lab.studies.lanes.benches.judge import DISTRUSTED
from flexslew_lab.studies.lanes.groups.rows import Rows, Sizes
from flexslew_plant.arrays import Vector, vectorised
from flexslew_plant.testbeds.compiled.lanes import LANES

_SAFE = 1.0 - 1e-6  # of a limit: innovations are small differences, and lanes round otherwise


class Watch(NamedTuple):
    """What a monitor allows."""

    first: int  # innovation in the flat z of the observer
    innovations: int
    window: int  # ticks
    single: float  # limit of the square of one over its variance
    several: float  # of the sum of a window


def _innovations_of(observer: Observer) -> tuple[int, int] | None:
    """Return in which row of z the innovation begins, and how many there are; None: not there."""
    if isinstance(observer, OnModelForm):
        return _innovations_of(observer.observer)
    if isinstance(observer, KalmanForm):
        outputs, states = observer.matrices.c.shape
    elif isinstance(observer, GainedFilter | SteadyForm):
        outputs, states = observer.output.shape
    else:
        return None
    return states, outputs


def watch_of(monitor: Monitor | None, observer: Observer) -> Watch | None:
    """Return what a controller's monitor allows the innovations in z; None: there is none."""
    found = _innovations_of(observer)
    if monitor is None or found is None:
        return None
    first, count = found
    limits = (_SAFE * limit for limit in monitor.limits(count))
    return Watch(first * LANES, count, monitor.settings.window, *limits)


def watching(rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what marks lanes in which a test of this tick fails.

    It takes (k, Watch, z, memory, w): variances stand at the end of the memory.
    """
    squares, doubt, count = rows.squares, rows.doubt, sizes.watched * LANES
    watched = sizes.watched > 0

    @vectorised
    def watch(k: int, limits: Watch, z: Vector, memory: Vector, w: Vector) -> None:
        if not watched:  # known to the compiler
            return
        variances, ends = memory.size - count, (k + 1) % limits.window == 0
        for i in range(count):
            e, at = z[limits.first + i], doubt + i % LANES
            square = e * e / memory[variances + i]
            w[squares + i] += square
            agree = square <= limits.single  # NaN is not
            if ends:
                agree = agree and w[squares + i] <= limits.several
                w[squares + i] = 0.0
            w[at] = w[at] if agree else DISTRUSTED

    return cast(Callable[..., None], watch)
