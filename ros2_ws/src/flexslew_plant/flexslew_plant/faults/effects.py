"""The contract of a fault: a section of the schedule, and what it does while it acts.

One that changes single readings, demands or efforts has a step, see `steps`; batches fly it, too.
Any other one begins an Effect: functions in Python, which only the bench calls.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Annotated, Any, NamedTuple, Protocol

from pydantic import Field

from flexslew_plant.arrays import Vector
from flexslew_plant.entries import default_of
from flexslew_plant.faults.steps import FaultAction, FaultStep
from flexslew_plant.hardware.sensors import Readings
from flexslew_plant.measurement import EffortCommand

Ticks = Annotated[int, Field(ge=1, le=10_000)]
Seed = Annotated[int, Field(ge=0)]


class CommandStatus(Enum):
    """What becomes of an answer on its way to the drive."""

    ON_TIME = "arrives"
    LOST = "lost"
    LATE = "late"
    OUT_OF_ORDER = "overtaken"


class Names(NamedTuple):
    """What a fault can be about on one testbed."""

    joints: tuple[str, ...]
    appendages: tuple[str, ...]
    limits: tuple[float, ...]  # of the effort of each joint [N m or N]
    one_way: tuple[int, ...] = ()  # which joints are pushed in their positive direction alone
    controllers: tuple[str, ...] = ()  # that there are; none: not known

    def of(self, channel: str) -> tuple[str, ...]:
        """Return the joints or appendages that have a sensor of this channel."""
        return self.joints if channel.startswith("joint") else self.appendages


class Subject(NamedTuple):
    """What a fault is about: the key and the name in its section, and the names that there are."""

    key: str
    name: str
    known: tuple[str, ...]
    effort: float | None = None  # that the joint gives, within its limit [N m or N]
    where: str = "the testbed has"  # of what is unknown: "... no NAME"


class OnAnyTestbed:
    """What the faults share that name nothing of a testbed."""

    def subject(self, names: Names) -> None:
        """Nothing that a testbed could lack."""


@dataclass
class FaultContext:
    """What a fault sees of the bench while it acts.

    Args:
        names: joints and appendages of the testbed.
        happens: draws whether an event of this probability occurs now.
        delay_command: hands an answer to the drive some ticks later, before or after that tick's
            own answer.
        demand, effort: last demand on the motors, and the effort that they gave, (joints,).
        since: returns the ticks since the fault began.
    """

    names: Names
    happens: Callable[[float], bool]
    delay_command: Callable[[EffortCommand, int, bool], None]
    demand: Vector
    effort: Vector
    since: Callable[[], int]


class Effect(NamedTuple):
    """What a fault does while it acts: only what is given."""

    read: Callable[[Readings], Readings] | None = None  # readings of the measurement
    command_status: Callable[[EffortCommand], CommandStatus] | None = (
        None  # what becomes of an answer
    )
    late: Callable[[Vector], Vector] | None = None  # what arrives of what the drive lets go
    demand: Callable[[Vector], Vector] | None = None  # what the motors take a demand for
    effort: Callable[[Vector], Vector] | None = None  # what the motors give of an effort


class Fault(Protocol):
    """A section `fault` of a schedule entry."""

    kind: Any

    def subject(self, names: Names) -> Subject | None:
        """Return what it is about by name; None: nothing that a testbed could lack."""


class FaultWithStep(Fault, Protocol):
    """A fault with a step in its entry."""

    def action(self, names: Names) -> FaultAction:
        """Return where the step acts on a testbed, and its numbers."""


class FaultWithEffect(Fault, Protocol):
    """A fault without a step."""

    def begin(self, context: FaultContext) -> Effect:
        """Return what it does from now on, until it ends."""


@dataclass(frozen=True)
class FaultEntry:
    """A fault, as the rest of the bench uses it.

    Args:
        settings: its section, a FaultWithStep or FaultWithEffect; the default of `kind` is its
            name.
        example: the keys that it cannot do without, apart from names of the testbed.
        step: that it takes for each entry and tick; None: its section has `begin`.
    """

    settings: type[Any]
    example: Mapping[str, Any] = field(default_factory=dict)
    step: FaultStep | None = None

    @property
    def name(self) -> str:
        """What `fault.kind` calls it."""
        return default_of(self.settings, "kind")
