"""The active controllers of a run: switches, missed answers, faults and what took over."""

from collections.abc import Mapping
from typing import Any, ClassVar

from flexslew_lab.metrics.metric import Block, Ending, Key, MetricEntry, RunSetup
from flexslew_plant.events import (
    AnswerMissing,
    BrakeActivated,
    FallbackActivated,
    FaultChanged,
    Level,
    SwitchCompleted,
    largest,
)


class Takeovers:
    """Implements Metric; all of it is in the events."""

    KEYS: ClassVar[Mapping[str, Key]] = {
        "missed_ticks": Key("-", False, "ticks without a valid answer in time"),
        "switches": Key("-", False, "changes of the controller in charge that took effect"),
        "largest_effort_step": Key(
            "N m or N", False, "largest step of any effort at a switch; null: no switch"
        ),
        "faults": Key(
            "-",
            False,
            "faults that began, injected ones included; a fallback or the brake that takes over "
            "is one",
        ),
        "fallbacks": Key("-", False, "times that a fallback or the brake took over"),
    }

    def __init__(self, setup: RunSetup) -> None:
        pass

    def add(self, block: Block) -> None:
        """Take the next ticks."""

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return the five values."""
        facts = [event.what for event in ending.events]
        steps = [largest(what.effort_step) for what in facts if isinstance(what, SwitchCompleted)]
        fault_count = sum(isinstance(what, FaultChanged) and what.on for what in facts)
        return {
            "missed_ticks": sum(w.ticks or 1 for w in facts if isinstance(w, AnswerMissing)),
            "switches": len(steps),
            "largest_effort_step": max(steps, default=None),
            "faults": fault_count + sum(event.level is Level.FAULT for event in ending.events),
            "fallbacks": sum(isinstance(w, FallbackActivated | BrakeActivated) for w in facts),
        }


TAKEOVERS = MetricEntry(Takeovers, "controllers", needs_truth=False)
