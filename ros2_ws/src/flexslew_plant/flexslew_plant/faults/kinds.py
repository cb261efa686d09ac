"""The `fault` of a schedule entry: what can break on the bench, one section a kind."""

from typing import Annotated, Literal, NamedTuple, TypeAlias

from pydantic import Field

from flexslew_plant.errors import BadInput
from flexslew_plant.settings import Probability, section

ChannelName: TypeAlias = Literal[
    "joint_position", "joint_velocity", "tip_deflection", "root_curvature"
]
Ticks = Annotated[int, Field(ge=1, le=10_000)]
Seed = Annotated[int, Field(ge=0)]


@section
class ActuatorStuck:
    """A motor holds one effort whatever it is asked for."""

    kind: Literal["actuator_stuck"] = "actuator_stuck"
    joint: str
    effort: float | None = None  # [N m or N]; null: the last one before the fault


@section
class ActuatorGain:
    """A motor gives a multiple of what it is asked for, within its limit."""

    kind: Literal["actuator_gain"] = "actuator_gain"
    joint: str
    gain: float  # [-]; 1 is healthy, 0 is dead, -1 is wired the wrong way round


@section
class CommandDelay:
    """Every effort reaches the motors some ticks after the drive has let it go."""

    kind: Literal["command_delay"] = "command_delay"
    ticks: Ticks


@section
class CommandLost:
    """Answers vanish on their way to the drive: a missed tick each."""

    kind: Literal["command_lost"] = "command_lost"
    probability: Probability = 1.0  # of each tick
    seed: Seed = 0  # beside the trial's


@section
class CommandLate:
    """Answers reach the drive after their tick is over: a missed tick and a stale answer each."""

    kind: Literal["command_late"] = "command_late"
    probability: Probability = 1.0
    ticks: Ticks = 1  # how late
    seed: Seed = 0


@section
class CommandDuplicated:
    """Answers arrive in time, and a copy of each a tick later."""

    kind: Literal["command_duplicated"] = "command_duplicated"
    probability: Probability = 1.0
    seed: Seed = 0


@section
class CommandReordered:
    """Answers are overtaken by their successor: a missed tick, then a stale answer behind it."""

    kind: Literal["command_reordered"] = "command_reordered"
    probability: Probability = 1.0
    seed: Seed = 0


@section
class ControllerSilent:
    """Nothing that a controller says is heard any more."""

    kind: Literal["controller_silent"] = "controller_silent"
    controller: str


@section
class SensorDropout:
    """Sensors read zero, each tick with a probability."""

    kind: Literal["sensor_dropout"] = "sensor_dropout"
    channel: ChannelName
    of: str | None = None  # joint or appendage; null: every one of the channel
    probability: Probability = 1.0
    seed: Seed = 0


@section
class SensorBias:
    """Sensors read too much by a constant."""

    kind: Literal["sensor_bias"] = "sensor_bias"
    channel: ChannelName
    of: str | None = None
    bias: float  # in the unit of the channel


@section
class SensorFreeze:
    """Sensors repeat what they read when the fault set in."""

    kind: Literal["sensor_freeze"] = "sensor_freeze"
    channel: ChannelName
    of: str | None = None


@section
class SensorNan:
    """Sensors read no number."""

    kind: Literal["sensor_nan"] = "sensor_nan"
    channel: ChannelName
    of: str | None = None


ActuatorFault: TypeAlias = ActuatorStuck | ActuatorGain
CommandFault: TypeAlias = CommandLost | CommandLate | CommandDuplicated | CommandReordered
SensorFault: TypeAlias = SensorDropout | SensorBias | SensorFreeze | SensorNan
Fault: TypeAlias = Annotated[
    ActuatorFault | CommandDelay | CommandFault | ControllerSilent | SensorFault,
    Field(discriminator="kind"),
]


class Names(NamedTuple):
    """What a fault can be about on one testbed."""

    joints: tuple[str, ...]
    appendages: tuple[str, ...]

    def of(self, channel: ChannelName) -> tuple[str, ...]:
        """Return who has a sensor of this channel."""
        return self.joints if channel.startswith("joint") else self.appendages


def check_fault(fault: Fault, names: Names, place: str) -> None:
    """Check that the testbed has what the fault is about.

    Args:
        fault: from a trial file or an operator.
        names: of the testbed.
        place: where the fault stands, for the error.

    Raises:
        BadInput: an unknown joint or appendage, with the known ones.
    """
    if isinstance(fault, ActuatorFault):
        key, name, known = "joint", fault.joint, names.joints
    elif isinstance(fault, SensorFault) and fault.of is not None:
        key, name, known = "of", fault.of, names.of(fault.channel)
    else:
        return
    if name not in known:
        raise BadInput(f"{place}.{key}: the testbed has no {name}; allowed: {', '.join(known)}")


class Timed(NamedTuple):
    """A fault and when it acts."""

    fault: Fault
    start: int  # first tick
    end: float  # first tick after it; infinite: to the end of the run
