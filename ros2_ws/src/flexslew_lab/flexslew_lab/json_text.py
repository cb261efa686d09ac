"""JSON that every reader takes: numbers that are not finite are null."""

import json
from collections.abc import Callable
from math import isfinite, isnan
from typing import Any


def json_text(values: Any, indent: int | None = 2) -> str:
    """Return plain data as JSON; NaN and infinities, which JSON has not, are null.

    Args:
        values: dictionaries, lists, tuples and scalars.
        indent: spaces per level; None: all on one line.
    """
    try:
        return json.dumps(values, indent=indent, allow_nan=False)
    except ValueError:
        return json.dumps(finite(values), indent=indent, allow_nan=False)


def finite(values: Any) -> Any:
    """Return plain data with None in place of every number that is not finite."""
    return _replace_by_none(values, lambda x: not isfinite(x))


def nan_as_null(values: Any) -> Any:
    """Return plain data with None in place of every NaN, for files that people read."""
    return _replace_by_none(values, isnan)


def _replace_by_none(value: Any, wrong: Callable[[float], bool]) -> Any:
    """Return plain data with None in place of the numbers for which `wrong` is true."""
    if isinstance(value, dict):
        return {key: _replace_by_none(part, wrong) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_replace_by_none(part, wrong) for part in value]
    return None if isinstance(value, float) and wrong(value) else value
