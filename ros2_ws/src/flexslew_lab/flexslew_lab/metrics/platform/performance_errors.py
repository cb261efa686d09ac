"""Performance errors of an attitude as engineers of pointing state them: ECSS-E-ST-60-10C."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from flexslew_lab.metrics.metric import (
    Block,
    Ending,
    Key,
    MetricEntry,
    RunSetup,
    add_rows,
    goal_by_joint,
)
from flexslew_lab.metrics.platform.block_motions import block_motions
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.contract import Pointing as PointingTestbed


class PerformanceErrors:
    """Implements Metric, of a platform that points.

    With e(t) the rotation from the goal's attitude, in body axes, and windows of `pointing_window`
    laid end to end from the end of the manoeuvre on, or from `pointing_from` (ECSS-E-ST-60-10C,
    section 3.2):
        APE  e(t),    MPE  the mean of e over a window,    RPE  e(t) less the mean of its window.
    Each is the largest of its absolute values; a last window that is cut short does not count.
    """

    KEYS: ClassVar[Mapping[str, Key]] = {
        "absolute_performance_error": Key(
            "rad",
            False,
            "APE, x y z: largest |attitude error| after the manoeuvre's end",
            axes=True,
        ),
        "mean_performance_error": Key(
            "rad",
            False,
            "MPE, x y z: largest |mean of the attitude error over a pointing_window| after the "
            "manoeuvre's end; null: no window is whole",
            axes=True,
        ),
        "relative_performance_error": Key(
            "rad",
            False,
            "RPE, x y z: largest |attitude error less the mean of its pointing_window| after the "
            "manoeuvre's end; null: no window is whole",
            axes=True,
        ),
    }

    def __init__(self, setup: RunSetup) -> None:
        known: Any = setup.testbed
        self._testbed: PointingTestbed = known
        self._goal = goal_by_joint(setup)
        self._end = max(setup.manoeuvre.end, self._testbed.pointing_from)
        self._largest: dict[str, Vector] = {}
        self._window, self._sum, self._count = 0, np.zeros(3), 0
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)

    def add(self, block: Block) -> None:
        """Take the next ticks."""
        counts = block.time >= self._end - 1e-9
        if not counts.any():
            return
        error = block_motions(self._testbed, block, self._goal).attitude
        error, time = error[counts], block.time[counts]
        self._update_maximum("absolute", abs(error).max(axis=0))
        since = (time - self._end) / self._testbed.pointing_window
        windows = np.floor(since + 1e-9).astype(int)
        for window in np.unique(windows).tolist():
            if window > self._window:
                self._close()
                self._window = window
            self._take(error[windows == window])

    def _take(self, error: Matrix) -> None:
        """Take ticks of the window that is open."""
        self._sum = add_rows(self._sum, error)
        self._count += len(error)
        self._low = np.minimum(self._low, error.min(axis=0))
        self._high = np.maximum(self._high, error.max(axis=0))

    def _close(self) -> None:
        """End the window that is open."""
        if self._count:
            mean = self._sum / self._count
            self._update_maximum("mean", abs(mean))
            self._update_maximum("relative", np.maximum(self._high - mean, mean - self._low))
        self._sum, self._count = np.zeros(3), 0
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)

    def _update_maximum(self, kind: str, values: Vector) -> None:
        self._largest[kind] = np.maximum(self._largest.get(kind, values), values)

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return the three errors by body axis."""
        found = {kind: values.tolist() for kind, values in self._largest.items()}
        return {
            f"{kind}_performance_error": found.get(kind)
            for kind in ("absolute", "mean", "relative")
        }


PERFORMANCE_ERRORS = MetricEntry(PerformanceErrors, of=PointingTestbed)
