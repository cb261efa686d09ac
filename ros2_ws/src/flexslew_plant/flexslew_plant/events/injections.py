"""Events of what disturbs, breaks or turns: what operators request, what begins and ends."""

from typing import Any, ClassVar

from pydantic import model_validator

from flexslew_plant.events.event import Count, Finite, Flag, Level, Text, fact

# an effort [N m or N], or its course over time: settings by the form that it has
Shape = Finite | dict[str, dict[str, Any] | None]


@fact
class InjectionRequested:
    """An operator wants something to break or to push."""

    kind: ClassVar[str] = "injected"
    level: ClassVar[Level] = Level.INFO
    text: Text  # what was asked for, YAML
    start: Count  # tick
    number: Count | None = None  # by which it can be ended
    who: Text = ""
    what: Text = ""  # kind of the fault, or disturbance

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"{self.what} requested at tick {self.start}"


@fact
class TargetRequested:
    """An operator wants an appendage to turn."""

    kind: ClassVar[str] = "retargeted"
    level: ClassVar[Level] = Level.INFO
    text: Text  # what was asked for, YAML
    start: Count  # tick
    who: Text = ""

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"a new target from tick {self.start} on: {self.text.strip()}"


@fact
class FaultEndRequested:
    """An operator wants a fault or a disturbance to end."""

    kind: ClassVar[str] = "fault_ended"
    level: ClassVar[Level] = Level.INFO
    number: Count
    tick: Count = 0  # with which it ends
    who: Text = ""

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"fault or disturbance {self.number} ends at tick {self.tick}"


@fact
class FaultChanged:
    """A fault sets in, or ends."""

    kind: ClassVar[str] = "fault"
    on: Flag = False
    fault: dict[str, Any] | None = None  # its settings
    start: Count | None = None  # tick
    end: Count | None = None  # tick; None: the end of the run

    @property
    def level(self) -> Level:
        """The end of a fault is good news."""
        return Level.WARNING if self.on else Level.INFO

    @property
    def name(self) -> str:
        """Its kind."""
        return str((self.fault or {}).get("kind", self.kind))

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"{self.name} {'on' if self.on else 'off'}"


@fact
class DisturbanceChanged:
    """An effort from outside begins, or ends. In its data each joint is a key of its own."""

    kind: ClassVar[str] = "disturbance"
    level: ClassVar[Level] = Level.INFO
    shapes: dict[str, Shape]  # by joint
    on: Flag = False

    @model_validator(mode="before")
    @classmethod
    def _by_joint(cls, data: dict[str, Any]) -> dict[str, Any]:
        shapes = {key: value for key, value in data.items() if key != "on"}
        return {"shapes": shapes, "on": data.get("on", False)}

    @property
    def content(self) -> dict[str, Any]:
        """Its data."""
        return {**self.shapes, "on": self.on}

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"disturbance {'on' if self.on else 'off'}: {self.shapes}"
