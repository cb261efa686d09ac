"""What of a `testbed` section the physics needs."""

from typing import Protocol

from flexslew_plant.testbeds.spacecraft.settings import (
    ActuatorPlace,
    AppendageSettings,
    MomentGyroSettings,
    Platform,
    WheelSettings,
)
from flexslew_plant.testbeds.spacecraft.units import UnitSystem


class SpacecraftSection(Protocol):
    """What of a `testbed` section the physics needs."""

    @property
    def units(self) -> UnitSystem:
        """Of all its numbers."""

    @property
    def platform(self) -> Platform:
        """The rigid platform."""

    @property
    def appendages(self) -> dict[str, AppendageSettings]:
        """By name."""

    @property
    def wheels(self) -> dict[str, WheelSettings]:
        """By name."""

    @property
    def control_moment_gyros(self) -> dict[str, MomentGyroSettings]:
        """By name."""

    @property
    def actuators(self) -> dict[str, ActuatorPlace]:
        """By name."""
