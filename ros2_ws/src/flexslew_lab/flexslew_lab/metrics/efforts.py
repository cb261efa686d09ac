"""What the drives give."""

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from flexslew_lab.metrics.metric import (
    Block,
    Ending,
    Key,
    MetricEntry,
    RunSetup,
    add_rows,
    ready,
)
from flexslew_plant.arrays import Number, Vector


class EffortSums(NamedTuple):
    """What one or more runs have accumulated."""

    peak: Vector  # largest |effort|, (..., joints)
    square: Vector  # integral of its square, (..., joints)
    saturated: Vector  # time with one at its limit, (...,) [s]


def saturation_excess(effort: Number, limit: Number) -> Number:
    """Return by how much efforts exceed their limits, but for rounding; from 0 on: saturated."""
    return abs(effort) - limit * (1.0 - 1e-12)


def squared_effort(effort: Number, held: Number) -> Number:
    """Return the integral of u^2 while u was held, a term of EffortSums.square.

    Args:
        effort: u [N m or N].
        held: for how long [s].
    """
    return effort * effort * held


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
        self.sums = EffortSums(np.zeros(joints), np.zeros(joints), np.zeros(1))
        self.times: tuple[float, float] | None = None  # first and last [s]

    def add(self, block: Block) -> None:
        """Take the next ticks."""
        peak, square, saturated = self.sums
        peak = np.maximum(peak, np.abs(block.effort).max(axis=0))
        square = add_rows(square, squared_effort(block.effort, block.held[:, None]))
        first = float(block.time[0]) if self.times is None else self.times[0]
        self.times = first, float(block.time[-1])
        limit = self._setup.limit
        if limit.size == block.effort.shape[1]:
            full = (saturation_excess(block.effort, limit) >= 0.0).any(axis=1)
            saturated = add_rows(saturated, block.held[full, None])
        self.sums = EffortSums(peak, square, saturated)

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return the four values."""
        first, last = self.times or (0.0, 0.0)
        sums = self.sums._replace(saturated=self.sums.saturated[0])
        return ready(self._setup, self.KEYS, effort_values(sums, last - first))


def effort_values(sums: EffortSums, duration: float) -> dict[str, Vector]:
    """Return the values of one or more runs by key, shapes (..., joints) and (...,).

    Args:
        sums: of the runs.
        duration: from their first to their last tick [s].
    """
    return {
        "peak_effort": sums.peak,
        "rms_effort": np.sqrt(sums.square / duration if duration > 0.0 else sums.square),
        "control_effort": sums.square.sum(axis=-1),
        "saturated_time": sums.saturated,
    }


EFFORTS = MetricEntry(Efforts, "effort", needs_truth=False)
