"""The course of the run: manoeuvre, ticks, times, and what the log lacks."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from flexslew_lab.metrics.metric import Block, Ending, Key, MetricEntry, RunSetup
from flexslew_plant.events import RunFinished


class CourseMetric:
    """Implements Metric."""

    KEYS: ClassVar[Mapping[str, Key]] = {
        "manoeuvre_start": Key("s", False, "start of the last plan; 0 without a plan"),
        "manoeuvre_end": Key("s", False, "end of the last plan; 0 without a plan"),
        "ticks": Key("-", False, "ticks that the truth covers: last minus first"),
        "duration": Key("s", False, "simulated time from the first to the last truth"),
        "wall_time": Key("s", False, "wall time of the run; null: not recorded"),
        "missing_ticks": Key("-", False, "ticks missing from the truth in the log"),
        "log_complete": Key(
            "-",
            False,
            "whether the log was finished; false: it is cut, and the numbers are those up to the "
            "cut",
        ),
        "warnings": Key(
            "-",
            False,
            "why these numbers may not be those of the run, in words: parts of the log that no "
            "checksum protects, metrics of the trial's own that were not run",
        ),
    }

    def __init__(self, setup: RunSetup) -> None:
        self._manoeuvre = setup.manoeuvre
        self.ticks: tuple[int, int] | None = None  # first and last
        self.times = 0.0, 0.0  # first and last [s]
        self._missing = 0

    def add(self, block: Block) -> None:
        """Take the next ticks."""
        tick = block.tick.astype(np.int64)
        first, before = self.ticks or (int(tick[0]), int(tick[0]) - 1)
        self._missing += int(np.maximum(np.diff(tick, prepend=before) - 1, 0).sum())
        start = float(block.time[0]) if self.ticks is None else self.times[0]
        self.times = start, float(block.time[-1])
        self.ticks = first, int(tick[-1])

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return the eight values."""
        first, last = self.ticks or (0, 0)
        finished = (e.what for e in ending.events if isinstance(e.what, RunFinished))
        wall = [e.wall_time for e in finished if e.wall_time is not None]
        wall += ending.wall_times
        return {
            "manoeuvre_start": self._manoeuvre.start,
            "manoeuvre_end": self._manoeuvre.end,
            "ticks": last - first,
            "duration": self.times[1] - self.times[0],
            "wall_time": wall[-1] if wall else None,
            "missing_ticks": self._missing,
            "log_complete": ending.complete,
            "warnings": list(ending.warnings),
        }


COURSE = MetricEntry(CourseMetric, "run", needs_truth=False)
