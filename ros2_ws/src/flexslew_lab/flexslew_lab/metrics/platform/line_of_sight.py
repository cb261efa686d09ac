"""How far antennas look past their targets once they have turned."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from flexslew_lab.metrics.metric import Block, Ending, Key, MetricEntry, RunSetup, goal_by_joint
from flexslew_plant.testbeds.contract import HasLinesOfSight


class LineOfSightMetric:
    """Implements Metric; returns no value for a testbed on which no antenna turns.

    Only the times count at which an antenna has turned to a target and has not started to turn
    to the next one.
    """

    KEYS: ClassVar[Mapping[str, Key]] = {
        "line_of_sight_error": Key(
            "rad",
            False,
            "by antenna: largest angle in inertial space between line of sight and target, "
            "after its manoeuvre; null: none has ended",
        ),
        "line_of_sight_settled_at": Key(
            "s",
            False,
            "by antenna: when that angle, after its manoeuvre, settles within the pointing "
            "tolerance; null: never",
            never="line_of_sight_error",
        ),
    }

    def __init__(self, setup: RunSetup) -> None:
        known: Any = setup.testbed
        self._testbed: HasLinesOfSight = known
        self._goal = goal_by_joint(setup)
        self._error: dict[str, float | None] = {}
        self._good_from: dict[str, float | None] = {}

    def add(self, block: Block) -> None:
        """Take the next ticks."""
        for name, sight in self._testbed.lines_of_sight(
            block.time, block.position, self._goal
        ).items():
            before = self._error.setdefault(name, None)
            bad = ~sight.rests | (sight.error > self._testbed.pointing_tolerance)
            since = self._good_from.get(name)
            late = np.flatnonzero(bad)
            if late.size:
                since = float(block.time[late[-1] + 1]) if late[-1] + 1 < bad.size else None
            elif since is None:
                since = float(block.time[0])
            self._good_from[name] = since
            if sight.rests.any():
                self._error[name] = max(before or 0.0, float(sight.error[sight.rests].max()))

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return both values by antenna."""
        if not self._error:
            return {}
        return {
            "line_of_sight_error": self._error,
            "line_of_sight_settled_at": self._good_from,
        }


LINE_OF_SIGHT = MetricEntry(LineOfSightMetric, of=HasLinesOfSight)
