"""What a person reads of a section that was refused: the key as written, and what is allowed."""

from typing import Any

from pydantic import TypeAdapter, ValidationError

from flexslew_plant.keys.units import is_quantity, units_at
from flexslew_plant.near_names import spelling_hint
from flexslew_plant.own_code import Untrusted
from flexslew_plant.refusal import Refusal

WHOLE = "(whole file)"  # the key of an error that is about no single one


class SectionError(ValueError):
    """A section has invalid values: the words name the place from the top of the file on."""


def refusal_of(error: ValidationError, kind: Any, values: Any, source: str) -> Refusal:
    """Return the first error; a key of nothing is the whole file.

    Of a missing key and an unknown one next to it, the unknown one is misspelled and comes first.
    """
    errors = error.errors()
    same_section = (one for one in errors if one["loc"][:-1] == errors[0]["loc"][:-1])
    first = next((one for one in same_section if one["type"] == _UNKNOWN), errors[0])
    place = [str(part) for part in first["loc"]]
    written = _written(first, values)
    key = ".".join(written) or WHOLE
    more = _others(written, [_written(one, values) for one in errors])
    if first["type"] == _UNKNOWN:
        known = _known_keys(error, kind, place[:-1])
        hint = spelling_hint(place[-1], known)
        allowed = f"allowed here: {', '.join(known)}" if known else "remove it"
        return Refusal(f"unknown key; {hint}{allowed}{more}", key, source=source)
    if first["type"] in _MISSING and not isinstance(first["loc"][-1], int):
        return Refusal(f"is missing{more}", key, source=source)
    if first["type"] == "value_error" and isinstance(first["input"], dict):  # checked as a whole
        is_section_error = not written or isinstance(first["ctx"]["error"], SectionError)
        return Refusal(f"{_reason(first)}{more}", "" if is_section_error else key, source=source)
    degrees = ""
    if first["type"] in ("less_than", "less_than_equal"):
        angle = "rad" in units_at(kind, written, values)
        degrees = f"; write {first['input']:g} deg if you mean degrees" * angle
    return Refusal(f"{_reason(first)}{degrees}{more}", key, first["input"], source)


def _others(first: tuple[str, ...], wrong: list[tuple[str, ...]]) -> str:
    """Return words about further wrong keys: names of those next to the first, else paths."""
    paths = [path for path in dict.fromkeys(wrong) if path != first]
    names = [path[-1] if path[:-1] == first[:-1] else ".".join(path) for path in paths if path]
    if not names:
        return ""
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return f" (wrong or missing, too: {', '.join(names[:_NAMED])}{more})"


def untrusted(error: ValidationError) -> str:
    """Return the class that the first error refuses to run; empty: it is another error."""
    cause = error.errors()[0].get("ctx", {}).get("error")
    rejected = cause.__cause__ if isinstance(cause, Exception) else None
    return rejected.name if isinstance(rejected, Untrusted) else ""


def quantities(error: ValidationError, values: Any) -> list[tuple[str, ...]]:
    """Return where a number is required, and a number with a unit is given."""
    wrong = [e for e in error.errors() if e["type"] in _NO_NUMBERS and is_quantity(e["input"])]
    return list(dict.fromkeys(_written(one, values) for one in wrong))


_NO_NUMBERS = ("float_type", "float_parsing", "int_type", "int_parsing", "tuple_type", "list_type")
LIST_FOR_KEYS = "a list stands where keys belong; write key: value, without dashes or brackets"
_KEYED = (
    *("dict_type", "dataclass_type", "dataclass_exact_type", "union_tag_not_found", "no_method"),
)
_NAMED = 3  # further keys that are wrong
_UNKNOWN = "unexpected_keyword_argument"
_MISSING = ("missing", "missing_argument", "missing_keyword_only_argument")
_REASONS = {  # by pydantic's type of an error; the rest of its words are plain enough
    "tuple_type": "give a list, for example [1.0, 2.0]",
    "list_type": "give a list, for example [1.0, 2.0]",
    "dict_type": "give keys, for example {key: value}",
    "dataclass_type": "give keys, for example {key: value}",
    "dataclass_exact_type": "give keys, for example {key: value}",
    "float_type": "give a number",
    "float_parsing": "give a number",
    "finite_number": "give a finite number",
    "int_type": "give a whole number",
    "int_parsing": "give a whole number",
    "int_from_float": "give a whole number",
    "bool_type": "give true or false",
    "bool_parsing": "give true or false",
    "string_type": "give a text",
}


def _reason(error: Any) -> str:
    """Return why a value is not allowed, in words of a trial file instead of Python's."""
    kind, context = error["type"], error.get("ctx", {})
    if kind in _KEYED and isinstance(error["input"], list):
        return LIST_FOR_KEYS
    if kind in _REASONS:
        return _REASONS[kind]
    if kind == "union_tag_invalid":
        return f"{context['tag']} is unknown; allowed: {context['expected_tags']}"
    if kind == "union_tag_not_found":
        return f"the key {str(context['discriminator']).strip(chr(39))} is missing"
    if kind in _MISSING:  # in a list of fixed length
        return "too few entries"
    if kind == "string_pattern_mismatch":
        return f"must match {context['pattern']}"
    if kind in ("too_short", "too_long"):
        bound = context["min_length" if kind == "too_short" else "max_length"]
        side = "at least" if kind == "too_short" else "at most"
        return f"{side} {bound} entr{'y' if bound == 1 else 'ies'}, here {context['actual_length']}"
    words = str(error["msg"])
    for old, new in (("Input should be ", "must be "), ("Value error, ", "")):
        words = words.replace(old, new)
    return words


def _written(error: Any, values: Any) -> tuple[str, ...]:
    """Return the path as the file has it: without the tags of unions and what is not there."""
    path, place = [], error["loc"]
    for part in place:
        is_known = isinstance(part, int) or (isinstance(values, dict) and part in values)
        missing = part == place[-1] and error["type"] in _MISSING
        if (is_known and not (missing and isinstance(part, int))) or (missing and not is_known):
            path.append(str(part))
        if is_known:
            try:
                values = values[part]
            except (LookupError, TypeError):
                values = None
    return tuple(path)


def _known_keys(error: ValidationError, kind: Any, place: list[str]) -> list[str]:
    """Return the keys of the section at `place`, read from the JSON schema of the whole."""
    schema = TypeAdapter(kind).json_schema()

    def resolve(node: dict[str, Any]) -> list[dict[str, Any]]:
        if "$ref" in node:
            return resolve(schema["$defs"][node["$ref"].rsplit("/", 1)[1]])
        options = node.get("oneOf", []) + node.get("anyOf", []) + node.get("allOf", [])
        return [leaf for option in options for leaf in resolve(option)] or [node]

    nodes = resolve(schema)
    for part in place:
        found = [n["properties"][part] for n in nodes if part in n.get("properties", {})]
        found += [n["items"] for n in nodes if part.isdigit() and "items" in n]
        found += [
            n["additionalProperties"]
            for n in nodes
            if isinstance(n.get("additionalProperties"), dict)
        ]
        tagged = [  # a union's tag stands in the path too
            n
            for n in nodes
            if any(part in str(v.get("const")) for v in n.get("properties", {}).values())
        ]
        nodes = [leaf for node in found for leaf in resolve(node)] or tagged or nodes
    return sorted({key for node in nodes for key in node.get("properties", {})})
