"""The `schedule` section: what happens to the bench at which simulated time."""

from collections.abc import Sequence
from typing import Annotated, Any, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from flexslew_plant.arrays import Vector
from flexslew_plant.bench.requested_yaml import requested_yaml
from flexslew_plant.errors import BadInput
from flexslew_plant.faults import FaultSettings
from flexslew_plant.faults.actuators import CommandDelay
from flexslew_plant.hardware.disturbances import Disturbance
from flexslew_plant.joint_quantities import require_units_of_joints
from flexslew_plant.settings import section, validated
from flexslew_plant.testbeds import Testbed

_Time: TypeAlias = Annotated[float, Field(ge=0.0, le=1e12)]  # in ticks, too, a whole number


@section
class ScheduleEntry:
    """One entry: a switch at a time, or a disturbance or a fault from a time to another."""

    at: _Time  # simulated time, before the end of the run [s]
    until: _Time | None = None  # end of a disturbance or fault [s]; null: end of the run
    switch: str | None = None  # controller that takes charge
    # efforts on joints by name: constant [N m or N], sine or pulse
    disturbance: Disturbance | None = None
    fault: FaultSettings | None = None  # fault that begins; needs allow_faults: true
    # an appendage gets a new target: `appendage` and the keys of a motion of its hinge but for `at`
    retarget: dict[str, Any] | None = None

    @model_validator(mode="after")
    def _check_single_action(self) -> "ScheduleEntry":
        given = [
            x for x in (self.switch, self.disturbance, self.fault, self.retarget) if x is not None
        ]
        if len(given) != 1:
            raise ValueError("give exactly one of switch, disturbance, fault, retarget")
        if self.until is not None and (self.switch is not None or self.retarget is not None):
            raise ValueError("until is only for a disturbance or a fault")
        if self.until is not None and self.until <= self.at:
            raise ValueError("until must be later than at")
        return self


Schedule: TypeAlias = tuple[ScheduleEntry, ...]


def command_delay_ticks(schedule: Schedule, joints: Sequence[str], time: float) -> Vector:
    """Return by how many ticks commands are late at a time, shape (joints,)."""
    delay = np.zeros(len(joints))
    for entry in schedule:
        is_active = entry.at <= time < (np.inf if entry.until is None else entry.until)
        if is_active and isinstance(entry.fault, CommandDelay):
            delay += entry.fault.ticks * np.array([entry.fault.joint in (None, j) for j in joints])
    return delay


def require_allowed(schedule: Schedule, allowed: bool, source: str = "trial") -> None:
    """Check that the schedule breaks nothing unless it may.

    Raises:
        BadInput: the first fault that is not allowed.
    """
    for i, entry in enumerate(schedule):
        if entry.fault is not None and not allowed:
            raise BadInput(
                f"schedule.{i}.fault: {entry.fault.kind} is refused because faults are off; "
                "set allow_faults: true",
                source,
            )


def requested_entry(text: str, at: float, testbed: Testbed | None = None) -> ScheduleEntry:
    """Return the fault or disturbance that an operator requests as an entry of the schedule.

    Args:
        text: YAML, a fault (`{kind: command_lost, until: 30.0}`) or an entry without `at`
            (`{fault: {...}}`, `{disturbance: {...}, until: 30.0}`).
        at: when it begins [s].
        testbed: its joints determine the unit of each quantity; None: that of any joint.

    Raises:
        BadInput: the text is no YAML, see requested_yaml, or no fault and no disturbance; or a
            quantity is of another kind than its joint.
    """
    values: Any = requested_yaml(text, "fault")
    if not isinstance(values, dict):
        raise BadInput("fault: give YAML keys, for example {kind: command_lost, probability: 0.1}")
    if "kind" in values:
        until = {"until": values["until"]} if "until" in values else {}
        values = {"fault": {k: v for k, v in values.items() if k != "until"}, **until}
    entry: ScheduleEntry = validated(ScheduleEntry, {**values, "at": at}, "fault")
    if testbed is not None:
        require_units_of_joints(ScheduleEntry, values, testbed, "fault")
    if entry.switch is not None or entry.retarget is not None:
        raise BadInput("fault: for switch or retarget use switch_controller or retarget")
    return entry
