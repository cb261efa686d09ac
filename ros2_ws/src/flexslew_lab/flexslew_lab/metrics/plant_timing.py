"""How fast an external plant, or the bench for one with a clock of its own, has answered."""

from collections.abc import Mapping
from typing import Any, ClassVar

from flexslew_lab.metrics.metric import Block, Ending, Key, MetricEntry, RunSetup
from flexslew_plant.events import PlantTicksMissed, WallTimes
from flexslew_plant.testbeds.contract import BlackBox


class PlantTiming:
    """Implements Metric, of external plants; all of it is in the events."""

    KEYS: ClassVar[Mapping[str, Key]] = {
        "plant_step_time": Key(
            "s",
            False,
            "median wall time of a step: an effort with its measurement; with the plant's own "
            "clock a measurement with the bench's effort",
        ),
        "least_plant_step_time": Key("s", False, "least of these times"),
        "late_plant_step_time": Key("s", False, "99 % of these times are at most as long"),
        "largest_plant_step_time": Key("s", False, "largest of these times"),
        "plant_jitter": Key(
            "s",
            False,
            "standard deviation of these times; with the plant's own clock of the intervals "
            "between its measurements",
        ),
        "plant_missed_ticks": Key(
            "-", False, "ticks of the plant's own clock that were lost or answered late"
        ),
    }

    def __init__(self, setup: RunSetup) -> None:
        pass

    def add(self, block: Block) -> None:
        """Take the next ticks."""

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return the values; none of an FMU, or of a run that was cut off."""
        facts = [event.what for event in ending.events]
        times = {what.quantity: what for what in facts if isinstance(what, WallTimes)}
        step = times.get("response", times.get("step"))
        if step is None:
            return {}
        return {
            "plant_step_time": step.median,
            "least_plant_step_time": step.least,
            "late_plant_step_time": step.late,
            "largest_plant_step_time": step.longest,
            "plant_jitter": times.get("interval", step).jitter,
            "plant_missed_ticks": sum(w.ticks for w in facts if isinstance(w, PlantTicksMissed)),
        }


PLANT_TIMING = MetricEntry(PlantTiming, "run", of=BlackBox, needs_truth=False)
