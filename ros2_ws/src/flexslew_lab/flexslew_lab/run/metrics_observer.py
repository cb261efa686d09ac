"""Metrics of a run while it is flown, without a log: the same numbers as from its bag."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexslew_control.plan import Plan
from flexslew_lab.metrics.epoch import Epoch
from flexslew_lab.metrics.from_bag import manoeuvre_of
from flexslew_lab.metrics.metric import Ending, Metric, ReferenceManoeuvre, RunSetup
from flexslew_lab.run.in_process import Observer
from flexslew_plant.bench.bench import Bench, Truth
from flexslew_plant.bench.wire import stamp_of
from flexslew_plant.events import Event

_BLOCK = 1024  # ticks that are measured at once


class MetricsObserver(Observer):
    """Implements in_process.Observer; result() gives the content of metrics.json.

    Args:
        bench: at tick 0.
        plan: that is flown, None without one.
        user_metrics: metrics of the trial's own.
        end: of the manoeuvre, instead of that of the plan [s].
    """

    def __init__(
        self,
        bench: Bench,
        plan: Plan | None,
        user_metrics: Sequence[type[Metric]] = (),
        end: float | None = None,
    ) -> None:
        joints, n = bench.model.joints, bench.truth().position.size
        if plan is None:
            manoeuvre = ReferenceManoeuvre(0.0, 0.0, None, np.zeros(joints))
        else:
            manoeuvre = manoeuvre_of(
                plan.position, plan.velocity, plan.start, plan.duration, bench.testbed
            )
        if end is not None:
            manoeuvre = manoeuvre._replace(end=end)
        names = tuple(bench.model.joint_names)
        setup = RunSetup(names, manoeuvre, bench.limit, bench.testbed)
        self._epoch = Epoch(bench.epoch, setup, user_metrics)
        rates = bench.truth().velocity.size
        self._rows = 0
        self._columns: dict[str, NDArray[Any]] = {
            "tick": np.empty(_BLOCK, dtype=np.uint64),
            "header.stamp.sec": np.empty(_BLOCK, dtype=np.int32),
            "header.stamp.nanosec": np.empty(_BLOCK, dtype=np.uint32),
            "position": np.empty((_BLOCK, n)),
            "velocity": np.empty((_BLOCK, rates)),
            "applied_effort": np.empty((_BLOCK, joints)),
            "tip_deflection": np.empty((_BLOCK, bench.truth().tip_deflection.size)),
        }
        self.events: list[Event] = []  # of the flight so far

    def truth(self, truth: Truth) -> None:
        """Take the state at a tick."""
        c, k = self._columns, self._rows
        c["tick"][k] = truth.tick
        c["header.stamp.sec"][k], c["header.stamp.nanosec"][k] = stamp_of(truth.time)
        c["position"][k], c["velocity"][k] = truth.position, truth.velocity
        c["applied_effort"][k] = truth.applied_effort
        c["tip_deflection"][k] = truth.tip_deflection
        self._rows += 1
        if self._rows == _BLOCK:
            self._measure()

    def event(self, event: Event) -> None:
        """Take an event."""
        self.events.append(event)

    def result(self) -> dict[str, Any]:
        """Return the content of metrics.json for what has been seen."""
        self._measure()
        return self._epoch.result(Ending(self.events, [], True))

    def _measure(self) -> None:
        if self._rows:
            self._epoch.add({name: c[: self._rows] for name, c in self._columns.items()})
            self._rows = 0
