"""What an operator did to a run, as a story of its events."""

from collections.abc import Iterable
from typing import NamedTuple

from flexslew_plant.events import (
    IN_CHARGE,
    BecameUnready,
    BrakeLatched,
    BrakeReleased,
    BrakeRequested,
    ControllerTuned,
    DisturbanceChanged,
    EstimateDoubted,
    Event,
    FaultChanged,
    FaultEndRequested,
    InjectionRequested,
    Interrupted,
    Noted,
    PlanPublished,
    PlanRefused,
    RunFinished,
    Started,
    StateLost,
    SwitchRefused,
    SwitchRequested,
    TargetRequested,
    WasReset,
)

# What an operator asks for that changes the motion; what the schedule brings has no such event
_CHANGES = (
    SwitchRequested,
    InjectionRequested,
    FaultEndRequested,
    BrakeRequested,
    TargetRequested,
    ControllerTuned,
    WasReset,
)
_TOLD = (
    *_CHANGES,
    *IN_CHARGE,
    Started,
    PlanPublished,
    PlanRefused,
    SwitchRefused,
    BrakeLatched,
    BrakeReleased,
    FaultChanged,
    DisturbanceChanged,
    BecameUnready,
    EstimateDoubted,
    Noted,
    StateLost,
    Interrupted,
    RunFinished,
)


class Line(NamedTuple):
    """One line of the story."""

    time: float  # simulated [s]
    who: str  # asked for it; empty: it happened by itself
    words: str
    level: str
    changed: bool  # the motion, by an operator


def changes_of(events: Iterable[Event]) -> list[Event]:
    """Return the events with which an operator changed the motion, in their order."""
    return [event for event in events if _is_change(event)]


def story_of(events: Iterable[Event]) -> list[Line]:
    """Return the events that tell what happened, in their order."""
    return [
        Line(
            event.time,
            getattr(event.what, "who", None) or "",
            event.message,
            event.level.value,
            _is_change(event),
        )
        for event in events
        if isinstance(event.what, _TOLD)
    ]


def _is_change(event: Event) -> bool:
    """Return whether an operator has changed the motion; the plan of tick 0 is the trial's own."""
    if isinstance(event.what, PlanPublished):
        return event.tick > 0
    return isinstance(event.what, _CHANGES)
