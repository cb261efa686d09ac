"""The events of a run: one record class per kind, with its level and its message.

A new kind is a class in a file of this folder, and a line here.

Offers: run.
"""

from typing import Any

from flexslew_plant.events.control import AnswerRepeated as AnswerRepeated
from flexslew_plant.events.control import ControllerTuned as ControllerTuned
from flexslew_plant.events.control import EstimateBegan as EstimateBegan
from flexslew_plant.events.control import EstimateDoubted as EstimateDoubted
from flexslew_plant.events.control import LimitSoftened as LimitSoftened
from flexslew_plant.events.control import PlanDrafted as PlanDrafted
from flexslew_plant.events.control import PlanOutdated as PlanOutdated
from flexslew_plant.events.control import PlanPublished as PlanPublished
from flexslew_plant.events.control import PlanRefused as PlanRefused
from flexslew_plant.events.control import StrayMessage as StrayMessage
from flexslew_plant.events.event import UNNAMED as UNNAMED
from flexslew_plant.events.event import Event as Event
from flexslew_plant.events.event import Fact as Fact
from flexslew_plant.events.event import Level as Level
from flexslew_plant.events.event import Other as Other
from flexslew_plant.events.event import checked, kinds
from flexslew_plant.events.event import event_of as event_of
from flexslew_plant.events.event import kind_of as kind_of
from flexslew_plant.events.event import level_of as level_of
from flexslew_plant.events.event import message_of as message_of
from flexslew_plant.events.event import too_long as too_long
from flexslew_plant.events.injections import DisturbanceChanged as DisturbanceChanged
from flexslew_plant.events.injections import FaultChanged as FaultChanged
from flexslew_plant.events.injections import FaultEndRequested as FaultEndRequested
from flexslew_plant.events.injections import InjectionRequested as InjectionRequested
from flexslew_plant.events.injections import TargetRequested as TargetRequested
from flexslew_plant.events.recording import RecorderBack as RecorderBack
from flexslew_plant.events.recording import RecorderLost as RecorderLost
from flexslew_plant.events.recording import RecordingEnded as RecordingEnded
from flexslew_plant.events.recording import RecordingStarted as RecordingStarted
from flexslew_plant.events.run import BentFar as BentFar
from flexslew_plant.events.run import CommandRejected as CommandRejected
from flexslew_plant.events.run import FastMode as FastMode
from flexslew_plant.events.run import FellBehind as FellBehind
from flexslew_plant.events.run import Interrupted as Interrupted
from flexslew_plant.events.run import Noted as Noted
from flexslew_plant.events.run import Paused as Paused
from flexslew_plant.events.run import RateChanged as RateChanged
from flexslew_plant.events.run import Resumed as Resumed
from flexslew_plant.events.run import RunFinished as RunFinished
from flexslew_plant.events.run import SecondPlant as SecondPlant
from flexslew_plant.events.run import Started as Started
from flexslew_plant.events.run import StateLost as StateLost
from flexslew_plant.events.run import Stepped as Stepped
from flexslew_plant.events.run import TransportChosen as TransportChosen
from flexslew_plant.events.run import WasReset as WasReset
from flexslew_plant.events.switching import BRAKE as BRAKE
from flexslew_plant.events.switching import AnswerMissed as AnswerMissed
from flexslew_plant.events.switching import BecameReady as BecameReady
from flexslew_plant.events.switching import BecameUnready as BecameUnready
from flexslew_plant.events.switching import BrakeLatched as BrakeLatched
from flexslew_plant.events.switching import BrakeReleased as BrakeReleased
from flexslew_plant.events.switching import BrakeRequested as BrakeRequested
from flexslew_plant.events.switching import BrakeTookOver as BrakeTookOver
from flexslew_plant.events.switching import FallbackTookOver as FallbackTookOver
from flexslew_plant.events.switching import SensorsImplausible as SensorsImplausible
from flexslew_plant.events.switching import SwitchDropped as SwitchDropped
from flexslew_plant.events.switching import Switched as Switched
from flexslew_plant.events.switching import SwitchRefused as SwitchRefused
from flexslew_plant.events.switching import SwitchRequested as SwitchRequested
from flexslew_plant.events.switching import largest as largest
from flexslew_plant.events.switching import step_words as step_words

# events after which another controller is active
IN_CHARGE = (Switched, FallbackTookOver, BrakeTookOver)
EVENTS: dict[str, type[Any]] = kinds()


def fact_of(kind: str, data: dict[str, Any]) -> Fact:
    """Return the record of an event of a log or topic; of an unknown kind as `Other`.

    Raises:
        BadInput: if its data do not match its kind; names key and value.
    """
    known = EVENTS.get(kind)
    return Other(kind, data) if known is None else checked(known, data)
