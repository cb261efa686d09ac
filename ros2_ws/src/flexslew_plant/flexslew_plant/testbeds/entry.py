"""The entry of a testbed in the table of testbeds."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from flexslew_plant.entries import default_of


@dataclass(frozen=True)
class TestbedEntry:
    """A testbed for the rest of the bench; the protocols of its section define its abilities.

    Args:
        settings: its section, which keeps the contract of a Testbed; the default of `kind` is its
            name.
        example: keys of one with damped modes, where `damping_ratio` does not give them.
        from_file: returns keys that a file holds, from its path and the source for errors; the key
            `file` names it. None: there is no such file.
    """

    settings: type[Any]
    example: Mapping[str, Any] = field(default_factory=dict)
    from_file: Callable[[str, str], dict[str, Any]] | None = None
    described: Callable[[Mapping[str, Any]], dict[str, Any]] | None = None
    has_equations: bool = True

    @property
    def name(self) -> str:
        """The testbed's name in `testbed.kind`."""
        return default_of(self.settings, "kind")
