"""The meaning of each key of a settings section: its description in the code, and its range.

The field is the only place where a key is described: its comment (at the end of its line, or in the
lines above it) or the description of its type. Pages, forms, parameters, errors and the JSON schema
are made from that.
"""

import ast
import inspect
import re
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from math import inf, nextafter
from textwrap import dedent
from typing import Any, NamedTuple

from pydantic import TypeAdapter


class FieldDescription(NamedTuple):
    """A key of a section."""

    words: str  # with its unit; empty where the code has none
    low: float  # smallest allowed number; -inf: none
    high: float  # largest one; inf: none
    choices: tuple[str, ...] = ()  # the texts that are allowed; none: any

    @property
    def description(self) -> str:
        """The words, and what is allowed."""
        low, high = self.low, self.high
        limits = []
        if low > -inf:
            limits.append(f"{'at least' if low == round(low, 9) else 'above'} {round(low, 9):g}")
        if high < inf:
            limits.append(f"{'at most' if high == round(high, 9) else 'below'} {round(high, 9):g}")
        named = all(re.search(rf"\b{re.escape(one)}\b", self.words) for one in self.choices)
        choice_text = "" if named else f"one of {', '.join(self.choices)}"
        return "; ".join(part for part in (self.words, ", ".join(limits), choice_text) if part)


_FIELD_TABLE: dict[type, Mapping[str, FieldDescription]] = {}


def describe_fields(settings: Any, prefix: str = "") -> dict[str, FieldDescription]:
    """Return what the keys of a section mean, by dotted name.

    Args:
        settings: an instance of a section; nested sections are followed.
        prefix: of the names.
    """
    found: dict[str, FieldDescription] = {}
    for key, description in describe_section(type(settings)).items():
        value, name = getattr(settings, key), prefix + key
        if is_dataclass(value):
            found |= describe_fields(value, f"{name}.")
        found[name] = description
    return found


def describe_section(kind: type[Any]) -> Mapping[str, FieldDescription]:
    """Return what the keys of a section mean, nested sections not followed."""
    if kind not in _FIELD_TABLE:
        comments: dict[str, str] = {}
        for owner in reversed(kind.__mro__):
            comments |= _comments(owner) if "__dataclass_fields__" in vars(owner) else {}
        schema = TypeAdapter(kind).json_schema().get("properties", {})
        _FIELD_TABLE[kind] = {
            item.name: _describe_field(comments.get(item.name, ""), schema.get(item.name, {}))
            for item in fields(kind)
        }
    return _FIELD_TABLE[kind]


def _describe_field(comment: str, schema: dict[str, Any]) -> FieldDescription:
    return FieldDescription(
        comment or schema.get("description", ""), *_range(schema), _choices(schema)
    )


def _comments(kind: type) -> dict[str, str]:
    """Return the comment of every field that has one."""
    try:
        source = dedent(inspect.getsource(kind))
    except (OSError, TypeError):  # of a class that was made at run time
        return {}
    lines, found = source.splitlines(), {}
    body = ast.parse(source).body[0]
    assert isinstance(body, ast.ClassDef)
    for item in body.body:
        if not isinstance(item, ast.AnnAssign) or not isinstance(item.target, ast.Name):
            continue
        first, last = item.lineno - 1, item.end_lineno or item.lineno
        rest = lines[last - 1].encode()[item.end_col_offset or 0 :].decode()
        words = [rest.partition("#")[2]]
        while first > 0 and lines[first - 1].lstrip().startswith("#"):
            first -= 1
            words.insert(0, lines[first].lstrip().removeprefix("#"))
        found[item.target.id] = " ".join(" ".join(words).split())
    return found


def _options(schema: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the alternatives of a JSON schema, entries of lists and of names among them."""
    found = [schema]
    for one in (*schema.get("anyOf", []), *schema.get("oneOf", [])):
        found += _options(one)
    for one in (schema.get("items"), schema.get("additionalProperties")):
        found += _options(one) if isinstance(one, dict) else []
    return [*found, *schema.get("prefixItems", [])[:1]]


def _choices(schema: dict[str, Any]) -> tuple[str, ...]:
    """Return the texts that a JSON schema lists; one that is fixed is no choice."""
    return tuple(str(text) for one in _options(schema) for text in one.get("enum", ()))


def _range(schema: dict[str, Any]) -> tuple[float, float]:
    """Return the smallest and the largest number that a JSON schema allows."""
    numbers = [o for o in _options(schema) if o.get("type") in ("number", "integer")]
    if not numbers:
        return -inf, inf
    low, high = numbers[0].get("minimum", -inf), numbers[0].get("maximum", inf)
    if "exclusiveMinimum" in numbers[0]:
        low = nextafter(numbers[0]["exclusiveMinimum"], inf)
    if "exclusiveMaximum" in numbers[0]:
        high = nextafter(numbers[0]["exclusiveMaximum"], -inf)
    return float(low), float(high)
