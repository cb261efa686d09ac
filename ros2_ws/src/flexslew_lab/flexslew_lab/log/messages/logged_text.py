"""YAML and JSON that lie in a log: plain data of bounded size and depth, or one line."""

from math import isfinite
from typing import Any

import yaml
from pydantic_core import from_json

from flexslew_plant.errors import BadInput
from flexslew_plant.settings import DEEPEST, load_yaml

LONGEST = 1 << 18  # of one text [B]; a trial takes about 3 KiB, a list of 64 faults 6 KiB


def logged_yaml(text: str, source: str) -> dict[str, Any]:
    """Return the keys of a YAML text; none for an empty one.

    Raises:
        BadInput: it is not YAML, holds no keys, is too long or too deep, or has anchors, which can
            make gigabytes of a few lines and which this project never writes.
    """
    _demand_length(text, source)
    try:
        for event in yaml.parse(text, Loader=yaml.CSafeLoader):
            if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
                raise BadInput("has a YAML anchor, which no log of this project has", source)
    except yaml.YAMLError:
        pass  # load_yaml names the place
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
    _demand_length(text, source)
    try:
        found = from_json(text, allow_inf_nan=False) if text else {}
    except ValueError as error:
        raise BadInput(f"is not JSON: {error}", source) from None
    if not isinstance(found, dict):
        raise BadInput(f"is a {type(found).__name__}, not an object", source)
    _demand_finite(found, source)
    return found


def _demand_length(text: str, source: str) -> None:
    if len(text) > LONGEST:
        raise BadInput(f"has {len(text)} characters, at most {LONGEST} are allowed", source)


def _demand_finite(value: Any, source: str, depth: int = 0) -> None:
    if depth > DEEPEST:
        raise BadInput(f"is nested more than {DEEPEST} deep", source)
    if isinstance(value, float) and not isfinite(value):
        raise BadInput(f"{value} is not a number", source)
    inner = value.values() if isinstance(value, dict) else value
    if isinstance(value, dict | list):
        for part in inner:
            _demand_finite(part, source, depth + 1)
