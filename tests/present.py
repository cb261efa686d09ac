"""What a test knows to be there."""

from typing import TypeVar

Value = TypeVar("Value")


def present(value: Value | None) -> Value:
    """Return a value that may be None in general, but not in this test."""
    assert value is not None
    return value
