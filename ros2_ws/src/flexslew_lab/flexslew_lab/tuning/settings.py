"""The sections of a tuning file."""

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Field

from flexslew_plant.settings import NonNegative, Positive, section

Place: TypeAlias = Literal["efforts", "sensors"]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]+$")]


@section
class MarginGoal:
    """A disk margin with all channels of a place changing at once."""

    goal: Literal["margin"]
    disk: Positive  # size of the symmetric disk, 2 tan(phase / 2) or 2 (gain - 1) / (gain + 1) [-]
    at: Place = "efforts"  # where the loop is cut
    channels: tuple[str, ...] = ()  # joints, or sensors as `position.JOINT`; none: all of the loop
    hard: bool = True  # whether it must be met before soft goals count


@section
class BandwidthGoal:
    """A loop gain above frequency / w at every w below the frequency."""

    goal: Literal["bandwidth"]
    frequency: Positive  # where the loop gain is one at least [rad/s]
    at: Place = "efforts"  # where the loop is cut
    channels: tuple[str, ...] = ()  # as those of a margin
    hard: bool = True  # whether it must be met before soft goals count


@section
class RollOffGoal:
    """A complementary sensitivity below (frequency / w)^slope above the frequency."""

    goal: Literal["roll_off"]
    frequency: Positive  # from which it falls [rad/s]
    slope: Annotated[int, Field(ge=1, le=3)] = 1  # powers of the frequency [-]
    at: Place = "efforts"  # where the loop is cut
    channels: tuple[str, ...] = ()  # as those of a margin
    hard: bool = True  # whether it must be met before soft goals count


@section
class GainGoal:
    """A largest gain between signals: rejection of disturbances, effort, noise."""

    goal: Literal["gain"]
    # `disturbance.JOINT`, `noise.SENSOR`, `reference.JOINT`
    source: Annotated[tuple[str, ...], Field(min_length=1)]
    # `effort.JOINT`, `error.JOINT`, or a sensor, as `position.JOINT`, `tip.APPENDAGE`
    to: Annotated[tuple[str, ...], Field(min_length=1)]
    below: Positive  # in the unit of `to` per unit of `source`
    # peak: largest over all frequencies; rms: of the output to white noise of one unit in a tick
    norm: Literal["peak", "rms"] = "peak"
    corner: Positive | None = None  # below it the bound falls with the frequency [rad/s]
    hard: bool = True  # whether it must be met before soft goals count


@section
class TrackingGoal:
    """A tracking error that is small below the bandwidth of a response time."""

    goal: Literal["tracking"]
    joints: Annotated[tuple[str, ...], Field(min_length=1)]  # whose references are tracked
    time: Positive  # in which the joint responds: the bandwidth is 2 / time [s]
    steady: Positive = 0.01  # largest error of a constant reference, of the reference [-]
    peak: Positive = 1.5  # largest error at any frequency, of the reference [-]
    hard: bool = True  # whether it must be met before soft goals count


@section
class PoleGoal:
    """A region for the poles of the closed loop."""

    goal: Literal["poles"]
    decay: Positive | None = None  # smallest decay rate of a pole [1/s]
    damping: Annotated[float, Field(gt=0.0, lt=1.0)] | None = None  # smallest damping ratio [-]
    hard: bool = True  # whether it must be met before soft goals count


Goal: TypeAlias = Annotated[
    MarginGoal | BandwidthGoal | RollOffGoal | GainGoal | TrackingGoal | PoleGoal,
    Field(discriminator="goal"),
]


@section
class StateSpaceBlock:
    """A controller of fixed order, in real tridiagonal form, for the law `linear`."""

    kind: Literal["state_space"]
    order: Annotated[int, Field(ge=0, le=30)]  # number of states
    # signal, or a sum as `position.mass + tip.spring`, to a typical size in the unit of the signal
    inputs: Annotated[dict[str, Positive], Field(min_length=1)]
    # `effort.JOINT` to a typical size [N m or N]
    outputs: Annotated[dict[str, Positive], Field(min_length=1)]
    speed: Positive = 1.0  # typical bandwidth, the scale of its poles [rad/s]
    direct: bool = True  # whether it has a direct path D


@section
class NotchFilter:
    """A notch (s^2 + 2 z w s + w^2) / (s^2 + 2 p w s + w^2) in series."""

    frequency: Positive  # start of w [rad/s]
    zeros: Positive = 0.05  # start of the damping ratio z of its zeros [-]
    poles: Positive = 0.5  # start of the damping ratio p of its poles [-]


@section
class PidLoop:
    """A PID with a filtered derivative, and notches in series, from one signal to one effort."""

    input: str  # `error.JOINT`, or another signal of the law `linear`
    kp: Positive  # start of the proportional gain, in the unit of the effort per that of the signal
    ki: NonNegative = 0.0  # start of the integral gain, per second; 0: none
    kd: NonNegative = 0.0  # start of the derivative gain, in seconds; 0: none
    filter: Positive = 0.05  # start of the time constant of the derivative [s]
    notches: tuple[NotchFilter, ...] = ()  # in series


@section
class PositionFeedback:
    """Positive position feedback: an effort of g w^2 / (s^2 + 2 z w s + w^2) of a signal."""

    input: str  # as `tip.APPENDAGE`
    output: str  # `effort.JOINT`
    gain: float  # start of g, in the unit of the effort per that of the signal
    frequency: Positive  # start of w [rad/s]
    damping: Positive = 0.3  # start of z [-]


@section
class PidBlock:
    """PID loops with notches, and positive position feedback, for the law `linear`."""

    kind: Literal["pid"]
    loops: Annotated[dict[str, PidLoop], Field(min_length=1)]  # by `effort.JOINT`
    position_feedback: tuple[PositionFeedback, ...] = ()  # added to the efforts


System: TypeAlias = Annotated[StateSpaceBlock | PidBlock, Field(discriminator="kind")]


@section
class ParallelBlock:
    """Systems in parallel, for the law `linear`; efforts of the same name add up."""

    kind: Literal["parallel"]
    # of the kinds state_space and pid, as one for each axis
    systems: Annotated[tuple[System, ...], Field(min_length=1)]


@section
class GainBlock:
    """Numbers of the law that the trial's controller runs."""

    kind: Literal["gains"]
    keys: tuple[str, ...] = ()  # of its section; none: those that the law names as gains


Structure: TypeAlias = Annotated[
    StateSpaceBlock | PidBlock | ParallelBlock | GainBlock, Field(discriminator="kind")
]


@section
class TuningSettings:
    """The keys of a tuning file."""

    tuning: Name  # its name, and that of its folder, runs/NAME
    trial: str  # a shipped trial or a file
    controller: Name  # of the trial, whose section is tuned; a new one runs the law `linear`
    # where the loop is linear: the equilibrium of the plan at this simulated time [s]; null: the
    # start
    at: NonNegative | None = None
    structure: Structure  # of the controller, with the start of its parameters
    goals: Annotated[tuple[Goal, ...], Field(min_length=1)]  # that the closed loop shall meet
    # plants on which every goal counts, by `stiffness`, `payload`, `gain`, `lag`, `delay`,
    # `testbed.KEY`, as `--vary` of analyse; none: the trial's own
    models: tuple[dict[str, float], ...] = ({},)
    starts: Annotated[int, Field(ge=1, le=1000)] = 4  # of the optimisation, the first the given one
    evaluations: Annotated[int, Field(ge=10)] = 1500  # of all goals, from each start
    seed: Annotated[int, Field(ge=0)] = 1  # of the other starts and of the sampled gradients
    # ranges over which the tuned loop is certified, as `--vary` of analyse; none: stiffness and
    # payload +-20 %
    guarantee: dict[str, Any] = Field(default_factory=dict)
