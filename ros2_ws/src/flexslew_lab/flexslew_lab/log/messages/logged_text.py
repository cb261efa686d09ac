"""YAML and JSON that lie in a log: plain data of bounded size and depth, or one line."""

from math import isfinite
from typing import Any

from pydantic_core import from_json

from flexslew_lab.log.files.read_limits import TEXT_KIND, check_size
from flexslew_plant.errors import BadInput
from flexslew_plant.yaml_data import MAX_DEPTH, load_yaml, require_no_anchor


def logged_yaml(text: str, source: str) -> dict[str, Any]:
    """Return the keys of a YAML text; none for an empty one.

    Raises:
        BadInput: it is not YAML, holds no keys, is too long or too deep, or has anchors, which
            this project never writes.
    """
    check_size(TEXT_KIND, len(text), source)
    require_no_anchor(text, source)
    found = load_yaml(text, source)
    if found is None:
        return {}
    if not isinstance(found, dict):
        raise BadInput(f"is a {type(found).__name__}, not a mapping", source)
    return {str(key): value for key, value in found.items()}


def logged_json(text: str, source: str) -> dict[str, Any]:
    """Return the keys of a JSON text; none for an empty one.

    Raises:
        BadInput: it is not JSON, holds no keys, is too long or too deep, or a number is not finite.
    """
    check_size(TEXT_KIND, len(text), source)
    try:
        found = from_json(text, allow_inf_nan=False) if text else {}
    except ValueError as error:
        raise BadInput(f"is not JSON: {error}", source) from None
    if not isinstance(found, dict):
        raise BadInput(f"is a {type(found).__name__}, not an object", source)
    _check_finite(found, source)
    return found


def _check_finite(value: Any, source: str, depth: int = 0) -> None:
    if depth > MAX_DEPTH:
        raise BadInput(f"is nested more than {MAX_DEPTH} deep", source)
    if isinstance(value, float) and not isfinite(value):
        raise BadInput(f"{value} is not a number", source)
    inner = value.values() if isinstance(value, dict) else value
    if isinstance(value, dict | list):
        for part in inner:
            _check_finite(part, source, depth + 1)
