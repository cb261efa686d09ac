"""Testbeds with numbers that may be wrong without a contradiction."""

from typing import Protocol, runtime_checkable


@runtime_checkable
class HasDoubts(Protocol):
    """A testbed that reports which of its numbers no structure is likely to have."""

    def doubts(self) -> tuple[str, ...]:
        """Return warnings, each in one line with its numbers."""
