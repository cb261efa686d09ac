"""A functional mock-up unit (FMU) for co-simulation as a testbed (docs/fmu.md)."""

import hashlib
from collections import deque
from collections.abc import Mapping
from typing import Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput, FlexslewError
from flexslew_plant.events import Fact
from flexslew_plant.external.messages import PlantFault
from flexslew_plant.given_file import given_bytes
from flexslew_plant.settings import NonNegative, Positive, section, validated
from flexslew_plant.testbeds.black_box.fmu_instance import FmuInstance
from flexslew_plant.testbeds.black_box.model import (
    black_box_model,
    black_box_scene,
    require_unscaled,
)
from flexslew_plant.testbeds.contract import RunningPlant
from flexslew_plant.testbeds.entry import TestbedEntry
from flexslew_plant.testbeds.model import Model
from flexslew_plant.testbeds.scene import Scene

_SAME = 1e-9  # largest difference of a position at the start from `initial` [rad or m]


@section
class FmuJoint:
    """The variables of a joint."""

    position: str  # output [rad or m]
    velocity: str  # output [rad/s or m/s]
    unit: Literal["rad", "m"] = "rad"
    # variable that sets the position at the start, often a parameter; null: the FMU decides
    start: str | None = None


@section
class FmuActuator:
    """The variable of the effort in a joint."""

    effort: str  # input [N m or N]
    limit: Positive  # [N m or N]


@section
class FmuTip:
    """The variables of a reading besides those of the joints."""

    position: str  # output
    velocity: str | None = None  # output; null: the rate is read as 0
    unit: str = "m"  # empty for a plain number


@section
class FmuTestbed:
    """An FMU of any tool for co-simulation, FMI 2.0 or 3.0, and what its variables are."""

    kind: Literal["fmu"] = "fmu"
    file: str  # path of the .fmu
    sha256: str | None = None  # of the file, hexadecimal; filled in, so that a log has it
    joints: dict[str, FmuJoint] = Field(min_length=1)  # by name
    actuators: dict[str, FmuActuator]  # by the name of the joint, one for each
    tips: dict[str, FmuTip] = Field(default_factory=dict)  # by name
    # parameters of the FMU, in its own units, set before the start
    parameters: dict[str, float] = Field(default_factory=dict)
    # joint positions at the start, by name [rad or m]; others: as the FMU starts
    initial: dict[str, float] = Field(default_factory=dict)
    # damping of the drive's brake, per joint [N m s/rad or N s/m]; (): the brake exerts no effort
    brake_damping: tuple[NonNegative, ...] = ()

    operating_point: ClassVar[dict[str, float]] = {}
    simplified: ClassVar[dict[str, Any]] = {}

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if set(self.actuators) != set(self.joints):
            words = f"{', '.join(self.actuators)} for the joints {', '.join(self.joints)}"
            raise ValueError(f"actuators: {words}; give one for each joint")
        if self.brake_damping and len(self.brake_damping) != len(self.joints):
            words = f"{len(self.brake_damping)} entries for {len(self.joints)} joints"
            raise ValueError(f"brake_damping: {words}")
        for name in self.initial:
            if name in self.joints and self.joints[name].start is None and self.sha256 is None:
                words = "name the variable that sets it, joints." + name + ".start"
                raise ValueError(f"initial.{name}: {words}, or leave it to the FMU")
        return self

    @property
    def modes(self) -> int:
        """How many readings stand in the place of modal coordinates."""
        return len(self.tips)

    @property
    def effort_limit(self) -> tuple[float, ...]:
        """Largest effort of each joint [N m or N]."""
        return tuple(self.actuators[name].limit for name in self.joints)

    @property
    def typical_goal(self) -> dict[str, float]:
        """A tenth of a unit by each joint [rad or m]."""
        return dict.fromkeys(self.joints, 0.1)

    @property
    def code_name(self) -> str:
        """Name of the code that it runs, for --trust: its file."""
        return self.file

    def model(self) -> Model:
        """Return names, units and sizes; it has no equations."""
        units = tuple(joint.unit for joint in self.joints.values())
        tip_units = tuple(tip.unit for tip in self.tips.values())
        return black_box_model(tuple(self.joints), units, tuple(self.tips), tip_units)

    def scaled(self, stiffness: float = 1.0, payload: float = 1.0) -> "FmuTestbed":
        """Return it unchanged.

        Raises:
            BadInput: if another stiffness or payload is requested; `parameters` may have them.
        """
        require_unscaled(self.kind, "an FMU", stiffness, payload)
        return self

    def scene(self) -> Scene:
        """Return how it is drawn."""
        units = tuple(joint.unit for joint in self.joints.values())
        return black_box_scene(self.kind, tuple(self.joints), units, tuple(self.tips))

    @property
    def own_clock(self) -> bool:
        """False: the bench paces it."""
        return False

    def start(self, period: float) -> RunningPlant:
        """Return the FMU, running, before its first reset; see contract.BlackBox.

        Raises:
            BadInput: it cannot be started, or is not what the section describes.
        """
        plant = FmuPlant(self, period)
        try:
            plant.require_period()
        except BadInput:
            plant.close()
            raise
        return plant


class FmuPlant:
    """An FMU that flies: one tick is a communication step with the efforts held."""

    def __init__(self, testbed: FmuTestbed, period: float) -> None:
        self.facts = deque[Fact]()
        content = given_bytes(testbed.file)
        self.sha256 = hashlib.sha256(content).hexdigest()
        if testbed.sha256 not in (None, self.sha256):
            words = f"is another file, SHA-256 {self.sha256}; this run has {testbed.sha256}"
            raise BadInput(words, testbed.file)
        self._unit = FmuInstance(testbed.file, content)
        try:
            self._find_variables(testbed)
        except FlexslewError:
            self.close()
            raise
        self._period, self._tick = period, 0
        self._required = {n: at for n, at in testbed.initial.items() if n in testbed.joints}

    def _find_variables(self, testbed: FmuTestbed) -> None:
        """Look up the value references of the section's variables.

        Raises:
            BadInput: one is missing, or has another unit.
        """
        find, joints, tips = self._unit.reference, testbed.joints.values(), testbed.tips.values()
        read = "output", "local"
        self._names = tuple(testbed.joints)
        self._positions = [find(joint.position, read) for joint in joints]
        self._velocities = [find(joint.velocity, read) for joint in joints]
        self._tips = [find(tip.position, read) for tip in tips]
        self._rates = [(i, find(tip.velocity, read)) for i, tip in enumerate(tips) if tip.velocity]
        self._efforts = [find(testbed.actuators[n].effort, ("input",)) for n in testbed.joints]
        settable = "parameter", "output", "local", "input"
        self._values = {
            find(name, ("parameter", "input")): value for name, value in testbed.parameters.items()
        }
        for name, joint in testbed.joints.items():
            if joint.start is not None and name in testbed.initial:
                self._values[find(joint.start, settable)] = testbed.initial[name]
            declared = self._unit.unit(joint.position)
            if declared not in (None, joint.unit, "1"):
                words = f"{joint.position} is in {declared}, the joint {name} in {joint.unit}"
                raise BadInput(f"{words}; the bench reads rad or m", testbed.file)

    def require_period(self) -> None:
        """Check that a tick is a multiple of the FMU's own step.

        Raises:
            BadInput: it is not.
        """
        self._unit.require_period(self._period)

    def stop(self) -> None:
        """Do nothing: it moves only in `advance`."""

    def reset(self) -> Vector:
        """Return to tick 0; return the state there."""
        self._tick = 0
        self._unit.begin(self._values)
        state = self._state()
        for name, position in zip(self._names, state, strict=False):
            if abs(position - self._required.get(name, position)) > _SAME:
                words = f"{name} starts at {position:.9g}, not at {self._required[name]:.9g}"
                raise PlantFault(f"{self._unit.name}: {words}")
        return state

    def advance(self, effort: Vector) -> Vector:
        """Return the state a period later with the efforts held."""
        self._unit.set(self._efforts, effort.tolist())
        self._unit.advance(self._tick * self._period, self._period)
        self._tick += 1
        return self._state()

    def _state(self) -> Vector:
        unit, rates = self._unit, np.zeros(len(self._tips))
        if self._rates:
            rates[[i for i, _ in self._rates]] = unit.get(
                [reference for _, reference in self._rates]
            )
        return np.concatenate((unit.get(self._positions + self._tips),
                               unit.get(self._velocities), rates))  # fmt: skip

    def close(self) -> None:
        """Free the FMU; a second call changes nothing."""
        self._unit.close()


def described_by_fmu(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the SHA-256 of the file and where its joints start; {} if the section has them.

    Raises:
        BadInput: if the FMU cannot be started, or has no such variables.
    """
    if values.get("sha256") is not None or not isinstance(values.get("file"), str):
        return {}
    testbed: FmuTestbed = validated(FmuTestbed, values, "testbed")
    plant = FmuPlant(testbed, 1.0)
    try:
        state = plant.reset()
    except PlantFault as error:
        raise BadInput(str(error)) from None
    finally:
        plant.close()
    initial = dict(zip(testbed.joints, state.tolist(), strict=False))
    return {"sha256": plant.sha256, "initial": initial | testbed.initial}


FMU = TestbedEntry(FmuTestbed, described=described_by_fmu, has_equations=False)
