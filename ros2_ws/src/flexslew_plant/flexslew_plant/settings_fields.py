"""What each key of a settings section means: the words beside it in the code, and its range."""

import inspect
import re
from dataclasses import fields, is_dataclass
from functools import lru_cache
from math import inf, nextafter
from typing import Any, NamedTuple

from pydantic import TypeAdapter

_LINE = re.compile(r"^    (\w+)\s*:[^#\n]*#\s*(.*\S)\s*$", re.MULTILINE)


class FieldMeaning(NamedTuple):
    """A key of a section."""

    words: str  # with its unit; empty where the code says nothing
    low: float  # smallest allowed number; -inf: none
    high: float  # largest one; inf: none


def meanings(settings: Any, prefix: str = "") -> dict[str, FieldMeaning]:
    """Return what the keys of a section mean, by dotted name.

    Args:
        settings: an instance of a section; nested sections are followed.
        prefix: of the names.
    """
    found: dict[str, FieldMeaning] = {}
    for key, meaning in own_meanings(type(settings)).items():
        value, name = getattr(settings, key), prefix + key
        if is_dataclass(value):
            found |= meanings(value, f"{name}.")
        found[name] = meaning
    return found


@lru_cache(maxsize=256)
def own_meanings(kind: type[Any]) -> dict[str, FieldMeaning]:
    """Return what the keys of a section mean, nested sections not followed."""
    comments = dict(_LINE.findall(_source(kind)))
    schema = TypeAdapter(kind).json_schema().get("properties", {})
    return {
        item.name: FieldMeaning(comments.get(item.name, ""), *_range(schema.get(item.name, {})))
        for item in fields(kind)
    }


def _source(kind: type) -> str:
    try:
        return inspect.getsource(kind)
    except (OSError, TypeError):  # of a class that was made at run time
        return ""


def _range(schema: dict[str, Any]) -> tuple[float, float]:
    """Return the smallest and the largest number that a JSON schema allows."""
    options = [schema, *schema.get("anyOf", [])]
    numbers = [o for o in options if o.get("type") in ("number", "integer")]
    if not numbers:
        return -inf, inf
    low, high = numbers[0].get("minimum", -inf), numbers[0].get("maximum", inf)
    if "exclusiveMinimum" in numbers[0]:
        low = nextafter(numbers[0]["exclusiveMinimum"], inf)
    return float(low), float(high)
