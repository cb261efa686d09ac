"""What goes into the bench and what comes out: settings, the truth, requests and their results."""

from math import inf
from typing import Annotated, NamedTuple

from pydantic import Field

from flexslew_plant.arrays import Vector
from flexslew_plant.bench.schedule import Schedule
from flexslew_plant.hardware.actuator import ActuatorSettings
from flexslew_plant.hardware.plausibility import PlausibilitySettings
from flexslew_plant.hardware.sensors import SensorSettings
from flexslew_plant.refusal import Refusal
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds import TestbedSettings, default_testbed


@section
class BenchSettings:
    """Everything that determines the trajectory, but for the answers."""

    testbed: TestbedSettings = Field(default_factory=default_testbed)  # the spacecraft on the bench
    period: Positive = 0.01  # length of a tick [s]
    # equal steps of the integration in a tick; null: as many as keep the error of the fastest
    # mode's vibration over the run below 1 % of its amplitude
    integration_steps: Annotated[int, Field(ge=1, le=100)] | None = None
    duration: NonNegative = 0.0  # length of the run [s], simulated; 0: no end
    seed: Annotated[int, Field(ge=0)] = 1  # seed of everything random
    actuator: ActuatorSettings = ActuatorSettings()  # the motors
    sensors: SensorSettings = SensorSettings()  # the sensors
    active: str = "pd_feedforward"  # the controller in charge at the start
    # controllers that take over in this order when the one in charge is silent; after them the
    # brake
    fallback: tuple[str, ...] = ()
    # ticks in a row without a valid answer before a fallback takes over. In a paced run the last
    # waits at least 0.25 s of wall time
    max_missed: Annotated[int, Field(ge=1)] = 5
    brake_damping_ratio: Positive = 0.25  # damping ratio of the drive's own brake [-]
    # whether the drive compares its joint sensors; null: off
    plausibility: PlausibilitySettings | None = None
    schedule: Schedule = ()  # events of the run
    # whether the schedule and the service inject_fault may break anything
    allow_faults: bool = False


@section
class RateSettings:
    """How fast a run goes and is shown, over ROS 2; it changes no trajectory."""

    # simulated seconds per second of wall time; 0: as fast as possible, 1: real time
    rate_factor: NonNegative = 0.0
    # silence of wall time after which ticks count as missed, where the run is not paced [s]
    answer_timeout: Positive = 2.0
    # rate of joint states, tf and markers in simulated time [1/s]; 0: none
    display_rate: NonNegative = 50.0


class Truth(NamedTuple):
    """The state at a tick; see flexslew_msgs/PlantState."""

    tick: int
    time: float
    epoch: int
    position: Vector
    velocity: Vector
    applied_effort: Vector
    disturbance: Vector
    tip_deflection: Vector
    energy: float


class SwitchRequest(NamedTuple):
    """Give the bench to a controller at a tick."""

    controller: str
    tick: int
    strict: bool = False
    max_effort_step: float = inf  # [N m or N]
    who: str = ""  # name of the operator; empty: the schedule, or an operator without a name


class SwitchResult(NamedTuple):
    """What became of a request."""

    request: SwitchRequest
    tick: int
    effort_step: Vector  # (joints,) [N m or N]; zero if refused
    done: str = ""  # what was done, for people
    refused: Refusal | None = None

    @property
    def ok(self) -> bool:
        """It happened."""
        return self.refused is None

    @property
    def message(self) -> str:
        """What was done or why not, for people."""
        return str(self.refused or self.done)


class ActiveFault(NamedTuple):
    """Something that disturbs or breaks, or will."""

    number: int  # by which it can be ended
    words: str  # kind and values, YAML
    start: int  # tick
    end: int | None  # tick; None: the end of the run
