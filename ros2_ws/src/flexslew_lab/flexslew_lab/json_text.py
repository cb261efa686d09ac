"""JSON that every reader takes: numbers that are not finite are null."""

import json
from math import isfinite
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
        return json.dumps(_finite(values), indent=indent, allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(part) for part in value]
    return None if isinstance(value, float) and not isfinite(value) else value
