"""The faults: what can break. A new one is a file that ends in its entry, and a line here.

Offers: actuators, chance, commands, dispatch, effects, injection, steps.
"""

from typing import TYPE_CHECKING, Annotated, NamedTuple, TypeAlias

from pydantic import Field

from flexslew_plant.entries import table, union
from flexslew_plant.errors import BadInput
from flexslew_plant.faults.effects import Fault as Fault
from flexslew_plant.faults.effects import FaultEntry as FaultEntry
from flexslew_plant.faults.effects import Names as Names

# isort: split
# the faults, a line each
from flexslew_plant.faults.actuators import DELAY as DELAY
from flexslew_plant.faults.actuators import GAIN as GAIN
from flexslew_plant.faults.actuators import STUCK as STUCK
from flexslew_plant.faults.commands import DUPLICATED as DUPLICATED
from flexslew_plant.faults.commands import LATE as LATE
from flexslew_plant.faults.commands import LOST as LOST
from flexslew_plant.faults.commands import REORDERED as REORDERED
from flexslew_plant.faults.commands import SILENT as SILENT
from flexslew_plant.faults.sensors import BIAS as BIAS
from flexslew_plant.faults.sensors import DROPOUT as DROPOUT
from flexslew_plant.faults.sensors import FREEZE as FREEZE
from flexslew_plant.faults.sensors import NAN as NAN

FAULTS: dict[str, FaultEntry] = table(globals(), FaultEntry)

if TYPE_CHECKING:
    FaultSettings: TypeAlias = Fault
else:
    FaultSettings = Annotated[
        union(entry.settings for entry in FAULTS.values()), Field(discriminator="kind")
    ]


def check_fault(fault: Fault, names: Names, place: str) -> None:
    """Check that the testbed has what the fault is about.

    Args:
        fault: from a trial file or an operator.
        names: of the testbed.
        place: where the fault stands, for the error.

    Raises:
        BadInput: an unknown joint, appendage or controller, with the known ones; an effort beyond
            the limit, or against the direction in which alone a thruster pushes.
    """
    subject = fault.subject(names)
    if subject is not None and subject.name not in subject.known:
        known = ", ".join(subject.known)
        raise BadInput(
            f"{place}.{subject.key}: {subject.where} no {subject.name}; allowed: {known}"
        )
    if subject is not None and subject.effort is not None:
        k = names.joints.index(subject.name)
        most = names.limits[k]
        if k in names.one_way and subject.effort < 0.0:
            words = f"{subject.name} is a thruster, which pushes one way: at least 0"
            raise BadInput(words, key=f"{place}.effort", value=subject.effort)
        if not abs(subject.effort) <= most:
            words = f"{subject.name} gives at most {most:g}, its effort limit"
            raise BadInput(words, key=f"{place}.effort", value=subject.effort)


class Timed(NamedTuple):
    """A fault and when it acts."""

    fault: Fault
    start: int  # first tick
    end: float  # first tick after it; infinite: to the end of the run
