"""Values in few digits and few entries, for tables that people read."""

import math
from collections.abc import Iterable, Sequence
from typing import Any

_WIDEST = 8  # digits of a number without a power of ten


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


def in_columns(rows: Iterable[Sequence[object]], digits: int = 4) -> list[list[Any]]:
    """Return rows of a table with the floating-point numbers of each column in one format.

    Args:
        rows: of one length; other cells stay as they are.
        digits: of the smallest number in a column.
    """
    columns = [one_format(column, digits) for column in zip(*rows, strict=True)]
    return [list(row) for row in zip(*columns, strict=True)]


def one_format(values: Sequence[object], digits: int = 4) -> list[Any]:
    """Return numbers with as many decimals each, or with a power of ten each; see in_columns.

    What is infinite or no number is a dash.
    """
    known = [abs(v) for v in values if isinstance(v, float) and math.isfinite(v)]
    places = [math.floor(math.log10(v)) for v in known if v]
    decimals = max(digits - 1 - min(places, default=0), 0)
    wide = decimals + max([*places, 0]) + 1 > _WIDEST
    form = f".{digits - 1}e" if wide else f".{decimals}f"
    return [
        (format(v, form) if math.isfinite(v) else "-") if isinstance(v, float) else v
        for v in values
    ]
