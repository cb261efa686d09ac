"""Metrics of trials in lanes from their recorded truth, by the rule for all runs."""

from typing import Any

import numpy as np

from flexslew_lab.metrics.epoch import Epoch
from flexslew_lab.metrics.metric import Ending, FlownManoeuvre, RunSetup
from flexslew_lab.metrics.trajectory import TrajectoryMetric
from flexslew_lab.studies.flight import columns_of
from flexslew_lab.studies.lanes.lane_trial import LaneTrial
from flexslew_plant.arrays import Tensor
from flexslew_plant.bench.wire import stamp_of

TICKS = 2048  # that are recorded before they are measured


class RecordedMetrics:
    """The metrics of one trial.

    Args:
        lane: the trial.
        aim: of its manoeuvre.
    """

    def __init__(self, lane: LaneTrial, aim: FlownManoeuvre) -> None:
        self._lane, model = lane, lane.model
        limit = np.array(lane.trial.testbed.effort_limit)
        setup = RunSetup(model.joint_names, aim, limit, lane.trial.testbed)
        self._epoch = Epoch(0, setup, without=(TrajectoryMetric,))  # a hash of exact bits
        self._modes = model.positions - model.modes

    def add(self, stamps: dict[str, Any], truth: Tensor) -> None:
        """Take the next ticks: their stamps, and states with applied efforts, (ticks, rows)."""
        model, positions = self._lane.model, self._lane.model.positions
        q, rest = truth[:, :positions], truth[:, positions:]
        columns = {
            "position": q,
            "velocity": rest[:, : model.coordinates],
            "applied_effort": rest[:, model.coordinates :],
            "tip_deflection": q[:, self._modes :] @ model.appendages.tip.T,
        }
        self._epoch.add(stamps | columns)

    def metrics(self) -> dict[str, float | None]:
        """Return the columns of the trial."""
        return columns_of(self._epoch.result(Ending([], [], True)))


def stamps_of(first: int, last: int, period: float) -> dict[str, Any]:
    """Return tick and stamp from `first` to before `last` as the truth has them."""
    ticks = np.arange(first, last, dtype=np.uint64)
    stamps = [stamp_of(k * period) for k in range(first, last)]
    return {
        "tick": ticks,
        "header.stamp.sec": np.array([stamp.sec for stamp in stamps], dtype=np.int32),
        "header.stamp.nanosec": np.array([s.nanosec for s in stamps], dtype=np.uint32),
    }
