"""Events of what disturbs, breaks or turns: what operators request, what begins and ends."""

from typing import Any

from pydantic import model_validator

from flexslew_plant.events.event import Count, Finite, Flag, Level, Text, fact

# an effort [N m or N], or its course over time: settings by the form that it has
Shape = Finite | dict[str, dict[str, Any] | None]


@fact("injected", Level.INFO, "{what} requested at tick {start}")
class InjectionRequested:
    """An operator requests a fault or a disturbance."""

    text: Text  # the request, YAML
    start: Count  # tick
    number: Count | None = None  # by which it can be ended
    who: Text = ""
    what: Text = ""  # kind of the fault, or disturbance


@fact(
    "retargeted",
    Level.INFO,
    lambda event: f"a new target from tick {event.start} on: {event.text.strip()}",
)
class TargetRequested:
    """An operator requests a turn of an appendage."""

    text: Text  # the request, YAML
    start: Count  # tick
    who: Text = ""


@fact("fault_ended", Level.INFO, "fault or disturbance {number} ends at tick {tick}")
class FaultEndRequested:
    """An operator requests the end of a fault or a disturbance."""

    number: Count
    tick: Count = 0  # with which it ends
    who: Text = ""


@fact(
    "fault",
    lambda event: Level.WARNING if event.on else Level.INFO,
    lambda event: f"{event.name} {'on' if event.on else 'off'}",
)
class FaultChanged:
    """A fault sets in, or ends."""

    on: Flag = False
    fault: dict[str, Any] | None = None  # its settings
    start: Count | None = None  # tick
    end: Count | None = None  # tick; None: the end of the run

    @property
    def name(self) -> str:
        """Its kind."""
        return str((self.fault or {}).get("kind", "fault"))


@fact(
    "disturbance",
    Level.INFO,
    lambda event: f"disturbance {'on' if event.on else 'off'}: {event.shapes}",
)
class DisturbanceChanged:
    """An effort from outside begins, or ends. In its data each joint is a key of its own."""

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
