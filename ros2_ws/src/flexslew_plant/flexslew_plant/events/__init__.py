"""The events of a run: one record class per kind, with its level and its message.

A new kind is a class in a file of this folder, and a line here.

Offers: run.
"""

from typing import Any

from flexslew_plant.events.control import AnswerRepeated as AnswerRepeated
from flexslew_plant.events.control import ControllerTuned as ControllerTuned
from flexslew_plant.events.control import EstimateInconsistent as EstimateInconsistent
from flexslew_plant.events.control import EstimateStarted as EstimateStarted
from flexslew_plant.events.control import LimitViolation as LimitViolation
from flexslew_plant.events.control import PlanDrafted as PlanDrafted
from flexslew_plant.events.control import PlanOutdated as PlanOutdated
from flexslew_plant.events.control import PlanPublished as PlanPublished
from flexslew_plant.events.control import PlanRejected as PlanRejected
from flexslew_plant.events.control import UnexpectedMessage as UnexpectedMessage
from flexslew_plant.events.event import NO_NAME as NO_NAME
from flexslew_plant.events.event import Event as Event
from flexslew_plant.events.event import Fact as Fact
from flexslew_plant.events.event import Level as Level
from flexslew_plant.events.event import Other as Other
from flexslew_plant.events.event import checked, kinds
from flexslew_plant.events.event import event_of as event_of
from flexslew_plant.events.event import is_reported as is_reported
from flexslew_plant.events.event import kind_of as kind_of
from flexslew_plant.events.event import level_of as level_of
from flexslew_plant.events.event import message_of as message_of
from flexslew_plant.events.event import too_long as too_long
from flexslew_plant.events.injections import DisturbanceChanged as DisturbanceChanged
from flexslew_plant.events.injections import FaultChanged as FaultChanged
from flexslew_plant.events.injections import FaultEndRequested as FaultEndRequested
from flexslew_plant.events.injections import InjectionRequested as InjectionRequested
from flexslew_plant.events.injections import TargetRequested as TargetRequested
from flexslew_plant.events.recording import RecorderActive as RecorderActive
from flexslew_plant.events.recording import RecorderLost as RecorderLost
from flexslew_plant.events.recording import RecordingEnded as RecordingEnded
from flexslew_plant.events.recording import RecordingStarted as RecordingStarted
from flexslew_plant.events.run import CommandRejected as CommandRejected
from flexslew_plant.events.run import FastMode as FastMode
from flexslew_plant.events.run import LargeDeflection as LargeDeflection
from flexslew_plant.events.run import OperatorNote as OperatorNote
from flexslew_plant.events.run import Paused as Paused
from flexslew_plant.events.run import PlantLost as PlantLost
from flexslew_plant.events.run import PlantTicksMissed as PlantTicksMissed
from flexslew_plant.events.run import RateChanged as RateChanged
from flexslew_plant.events.run import Resumed as Resumed
from flexslew_plant.events.run import RunFinished as RunFinished
from flexslew_plant.events.run import RunStopped as RunStopped
from flexslew_plant.events.run import ScheduleShifted as ScheduleShifted
from flexslew_plant.events.run import SecondPlant as SecondPlant
from flexslew_plant.events.run import Started as Started
from flexslew_plant.events.run import StateLost as StateLost
from flexslew_plant.events.run import StepsRequested as StepsRequested
from flexslew_plant.events.run import TransportChosen as TransportChosen
from flexslew_plant.events.run import WallTimes as WallTimes
from flexslew_plant.events.run import WasReset as WasReset
from flexslew_plant.events.switching import BRAKE as BRAKE
from flexslew_plant.events.switching import AnswerMissing as AnswerMissing
from flexslew_plant.events.switching import BrakeActivated as BrakeActivated
from flexslew_plant.events.switching import BrakeLatched as BrakeLatched
from flexslew_plant.events.switching import BrakeReleased as BrakeReleased
from flexslew_plant.events.switching import BrakeRequested as BrakeRequested
from flexslew_plant.events.switching import ControllerNotReady as ControllerNotReady
from flexslew_plant.events.switching import ControllerReady as ControllerReady
from flexslew_plant.events.switching import FallbackActivated as FallbackActivated
from flexslew_plant.events.switching import SensorsInconsistent as SensorsInconsistent
from flexslew_plant.events.switching import SwitchCompleted as SwitchCompleted
from flexslew_plant.events.switching import SwitchDropped as SwitchDropped
from flexslew_plant.events.switching import SwitchRejected as SwitchRejected
from flexslew_plant.events.switching import SwitchRequested as SwitchRequested
from flexslew_plant.events.switching import largest as largest
from flexslew_plant.events.switching import step_words as step_words

# events after which another controller is active
IN_CHARGE = (SwitchCompleted, FallbackActivated, BrakeActivated)
EVENTS: dict[str, type[Any]] = kinds()


def fact_of(kind: str, data: dict[str, Any]) -> Fact:
    """Return the record of an event of a log or topic; of an unknown kind as `Other`.

    Raises:
        BadInput: if its data do not match its kind; names key and value.
    """
    known = EVENTS.get(kind)
    return Other(kind, data) if known is None else checked(known, data)
