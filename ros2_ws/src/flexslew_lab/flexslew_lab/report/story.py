"""What an operator did to a run, as a story of its events."""

from collections.abc import Iterable
from typing import NamedTuple

from flexslew_lab.metrics.operator_changes import CHANGES, is_change
from flexslew_plant.events import (
    IN_CHARGE,
    BrakeLatched,
    BrakeReleased,
    ControllerNotReady,
    DisturbanceChanged,
    EstimateInconsistent,
    Event,
    FaultChanged,
    OperatorNote,
    PlanPublished,
    PlanRejected,
    PlantLost,
    RunFinished,
    RunStopped,
    Started,
    StateLost,
    SwitchRejected,
)

_STORY_EVENTS = (
    *CHANGES,
    *IN_CHARGE,
    Started,
    PlanPublished,
    PlanRejected,
    SwitchRejected,
    BrakeLatched,
    BrakeReleased,
    FaultChanged,
    DisturbanceChanged,
    ControllerNotReady,
    EstimateInconsistent,
    OperatorNote,
    PlantLost,
    StateLost,
    RunStopped,
    RunFinished,
)


class Line(NamedTuple):
    """One line of the story."""

    time: float  # simulated [s]
    who: str  # user that requested it; empty: it happened by itself
    words: str
    level: str
    changed: bool  # the motion, by an operator


def story_of(events: Iterable[Event]) -> list[Line]:
    """Return the events of the story, in their order."""
    return [
        Line(
            event.time,
            getattr(event.what, "who", None) or "",
            event.message,
            event.level.value,
            is_change(event),
        )
        for event in events
        if isinstance(event.what, _STORY_EVENTS)
    ]
