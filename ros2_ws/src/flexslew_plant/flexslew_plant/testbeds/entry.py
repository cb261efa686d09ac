"""What a testbed's file says of it: its entry in the table of testbeds."""

from dataclasses import dataclass
from typing import Any

from flexslew_plant.entries import default_of


@dataclass(frozen=True)
class TestbedEntry:
    """A testbed, as the rest of the bench knows it; what it can do, its section says itself.

    Args:
        settings: its section, which keeps the contract of a Testbed; the default of `kind` is its
            name.
    """

    settings: type[Any]

    @property
    def name(self) -> str:
        """What `testbed.kind` calls it."""
        return default_of(self.settings, "kind")
