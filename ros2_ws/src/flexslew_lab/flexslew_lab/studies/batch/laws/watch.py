"""Whether innovations are as large as a filter states, member by member, by the step of the bench.

A member in which they are not is the bench's to fly.
"""

from collections.abc import Callable
from typing import NamedTuple, cast

from flexslew_control.controllers.linear_form import KalmanForm, Observer, OnModelForm, SteadyForm
from flexslew_control.estimators.gained_filter import GainFilter
from flexslew_control.estimators.monitor import Monitor, MonitorNumbers, innovation_tests
from flexslew_lab.studies.batch.benches.judge import SENSOR_ERROR
from flexslew_lab.studies.batch.groups.rows import Rows, Sizes
from flexslew_plant.arrays import Vector, vectorised
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH

_SAFE = 1.0 - 1e-6  # of a limit: innovations are small differences, and members round otherwise


class Watch(NamedTuple):
    """What a monitor allows."""

    first: int  # innovation in the flat z of the observer
    innovations: int
    numbers: MonitorNumbers


def _innovations_of(observer: Observer) -> tuple[int, int] | None:
    """Return in which row of z the innovation begins, and how many there are; None: not there."""
    if isinstance(observer, OnModelForm):
        return _innovations_of(observer.observer)
    if not isinstance(observer, KalmanForm | GainFilter | SteadyForm):
        return None
    outputs, states = observer.output.shape
    return states, outputs


def watch_of(monitor: Monitor | None, observer: Observer) -> Watch | None:
    """Return what a controller's monitor allows the innovations in z; None: there is none."""
    found = _innovations_of(observer)
    if monitor is None or found is None:
        return None
    first, count = found
    exact = monitor.numbers(count)
    safe = exact._replace(single=_SAFE * exact.single, window_limit=_SAFE * exact.window_limit)
    return Watch(first * BATCH_WIDTH, count, safe)


def innovation_monitor(rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what marks members in which a test of this tick fails.

    It takes (k, Watch, z, memory, w): variances stand at the end of the memory.
    """
    squares, flags, count = rows.squares, rows.doubt, sizes.monitored * BATCH_WIDTH
    is_monitored = sizes.monitored > 0

    @vectorised
    def watch(k: int, limits: Watch, z: Vector, memory: Vector, w: Vector) -> None:
        if not is_monitored:  # known to the compiler
            return
        variances = memory.size - count
        for i in range(count):
            at, innovation = flags + i % BATCH_WIDTH, z[limits.first + i]
            variance = memory[variances + i]
            one = innovation_tests(limits.numbers, w[squares + i], k, innovation, variance)
            w[squares + i] = one.total
            w[at] = w[at] if one.passed else SENSOR_ERROR

    return cast(Callable[..., None], watch)
