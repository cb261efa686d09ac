"""The faults: what can break on the bench. A new one is a section in a file, and a line here."""

from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeAlias

from pydantic import Field

from flexslew_plant.errors import BadInput
from flexslew_plant.faults.actuators import ActuatorGain, ActuatorStuck, CommandDelay
from flexslew_plant.faults.commands import (
    CommandDuplicated,
    CommandLate,
    CommandLost,
    CommandReordered,
    ControllerSilent,
)
from flexslew_plant.faults.effects import Fault as Fault
from flexslew_plant.faults.effects import Names as Names
from flexslew_plant.faults.sensors import SensorBias, SensorDropout, SensorFreeze, SensorNan

FAULTS: dict[str, type[Any]] = {
    "actuator_stuck": ActuatorStuck,
    "actuator_gain": ActuatorGain,
    "command_delay": CommandDelay,
    "command_lost": CommandLost,
    "command_late": CommandLate,
    "command_duplicated": CommandDuplicated,
    "command_reordered": CommandReordered,
    "controller_silent": ControllerSilent,
    "sensor_dropout": SensorDropout,
    "sensor_bias": SensorBias,
    "sensor_freeze": SensorFreeze,
    "sensor_nan": SensorNan,
}

if TYPE_CHECKING:
    FaultSettings: TypeAlias = Fault
else:
    _union = FAULTS["actuator_stuck"]
    for _kind in FAULTS.values():
        _union = _union | _kind
    FaultSettings = Annotated[_union, Field(discriminator="kind")]


def check_fault(fault: Fault, names: Names, place: str) -> None:
    """Check that the testbed has what the fault is about.

    Args:
        fault: from a trial file or an operator.
        names: of the testbed.
        place: where the fault stands, for the error.

    Raises:
        BadInput: an unknown joint or appendage, with the known ones.
    """
    about = fault.subject(names)
    if about is not None and about.name not in about.known:
        known = ", ".join(about.known)
        raise BadInput(f"{place}.{about.key}: the testbed has no {about.name}; allowed: {known}")


class Timed(NamedTuple):
    """A fault and when it acts."""

    fault: Fault
    start: int  # first tick
    end: float  # first tick after it; infinite: to the end of the run
