"""Faults of the answers on their way to the drive."""

from typing import Literal

from flexslew_plant.faults.effects import (
    CommandStatus,
    Effect,
    FaultContext,
    FaultEntry,
    Names,
    OnAnyTestbed,
    Seed,
    Subject,
    Ticks,
)
from flexslew_plant.measurement import EffortCommand
from flexslew_plant.settings import Probability, section


@section
class CommandLost(OnAnyTestbed):
    """Answers vanish on their way to the drive: a missed tick each."""

    kind: Literal["command_lost"] = "command_lost"
    probability: Probability = 1.0  # of each tick [-]
    seed: Seed = 0  # in addition to the trial's

    def begin(self, context: FaultContext) -> Effect:
        """Return the effect on an answer."""
        return Effect(
            command_status=lambda _: (
                CommandStatus.LOST if context.happens(self.probability) else CommandStatus.ON_TIME
            )
        )


@section
class CommandLate(OnAnyTestbed):
    """Answers reach the drive after their tick is over: a missed tick and a stale answer each."""

    kind: Literal["command_late"] = "command_late"
    probability: Probability = 1.0  # of each tick [-]
    ticks: Ticks = 1  # how late
    seed: Seed = 0  # in addition to the trial's

    def begin(self, context: FaultContext) -> Effect:
        """Return the effect on an answer."""

        def command_status(command: EffortCommand) -> CommandStatus:
            if not context.happens(self.probability):
                return CommandStatus.ON_TIME
            context.delay_command(command, self.ticks, True)
            return CommandStatus.LATE

        return Effect(command_status=command_status)


@section
class CommandDuplicated(OnAnyTestbed):
    """Answers arrive in time, and a copy of each a tick later, which is rejected as stale."""

    kind: Literal["command_duplicated"] = "command_duplicated"
    probability: Probability = 1.0  # of each tick [-]
    seed: Seed = 0  # in addition to the trial's

    def begin(self, context: FaultContext) -> Effect:
        """Return the effect on an answer."""

        def command_status(command: EffortCommand) -> CommandStatus:
            if context.happens(self.probability):
                context.delay_command(command, 1, True)
            return CommandStatus.ON_TIME

        return Effect(command_status=command_status)


@section
class CommandReordered(OnAnyTestbed):
    """Answers are overtaken by their successor: a missed tick, then a stale answer after it."""

    kind: Literal["command_reordered"] = "command_reordered"
    probability: Probability = 1.0  # of each tick [-]
    seed: Seed = 0  # in addition to the trial's

    def begin(self, context: FaultContext) -> Effect:
        """Return the effect on an answer."""

        def command_status(command: EffortCommand) -> CommandStatus:
            if not context.happens(self.probability):
                return CommandStatus.ON_TIME
            context.delay_command(command, 1, False)
            return CommandStatus.OUT_OF_ORDER

        return Effect(command_status=command_status)


@section
class ControllerSilent:
    """No answer of a controller reaches the drive."""

    kind: Literal["controller_silent"] = "controller_silent"
    controller: str  # of the answers that are dropped

    def subject(self, names: Names) -> Subject | None:
        """Return the controller, if the names of all are known."""
        if not names.controllers:
            return None
        return Subject("controller", self.controller, names.controllers, where="there is")

    def begin(self, context: FaultContext) -> Effect:
        """Return the effect on an answer."""
        return Effect(
            command_status=lambda command: (
                CommandStatus.LOST
                if command.controller == self.controller
                else CommandStatus.ON_TIME
            )
        )


LOST = FaultEntry(CommandLost)
LATE = FaultEntry(CommandLate)
DUPLICATED = FaultEntry(CommandDuplicated)
REORDERED = FaultEntry(CommandReordered)
SILENT = FaultEntry(ControllerSilent)
