"""When the vibration of an appendage has died away after it has turned."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from flexslew_lab.metrics.metric import Block, Ending, Key, MetricEntry, RunSetup, goal_by_joint
from flexslew_lab.metrics.platform.block_motions import block_motions
from flexslew_plant.testbeds.contract import Pointing as PointingTestbed
from flexslew_plant.testbeds.contract import Retargetable

BAND = 0.05  # of the largest distance of its tip until then [-]


class Vibration:
    """Implements Metric, of a platform that points."""

    KEYS: ClassVar[Mapping[str, Key]] = {
        "vibration_settling_time": Key(
            "s",
            False,
            "by appendage: from the end of its last turn (without one, of the manoeuvre) until its "
            "tip stays within 5 % of the largest distance before, of the run where nothing is "
            "before; null: never, or at the end of the run not yet for longer than it had last "
            "been within before it left again",
            never="peak_platform_attitude",
        ),
    }

    def __init__(self, setup: RunSetup) -> None:
        known: Any = setup.testbed
        self._testbed: PointingTestbed = known
        self._goal = goal_by_joint(setup)
        self._end: dict[str, float] = {}  # of the last turn [s]
        if isinstance(known, Retargetable):
            self._end = {turn.appendage: turn.end for turn in known.hinge_turns()}
        self._without = setup.manoeuvre.end  # of an appendage that does not turn [s]
        self._peak: dict[str, float] = {}  # until then, where it ends at the start of the run [m]
        self._outside: dict[str, float] = {}  # last time outside of the band [s]
        self._tick: dict[str, int] = {}  # of that time
        self._crossing_time: dict[
            str, float
        ] = {}  # from the time outside before that one to it [s]
        self._first_time, self._last_time = np.inf, 0.0

    def add(self, block: Block) -> None:
        """Take the next ticks."""
        self._first_time = min(self._first_time, float(block.time[0]))
        self._last_time = float(block.time[-1])
        tips = block_motions(self._testbed, block, self._goal).tips
        for name, tip in tips.items():
            distance = np.linalg.norm(tip, axis=1)
            end = self._end.get(name, self._without)
            before = block.time < end
            counts = distance if end <= self._first_time else np.where(before, distance, 0.0)
            peaks = np.maximum(np.maximum.accumulate(counts), self._peak.get(name, 0.0))
            self._peak[name] = float(peaks[-1])
            outside = np.flatnonzero(before | (distance > BAND * peaks))
            if outside.size:
                ticks, times = block.tick[outside], block.time[outside]
                ticks = np.insert(ticks, 0, self._tick.get(name, ticks[0]))
                times = np.insert(times, 0, self._outside.get(name, times[0]))
                if (left := np.flatnonzero(np.diff(ticks) > 1)).size:
                    self._crossing_time[name] = float(np.diff(times)[left[-1]])
                self._tick[name], self._outside[name] = int(ticks[-1]), float(times[-1])

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return the value by appendage."""
        if not self._peak:
            return {}
        settling_times: dict[str, float | None] = {}
        for name in self._peak:
            last = self._outside.get(name, -np.inf)
            end = self._end.get(name, self._without)
            in_band = self._last_time - last > self._crossing_time.get(name, 0.0)
            settling_times[name] = max(last - end, 0.0) if in_band else None
        return {"vibration_settling_time": settling_times}


VIBRATION = MetricEntry(Vibration, of=PointingTestbed)
