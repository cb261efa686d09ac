"""Faults of the motors."""

from collections import deque
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from flexslew_plant.arrays import Vector
from flexslew_plant.faults.effects import (
    Effect,
    FaultContext,
    FaultEntry,
    Names,
    Subject,
)
from flexslew_plant.settings import section

MOST_TICKS = 10_000.0  # by which commands may be late


@section
class ActuatorStuck:
    """A motor holds one effort whatever it is asked for, within its limit."""

    kind: Literal["actuator_stuck"] = "actuator_stuck"
    joint: str  # whose motor
    effort: float | None = None  # [N m or N]; null: the last one before the fault

    def subject(self, names: Names) -> Subject:
        """Return the joint, and the effort that it is to give."""
        return Subject("joint", self.joint, names.joints, self.effort)

    def begin(self, context: FaultContext) -> Effect:
        """Return the effect on what the motors give."""
        k = context.names.joints.index(self.joint)

        def effort(given: Vector) -> Vector:
            stuck = given.copy()
            stuck[k] = context.effort[k] if self.effort is None else self.effort
            return stuck

        return Effect(effort=effort)


@section
class ActuatorGain:
    """A motor gives a multiple of what it is asked for, within its limit."""

    kind: Literal["actuator_gain"] = "actuator_gain"
    joint: str  # whose motor
    gain: float  # [-]; 1 is healthy, 0 is dead, -1 is wired the wrong way round

    def subject(self, names: Names) -> Subject:
        """Return the joint."""
        return Subject("joint", self.joint, names.joints)

    def begin(self, context: FaultContext) -> Effect:
        """Return the effect on what reaches the motors."""
        share = np.ones(len(context.names.joints))
        share[context.names.joints.index(self.joint)] = self.gain
        return Effect(demand=lambda demand: demand * share)


@section
class CommandDelay:
    """Efforts reach the motors some ticks after the drive has let them go; it does not notice.

    Within a tick the motors hold one effort: a delay by a part of a tick gives its exact mean.
    """

    kind: Literal["command_delay"] = "command_delay"
    ticks: Annotated[float, Field(gt=0.0, le=MOST_TICKS)]  # whole ones and parts
    joint: str | None = None  # whose; null: every one

    def subject(self, names: Names) -> Subject | None:
        """Return the joint, where it is about one."""
        return None if self.joint is None else Subject("joint", self.joint, names.joints)

    def begin(self, context: FaultContext) -> Effect:
        """Return the effect on what reaches the motors."""
        whole, part = int(self.ticks // 1.0), self.ticks % 1.0
        chosen = np.array([self.joint in (None, name) for name in context.names.joints])
        queue = deque([context.demand] * (whole + (part > 0.0)))

        def late_one(asked: Vector) -> Vector:
            queue.append(asked)
            oldest = queue.popleft()
            delayed = (1.0 - part) * queue[0] + part * oldest if part else oldest
            return delayed if self.joint is None else np.where(chosen, delayed, asked)

        return Effect(late=late_one)


STUCK = FaultEntry(ActuatorStuck)
GAIN = FaultEntry(ActuatorGain, {"gain": 0.5})
DELAY = FaultEntry(CommandDelay, {"ticks": 2})
