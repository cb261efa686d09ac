"""What changed a run: one type per kind of event, with its level, its data and its words.

A new kind is a class in a file of this folder and a line in the table.

Offers: run.
"""

from typing import Any

from flexslew_plant.events.control import (
    AnswerRepeated,
    ControllerTuned,
    EstimateBegan,
    EstimateDoubted,
    LimitSoftened,
    PlanDrafted,
    PlanPublished,
    PlanRefused,
    StrayMessage,
)
from flexslew_plant.events.event import (
    UNNAMED,
    Event,
    Fact,
    Level,
    Other,
    checked,
    event_of,
    too_long,
)
from flexslew_plant.events.injections import (
    DisturbanceChanged,
    FaultChanged,
    FaultEndRequested,
    InjectionRequested,
    TargetRequested,
)
from flexslew_plant.events.recording import (
    RecorderBack,
    RecorderLost,
    RecordingEnded,
    RecordingStarted,
)
from flexslew_plant.events.run import (
    BentFar,
    CommandRejected,
    FellBehind,
    Interrupted,
    Noted,
    Paused,
    RateChanged,
    Resumed,
    RunFinished,
    SecondPlant,
    Started,
    StateLost,
    Stepped,
    TransportChosen,
    TurnsFar,
    WasReset,
)
from flexslew_plant.events.switching import (
    AnswerMissed,
    BecameReady,
    BecameUnready,
    BrakeLatched,
    BrakeReleased,
    BrakeRequested,
    BrakeTookOver,
    FallbackTookOver,
    SensorsImplausible,
    SwitchDropped,
    Switched,
    SwitchRefused,
    SwitchRequested,
    largest,
    step_words,
)

__all__ = [
    "EVENTS",
    "IN_CHARGE",
    "UNNAMED",
    "AnswerMissed",
    "AnswerRepeated",
    "BecameReady",
    "BecameUnready",
    "BentFar",
    "BrakeLatched",
    "BrakeReleased",
    "BrakeRequested",
    "BrakeTookOver",
    "CommandRejected",
    "ControllerTuned",
    "DisturbanceChanged",
    "EstimateBegan",
    "EstimateDoubted",
    "Event",
    "Fact",
    "FallbackTookOver",
    "FaultChanged",
    "FaultEndRequested",
    "FellBehind",
    "InjectionRequested",
    "Interrupted",
    "Level",
    "LimitSoftened",
    "Noted",
    "Other",
    "Paused",
    "PlanDrafted",
    "PlanPublished",
    "PlanRefused",
    "RateChanged",
    "RecorderBack",
    "RecorderLost",
    "RecordingEnded",
    "RecordingStarted",
    "Resumed",
    "RunFinished",
    "SecondPlant",
    "SensorsImplausible",
    "Started",
    "StateLost",
    "Stepped",
    "StrayMessage",
    "SwitchDropped",
    "SwitchRefused",
    "SwitchRequested",
    "Switched",
    "TargetRequested",
    "TransportChosen",
    "TurnsFar",
    "WasReset",
    "event_of",
    "fact_of",
    "largest",
    "step_words",
    "too_long",
]

_KINDS: tuple[Any, ...] = (
    Started,
    Resumed,
    Paused,
    Stepped,
    WasReset,
    RateChanged,
    Noted,
    Interrupted,
    RunFinished,
    StateLost,
    BentFar,
    TurnsFar,
    FellBehind,
    CommandRejected,
    SecondPlant,
    TransportChosen,
    SwitchRequested,
    Switched,
    SwitchRefused,
    SwitchDropped,
    AnswerMissed,
    FallbackTookOver,
    BrakeTookOver,
    BrakeRequested,
    BrakeLatched,
    BrakeReleased,
    BecameUnready,
    BecameReady,
    SensorsImplausible,
    InjectionRequested,
    TargetRequested,
    FaultEndRequested,
    FaultChanged,
    DisturbanceChanged,
    RecordingStarted,
    RecordingEnded,
    RecorderLost,
    RecorderBack,
    ControllerTuned,
    EstimateBegan,
    EstimateDoubted,
    LimitSoftened,
    AnswerRepeated,
    PlanPublished,
    PlanDrafted,
    PlanRefused,
    StrayMessage,
)
# after which somebody else is in charge
IN_CHARGE = (Switched, FallbackTookOver, BrakeTookOver)
EVENTS: dict[str, type[Any]] = {fact.kind: fact for fact in _KINDS}


def fact_of(kind: str, data: dict[str, Any]) -> Fact:
    """Return what an event of this kind holds; of a kind that is not known here as it is.

    Raises:
        BadInput: its data is not what an event of its kind holds; names key and value.
    """
    known = EVENTS.get(kind)
    return Other(kind, data) if known is None else checked(known, data)
