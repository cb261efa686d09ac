"""What the drives give."""

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
    by_joint,
)
from flexslew_plant.arrays import Vector


class Efforts:
    """Implements Metric."""

    KEYS: ClassVar[Mapping[str, Key]] = {
        "peak_effort": Key("N m or N", True, "largest |applied effort|"),
        "rms_effort": Key(
            "N m or N", True, "root mean square of the applied effort, over all ticks"
        ),
        "control_effort": Key(
            "(N m)^2 s or N^2 s", False, "integral of the sum of squared efforts over the run"
        ),
        "saturated_time": Key(
            "s",
            False,
            "time with at least one applied effort at its limit; what a lag, a slew rate, a "
            "quantum or a fault keeps below it does not count, regardless of the demand (that is "
            "`saturated_time` of the event `finished`)",
        ),
    }

    def __init__(self, setup: RunSetup) -> None:
        self._setup = setup
        joints = len(setup.joint_names)
        self.peak, self.square_sum = np.zeros(joints), np.zeros(joints)
        self.saturated = np.zeros(1)
        self.times: tuple[float, float] | None = None  # first and last [s]

    def add(self, block: Block) -> None:
        """Take the next ticks."""
        square = block.effort**2
        self.peak = np.maximum(self.peak, np.abs(block.effort).max(axis=0))
        self.square_sum = add_rows(self.square_sum, square * block.held[:, None])
        first = float(block.time[0]) if self.times is None else self.times[0]
        self.times = first, float(block.time[-1])
        limit = self._setup.limit
        if limit.size == block.effort.shape[1]:
            full = (np.abs(block.effort) >= limit * (1.0 - 1e-12)).any(axis=1)
            self.saturated = add_rows(self.saturated, block.held[full, None])

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return the four values."""
        return {
            "peak_effort": by_joint(self._setup, self.peak),
            "rms_effort": by_joint(self._setup, root_mean_square(self.square_sum, self.times)),
            "control_effort": float(self.square_sum.sum()),
            "saturated_time": float(self.saturated[0]),
        }


def root_mean_square(square_sum: Vector, times: tuple[float, float] | None) -> Vector:
    """Return that of the efforts of one or more runs, (..., joints).

    Args:
        square_sum: of them over the time, (..., joints).
        times: first and last [s]; None: there was no tick.
    """
    first, last = times or (0.0, 0.0)
    return np.sqrt(square_sum / (last - first) if last > first else square_sum)


EFFORTS = MetricEntry(Efforts, "effort")
