"""Values in few digits and few entries, for tables that people read."""

from typing import Any


def short(value: Any, digits: int = 6) -> str:
    """Return a value in few digits and few entries."""
    if isinstance(value, dict):
        return ", ".join(f"{key} {short(entry, digits)}" for key, entry in value.items())
    if isinstance(value, list | tuple):
        text = ", ".join(short(entry, digits) for entry in value[:8])
        return text + (", ..." if len(value) > 8 else "")
    if isinstance(value, float):
        return f"{value:.{digits}g}"
    return "-" if value is None else str(value)
