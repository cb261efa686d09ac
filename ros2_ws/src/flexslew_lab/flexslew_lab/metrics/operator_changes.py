"""How often an operator changed the motion of a run."""

from collections.abc import Iterable, Mapping
from typing import Any, ClassVar

from flexslew_lab.metrics.metric import Block, Ending, Key, MetricEntry, RunSetup
from flexslew_plant.events import (
    BrakeRequested,
    ControllerTuned,
    Event,
    FaultEndRequested,
    InjectionRequested,
    PlanPublished,
    SwitchRequested,
    TargetRequested,
    WasReset,
)

# Requests of an operator that change the motion; entries of the schedule have no such event
CHANGES = (
    SwitchRequested,
    InjectionRequested,
    FaultEndRequested,
    BrakeRequested,
    TargetRequested,
    ControllerTuned,
    WasReset,
)


def changes_of(events: Iterable[Event]) -> list[Event]:
    """Return the events with which an operator changed the motion, in their order."""
    return [event for event in events if is_change(event)]


def is_change(event: Event) -> bool:
    """Return whether an operator has changed the motion; the plan of tick 0 is the trial's own."""
    if isinstance(event.what, PlanPublished):
        return event.tick > 0
    return isinstance(event.what, CHANGES)


class OperatorChanges:
    """Implements Metric; all of it is in the events."""

    KEYS: ClassVar[Mapping[str, Key]] = {
        "operator_changes": Key(
            "-",
            False,
            "how often an operator changed the motion: switches, tunings, plans, injections, "
            "targets, the brake, a reset",
        ),
    }

    def __init__(self, setup: RunSetup) -> None:
        pass

    def add(self, block: Block) -> None:
        """Take the next ticks."""

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return their number."""
        return {"operator_changes": len(changes_of(ending.events))}


OPERATOR_CHANGES = MetricEntry(OperatorChanges, "controllers", needs_truth=False)
