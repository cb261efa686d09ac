"""What a testbed's file says of it: its entry in the table of testbeds."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from flexslew_plant.entries import default_of


@dataclass(frozen=True)
class TestbedEntry:
    """A testbed, as the rest of the bench knows it; what it can do, its section says itself.

    Args:
        settings: its section, which keeps the contract of a Testbed; the default of `kind` is its
            name.
        example: keys of one with damped modes, where `damping_ratio` does not give them.
    """

    settings: type[Any]
    example: Mapping[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """What `testbed.kind` calls it."""
        return default_of(self.settings, "kind")
