"""Faults of the motors."""

from math import ceil, nan
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from flexslew_plant.arrays import Vector, called
from flexslew_plant.faults.effects import FaultEntry, Names, Subject
from flexslew_plant.faults.steps import FaultAction, Where, entries
from flexslew_plant.settings import section

MOST_TICKS = 10_000.0  # by which commands may be late


@called
def stuck_effort(numbers: Vector, memory: Vector, since: int, value: float) -> float:
    """Return the effort of a stuck motor: u = u_stuck, or the last one before the fault.

    Args:
        numbers: u_stuck [N m or N]; NaN: the last one before.
        memory: the last effort before the fault [N m or N].
        since: ticks since the fault began.
        value: effort of a healthy motor [N m or N].
    """
    return float(memory[0] if np.isnan(numbers[0]) else numbers[0])


@called
def scaled_demand(numbers: Vector, memory: Vector, since: int, value: float) -> float:
    """Return the demand that a motor receives as another one: g u.

    Args:
        numbers: g [-].
        memory: none.
        since: ticks since the fault began.
        value: u [N m or N].
    """
    return float(value * numbers[0])


@called
def delayed_demand(numbers: Vector, memory: Vector, since: int, value: float) -> float:
    """Return the mean of a demand that is d + p ticks late: (1 - p) u[k - d] + p u[k - d - 1].

    Args:
        numbers: d + p, with whole d and 0 <= p < 1 [ticks].
        memory: demands of the last ceil(d + p) ticks, written round and round [N m or N].
        since: ticks since the fault began.
        value: u[k] [N m or N].
    """
    part, place = numbers[0] % 1.0, since % memory.size
    previous = memory[place]
    memory[place] = value
    if part > 0.0:
        return float((1.0 - part) * memory[(since + 1) % memory.size] + part * previous)
    return float(previous)


@section
class ActuatorStuck:
    """A motor holds one effort whatever the demand is, within its limit."""

    kind: Literal["actuator_stuck"] = "actuator_stuck"
    joint: str  # of the motor
    effort: float | None = None  # [N m or N]; null: the last one before the fault

    def subject(self, names: Names) -> Subject:
        """Return the joint, and the effort that it is to give."""
        return Subject("joint", self.joint, names.joints, self.effort)

    def action(self, names: Names) -> FaultAction:
        """Return the action on what the motor gives."""
        number = nan if self.effort is None else self.effort
        return FaultAction(Where.EFFORT, *entries(names.joints, self.joint), (number,), memory=1)


@section
class ActuatorGain:
    """A motor gives a multiple of the demand, within its limit."""

    kind: Literal["actuator_gain"] = "actuator_gain"
    joint: str  # of the motor
    gain: float  # [-]; 1 is healthy, 0 is dead, -1 is wired the wrong way round

    def subject(self, names: Names) -> Subject:
        """Return the joint."""
        return Subject("joint", self.joint, names.joints)

    def action(self, names: Names) -> FaultAction:
        """Return the action on what reaches the motor."""
        return FaultAction(Where.DEMAND, *entries(names.joints, self.joint), (self.gain,))


@section
class CommandDelay:
    """Efforts reach the motors some ticks after the drive has let them go; it does not notice.

    Within a tick the motors hold one effort: a delay by a part of a tick gives its exact mean.
    """

    kind: Literal["command_delay"] = "command_delay"
    ticks: Annotated[float, Field(gt=0.0, le=MOST_TICKS)]  # whole ones and parts
    joint: str | None = None  # of the motor; null: every one

    def subject(self, names: Names) -> Subject | None:
        """Return the joint, where it is about one."""
        return None if self.joint is None else Subject("joint", self.joint, names.joints)

    def action(self, names: Names) -> FaultAction:
        """Return the action on what reaches the motors."""
        selected = entries(names.joints, self.joint)
        return FaultAction(Where.LATE, *selected, (self.ticks,), memory=ceil(self.ticks))


STUCK = FaultEntry(ActuatorStuck, step=stuck_effort)
GAIN = FaultEntry(ActuatorGain, {"gain": 0.5}, scaled_demand)
DELAY = FaultEntry(CommandDelay, {"ticks": 2}, delayed_demand)
