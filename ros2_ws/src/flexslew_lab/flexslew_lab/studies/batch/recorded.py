"""Metrics of trials in a batch from their recorded truth, by the rule for all runs."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from flexslew_lab.metrics.epoch import Epoch
from flexslew_lab.metrics.metric import Ending, ReferenceManoeuvre, RunSetup
from flexslew_lab.metrics.own import keys_of, load_user_metrics
from flexslew_lab.metrics.trajectory import TrajectoryMetric
from flexslew_lab.studies.batch.groups.batch_trial import BatchTrial
from flexslew_lab.studies.flight import columns_of
from flexslew_plant.arrays import Tensor
from flexslew_plant.bench.wire import stamp_of

TICKS = 2048  # that are recorded before they are measured


class RecordedMetrics:
    """The metrics of one trial.

    Args:
        member: the trial.
        target: of its manoeuvre.
        source: of the study, to name in an error.
    """

    def __init__(self, member: BatchTrial, target: ReferenceManoeuvre, source: str) -> None:
        self._member, model = member, member.model
        self._modes, self._failed = model.positions - model.modes, False
        limit = np.array(member.trial.testbed.effort_limit)
        setup = RunSetup(model.joint_names, target, limit, member.trial.testbed)
        trial = member.trial
        with self._catch_user_errors():
            user_metrics = load_user_metrics(trial.metrics, f"{source}: metrics", trial.trust)
            self._keys = keys_of(user_metrics)
            self._epoch = Epoch(
                0, setup, user_metrics, without=(TrajectoryMetric,)
            )  # a hash of exact bits

    def add(self, times: dict[str, Any], truth: Tensor) -> None:
        """Take the next ticks: their stamps, and states with applied efforts, (ticks, rows)."""
        model, positions = self._member.model, self._member.model.positions
        q, rest = truth[:, :positions], truth[:, positions:]
        columns = {
            "position": q,
            "velocity": rest[:, : model.coordinates],
            "applied_effort": rest[:, model.coordinates :],
            "tip_deflection": q[:, self._modes :] @ model.appendages.tip.T,
        }
        if not self._failed:
            with self._catch_user_errors():
                self._epoch.add(times | columns)

    def metrics(self) -> dict[str, float | None] | None:
        """Return the columns of the trial; None: a metric of its own has raised an error."""
        if not self._failed:
            with self._catch_user_errors():
                ending = Ending(self._member.happens.charge.events, [], True)
                return columns_of(self._epoch.result(ending), self._keys)
        return None

    @contextmanager
    def _catch_user_errors(self) -> Iterator[None]:
        """Keep what a metric of the user's own does to its own trial."""
        try:
            yield
        except Exception:
            if not self._member.trial.metrics:
                raise
            self._failed = True


def stamp_columns(first: int, last: int, period: float) -> dict[str, Any]:
    """Return tick and stamp from `first` to before `last` as the truth has them."""
    ticks = np.arange(first, last, dtype=np.uint64)
    times = [stamp_of(k * period) for k in range(first, last)]
    return {
        "tick": ticks,
        "header.stamp.sec": np.array([stamp.sec for stamp in times], dtype=np.int32),
        "header.stamp.nanosec": np.array([s.nanosec for s in times], dtype=np.uint32),
    }
