"""A plant in a process of its own or on a serial line, in any language (docs/external_plant.md)."""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from flexslew_plant.errors import BadInput
from flexslew_plant.external.own_clock import ClockedPlant, ClockLimits
from flexslew_plant.external.plant_link import Hello
from flexslew_plant.serial_line.port import BAUD
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds.black_box.model import (
    black_box_model,
    black_box_scene,
    require_unscaled,
)
from flexslew_plant.testbeds.black_box.plant_address import PlantAddress
from flexslew_plant.testbeds.contract import RunningPlant
from flexslew_plant.testbeds.entry import TestbedEntry
from flexslew_plant.testbeds.model import Model
from flexslew_plant.testbeds.scene import Scene

_PERIOD = 0.01  # for a program that only describes itself [s]
# the keys that the program describes; those in the trial win
_DESCRIBED = (
    *("joints", "joint_units", "effort_limit", "tips", "tip_units", "tip_rates"),
    *("initial", "clock"),
)


@section
class ExternalTestbed:
    """A program or a device that answers efforts with measurements, tick by tick."""

    kind: Literal["external"] = "external"
    command: tuple[str, ...] = ()  # program and its arguments; or give `serial`
    serial: str = ""  # path of the serial port to it, as /dev/ttyACM0; or give `command`
    baud: Annotated[int, Field(gt=0)] = BAUD  # rate of the serial line, bits per second
    # numbers that the program receives before its first tick, in its own units
    parameters: dict[str, float] = Field(default_factory=dict)
    joints: tuple[str, ...] = ()  # names; (): as the program describes them, like the next six
    joint_units: tuple[Literal["rad", "m"], ...] = ()  # of each joint: rad or m
    effort_limit: tuple[Positive, ...] = ()  # of each drive [N m or N]
    tips: tuple[str, ...] = ()  # names of the readings besides those of the joints
    tip_units: tuple[str, ...] = ()  # of each reading; empty for a plain number
    tip_rates: bool = False  # whether the program also gives the rates of the tips
    # joint positions at the start, by name [rad or m]; others 0
    initial: dict[str, float] = Field(default_factory=dict)
    # damping of the drive's brake, per joint [N m s/rad or N s/m]; (): the brake exerts no effort,
    # and a plant with its own clock is braked by its own, which ends the run
    brake_damping: tuple[NonNegative, ...] = ()
    start_timeout: Positive = 30.0  # longest wait for its description, of wall time [s]
    answer_timeout: Positive = 10.0  # longest wait for each of its answers, of wall time [s]
    # bench: a tick passes when both have answered; own: when the plant measures, at its own time
    clock: Literal["bench", "own"] = "bench"
    # longest silence of a plant with its own clock, in periods, then the run ends
    watchdog: Annotated[int, Field(ge=1)] = 10
    # most ticks in a row that are lost or late with its own clock, then the run ends
    max_missed: Annotated[int, Field(ge=0)] = 20

    operating_point: ClassVar[dict[str, float]] = {}
    simplified: ClassVar[dict[str, Any]] = {}

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if bool(self.command) == bool(self.serial):
            raise ValueError("command: give either `command` or `serial`")
        if not self.joints:
            raise ValueError("joints: give at least one")
        sizes = {"joint_units": len(self.joint_units), "effort_limit": len(self.effort_limit)}
        if self.brake_damping:
            sizes["brake_damping"] = len(self.brake_damping)
        for key, size in sizes.items():
            if size != len(self.joints):
                raise ValueError(f"{key}: {size} entries for {len(self.joints)} joints")
        if len(self.tip_units) != len(self.tips):
            raise ValueError(f"tip_units: {len(self.tip_units)} entries for {len(self.tips)} tips")
        return self

    @property
    def modes(self) -> int:
        """How many readings stand in the place of modal coordinates."""
        return len(self.tips)

    @property
    def typical_goal(self) -> dict[str, float]:
        """A tenth of a unit by each joint [rad or m]."""
        return dict.fromkeys(self.joints, 0.1)

    @property
    def code_name(self) -> str:
        """Name of what it starts or opens, for --trust: as in a shell."""
        return self._address.name

    @property
    def own_clock(self) -> bool:
        """Whether it paces the ticks by a clock of its own."""
        return self.clock == "own"

    @property
    def _address(self) -> PlantAddress:
        return PlantAddress(self.command, self.serial, self.baud, self.start_timeout)

    def model(self) -> Model:
        """Return names, units and sizes; it has no equations."""
        return black_box_model(self.joints, self.joint_units, self.tips, self.tip_units)

    def scaled(self, stiffness: float = 1.0, payload: float = 1.0) -> "ExternalTestbed":
        """Return it unchanged.

        Raises:
            BadInput: if another stiffness or payload is requested; `parameters` may have them.
        """
        require_unscaled(self.kind, "an external plant", stiffness, payload)
        return self

    def scene(self) -> Scene:
        """Return how it is drawn."""
        return black_box_scene(self.kind, self.joints, self.joint_units, self.tips)

    def start(self, period: float) -> RunningPlant:
        """Return it, running, before its first reset; see contract.BlackBox.

        Raises:
            BadInput: it cannot be started, or describes itself otherwise than this section.
        """
        hello = Hello(period, self.parameters, self.initial)
        link = self._address.link(hello, "testbed")
        described = link.described
        for key in (key for key in _DESCRIBED if key not in ("effort_limit", "initial")):
            given = getattr(self, key)
            if described[key] != given:
                link.close()
                words = f"{self.code_name} describes {described[key]!r}"
                raise BadInput(words, "testbed", key, given)
        link.set_timeout(self.answer_timeout)
        if not self.own_clock:
            return link
        if link.period != period:
            link.close()
            words = f"{self.code_name} measures each {link.period:g} s"
            raise BadInput(words, key="period", value=period)
        return ClockedPlant(
            link, period, ClockLimits(self.answer_timeout, self.watchdog, self.max_missed)
        )


def described_by_program(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keys of a section that its program describes, those given left out.

    Raises:
        BadInput: if the program cannot be started or breaks the protocol.
    """
    command, port = values.get("command"), values.get("serial")
    words = isinstance(command, list | tuple) and all(isinstance(part, str) for part in command)
    given = bool(command) and words if port is None else isinstance(port, str) and not command
    if not given or values.get("joints"):
        return {}  # the section refuses the first, and needs no program in the second case
    parameters = values.get("parameters") or {}
    initial = values.get("initial") or {}
    if not isinstance(parameters, dict) or not isinstance(initial, dict):
        return {}
    timeout, baud = values.get("start_timeout"), values.get("baud")
    timeout = float(timeout) if isinstance(timeout, int | float) and timeout > 0.0 else 30.0
    baud = baud if isinstance(baud, int) and baud > 0 else BAUD
    address = PlantAddress(tuple(command or ()), port or "", baud, timeout)
    link = address.link(Hello(_PERIOD, parameters, initial))
    link.close()
    described = {key: link.described[key] for key in _DESCRIBED if key not in values}
    return {**described, "initial": {**link.described["initial"], **initial}}


EXTERNAL = TestbedEntry(ExternalTestbed, described=described_by_program, has_equations=False)
