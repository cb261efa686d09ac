"""The metrics of one epoch of the truth, block after block."""

from collections.abc import Container, Mapping, Sequence
from math import isfinite
from typing import Any

import numpy as np

from flexslew_lab.metrics import METRICS
from flexslew_lab.metrics.metric import Block, Ending, Metric, RunSetup
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput


class Epoch:
    """Measures one epoch with every metric.

    Args:
        number: number of the epoch; its events count.
        setup: what is known before the first tick.
        user_metrics: metrics of the trial's own, besides METRICS.
        without: those of METRICS that are not requested.
    """

    def __init__(
        self,
        number: int,
        setup: RunSetup,
        user_metrics: Sequence[type[Metric]] = (),
        without: Container[type[Metric]] = (),
    ) -> None:
        self.number, self._setup = number, setup
        entries = [entry for entry in METRICS.values() if entry.is_for(setup.testbed)]
        shipped = (entry.metric for entry in entries if entry.metric not in without)
        self._metrics: list[Metric] = [metric(setup) for metric in (*shipped, *user_metrics)]
        self._model = None if setup.testbed is None else setup.testbed.model()
        self._last_time: float | None = None

    def add(self, columns: Mapping[str, Any]) -> None:
        """Take the next ticks of the truth, by the fields of its message.

        Raises:
            BadInput: they are of another testbed.
        """
        joints = len(self._setup.joint_names)
        q, v = columns["position"], columns["velocity"]
        positions = joints if self._model is None else self._model.positions
        if columns["applied_effort"].shape[1] != joints or q.shape[1] < positions:
            raise BadInput("the truth changes its number of joints in the course of the run")
        time = columns["header.stamp.sec"] + columns["header.stamp.nanosec"] * 1e-9
        before = float(time[0]) if self._last_time is None else self._last_time
        self._last_time = float(time[-1])
        m = self._setup.manoeuvre
        block = Block(
            columns["tick"],
            time,
            np.diff(time, prepend=before),
            q,
            v,
            columns["applied_effort"],
            columns["tip_deflection"],
            None if m.goal is None else self._error(self._joints(q, v), m.goal),
            time >= m.start - 1e-9,
            time >= m.end - 1e-9,
        )
        with np.errstate(all="ignore"):  # of a crafted log squares may overflow; see merged
            for metric in self._metrics:
                metric.add(block)

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return the content of metrics.json.

        Args:
            ending: what else there is to know; events of other epochs are left out.
        """
        events = [event for event in ending.events if event.epoch == self.number]
        return merged(self._metrics, ending._replace(events=events))

    def _error(self, position: Matrix, goal: Vector) -> Matrix:
        """Return joint position - goal, shape (ticks, joints); of an attitude the rotation."""
        if self._model is None or self._model.attitude is None:
            return position - goal
        error: Matrix = -self._model.attitude.error(position, goal)
        return error

    def _joints(self, q: Matrix, v: Matrix) -> Matrix:
        if self._model is None or self._model.reading is None:
            return q[:, : len(self._setup.joint_names)]
        return self._model.joint_states(np.hstack((q, v)))[0]


def merged(metrics: Sequence[Metric], ending: Ending) -> dict[str, Any]:
    """Return the values of all metrics, in their order; of one key the last one's value counts.

    What is not finite is None.
    """
    with np.errstate(all="ignore"):
        found = {key: value for metric in metrics for key, value in metric.result(ending).items()}
    return {key: _finite(value) for key, value in found.items()}


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if isfinite(value) else None
    if isinstance(value, dict):
        return {name: _finite(part) for name, part in value.items()}
    return [_finite(part) for part in value] if isinstance(value, list) else value
