"""Sections of a trial file: one YAML section is one frozen dataclass, checked on the way in."""

import re
from collections.abc import Hashable, Iterator
from math import inf
from typing import Annotated, Any, TypeAlias, TypeVar, dataclass_transform

import yaml
from pydantic import BeforeValidator, ConfigDict, Field, InstanceOf, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass
from pydantic.errors import PydanticUndefinedAnnotation, PydanticUserError
from pydantic.json_schema import SkipJsonSchema

from flexslew_plant.errors import BadInput
from flexslew_plant.near_names import did_you_mean
from flexslew_plant.own_code import NO_CODE, Trust, Untrusted
from flexslew_plant.refusal import Refusal
from flexslew_plant.units import is_quantity, replaced

_T = TypeVar("_T")
_Place = tuple[Any, ...]  # keys and places in lists, from the top on
_ADAPTERS: dict[type, TypeAdapter[Any]] = {}
_MOST = 1_000_000  # values in a YAML text with aliases
_SHORT = 10_000  # characters that cannot nest too deep for the stack
DEEPEST = 32  # lists and keys in one another
LONGEST = 1 << 20  # of a YAML or JSON text that a log can hold [characters]

WHOLE = "(whole file)"  # the key of an error that is about no single one

Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]
Probability = Annotated[float, Field(ge=0.0, le=1.0)]


NotAKey: TypeAlias = SkipJsonSchema[InstanceOf[_T]]  # a field that code sets, and no file


def _as_list(value: Any) -> Any:
    """Return a single number as a list of one."""
    single = isinstance(value, int | float) and not isinstance(value, bool)
    return (value,) if single else value


# one number per joint; a single number, or a list of one, serves every joint
PerJoint = Annotated[
    tuple[NonNegative, ...],
    BeforeValidator(_as_list, json_schema_input_type=NonNegative | tuple[NonNegative, ...]),
    Field(min_length=1),
]


@dataclass_transform(frozen_default=True, kw_only_default=True)
def section(cls: type[_T]) -> type[_T]:
    """Return cls as a frozen dataclass that refuses unknown keys and non-finite numbers."""
    config = ConfigDict(extra="forbid", allow_inf_nan=False, validate_default=False)
    return dataclass(frozen=True, kw_only=True, config=config)(cls)  # type: ignore[return-value]


class Placed(ValueError):
    """A section cannot be what it says: the words name the place from the top of the file on."""


def validated(kind: Any, values: Any, source: str, trust: Trust = NO_CODE) -> Any:
    """Return values as an instance of the section `kind`; `2 min` is 120 where a key is in [s].

    Args:
        kind: a section class, or any type that pydantic knows.
        values: what YAML or a ROS parameter gave.
        source: the file (or node) to name in an error.
        trust: which classes of the user's own may be loaded; pydantic hands it to validators.

    Raises:
        BadInput: the first wrong key, with its value and what is allowed; the class is none that
            can be checked.
        Untrusted: it names code that nobody has trusted.
    """
    try:
        try:
            result = _adapter(kind).validate_python(values, context=trust)
        except ValidationError as error:
            places = _quantities(error, values)
            if not places:
                raise
            values = replaced(kind, values, places, source)
            result = _adapter(kind).validate_python(values, context=trust)
    except (PydanticUserError, PydanticUndefinedAnnotation) as error:
        name, why = getattr(kind, "__name__", kind), " ".join(str(error).split())
        words = f"{name} cannot be read from keys; decorate it with @section ({why:.200})"
        raise BadInput(words, source) from None
    except ValidationError as error:
        refusal, name = _refusal(error, kind, values, source), _untrusted(error)
        raise (Untrusted(refusal, name) if name else BadInput(refusal)) from None
    for place, value in _booleans(values):  # which pydantic takes for 1 and 0
        found = _at(_adapter(kind).dump_python(result, warnings=False), place)
        if isinstance(found, int | float) and not isinstance(found, bool):
            raise BadInput("give a number", source, ".".join(map(str, place)), value)
    return result


def _booleans(values: Any, place: _Place = ()) -> Iterator[tuple[_Place, bool]]:
    """Find the booleans in nested settings, and where they stand."""
    if isinstance(values, bool):
        yield place, values
    elif isinstance(values, dict | list | tuple):
        parts = values.items() if isinstance(values, dict) else enumerate(values)
        for key, part in parts:
            yield from _booleans(part, (*place, key))


def _at(values: Any, place: _Place) -> Any:
    """Return what stands at a place; None: there is none such."""
    for key in place:
        try:
            values = values[key]
        except (LookupError, TypeError):
            return None
    return values


def plain(section_value: Any) -> Any:
    """Return a section as the dictionaries, lists and scalars that YAML holds."""
    return _adapter(type(section_value)).dump_python(section_value, mode="json")


def _adapter(kind: Any) -> TypeAdapter[Any]:
    """Return what checks a type; that of a section is made once."""
    if not isinstance(kind, type):
        return TypeAdapter(kind)
    if kind not in _ADAPTERS:
        _ADAPTERS[kind] = TypeAdapter(kind)
    return _ADAPTERS[kind]


def load_yaml(text: str, source: str) -> Any:
    """Return the content of a YAML text, with the place of a syntax error named.

    Raises:
        BadInput: the text is not YAML, or is more than can be used: see `bounded`.
    """
    try:
        if len(text) > _SHORT:
            _require_flat(text, source)
        return bounded(yaml.load(text, Loader=YamlLoader), source, len(text))
    except yaml.YAMLError as error:
        where = getattr(error, "problem_mark", None)
        line = f" line {where.line + 1}, column {where.column + 1}" if where else ""
        problem = str(getattr(error, "problem", None) or error)
        words = problem if isinstance(error, _DuplicateKeyError) else f"is not YAML: {problem}"
        raise BadInput(f"{source}:{line} {' '.join(words.split())}") from None
    except (ValueError, OverflowError, RecursionError) as error:  # no such date, 9**9**9, [[[
        raise BadInput(f"is not YAML: {error}", source) from None


def require_short(text: str, source: str) -> None:
    """Refuse a text that no log can hold.

    Raises:
        BadInput: it has more than LONGEST characters.
    """
    if len(text) > LONGEST:
        words = f"has {len(text):,} characters; a log holds at most {LONGEST:,}"
        raise BadInput(words, source)


def require_no_anchor(text: str, source: str) -> None:
    """Refuse aliases, which can make gigabytes of a few lines; a text that is no YAML passes.

    Raises:
        BadInput: the text has an anchor or an alias.
    """
    try:
        for event in yaml.parse(text, Loader=yaml.CSafeLoader):
            if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
                raise BadInput("has a YAML anchor; write the value at each place", source)
    except yaml.YAMLError:
        pass  # load_yaml names the place


def _require_flat(text: str, source: str) -> None:
    """Refuse deep nesting before the C loader descends into it: it overflows the stack."""
    depth = 0
    for event in yaml.parse(text, Loader=yaml.CSafeLoader):
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            raise BadInput(f"is nested more than {DEEPEST} deep", source)


def bounded(value: Any, source: str, length: int) -> Any:
    """Return what a YAML text holds, if it can be walked through.

    Aliases let a few lines stand for gigabytes, or hold themselves.

    Args:
        value: that was read.
        source: the file (or node) to name in an error.
        length: of the text; without aliases it holds no more values than characters.

    Raises:
        BadInput: it has more than 1,000,000 values for its aliases, or is nested more than 32 deep.
    """
    known: dict[int, tuple[float, float]] = {}

    def measure(part: Any) -> tuple[float, float]:
        """Return the values in a part and how deep it is nested."""
        if not isinstance(part, dict | list):
            return 1, 0
        if id(part) not in known:
            known[id(part)] = inf, inf  # where it holds itself
            inside = part.values() if isinstance(part, dict) else part
            sizes, depths = zip((0, 0), *map(measure, inside), strict=True)
            known[id(part)] = sum(sizes), 1 + max(depths)
        return known[id(part)]

    size, depth = measure(value)
    if depth > DEEPEST:
        raise BadInput(f"is nested more than {DEEPEST} deep, or is recursive", source)
    if size > max(_MOST, length):
        raise BadInput(f"holds more than {_MOST} values, aliases written out", source)
    return value


class _DuplicateKeyError(yaml.MarkedYAMLError):
    """A key stands twice in one mapping."""


class YamlLoader(yaml.CSafeLoader):
    """Reads plain data; of two equal keys YAML would silently keep the last."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Hashable, Any]:
        """Return the mapping of a node.

        Raises:
            _DuplicateKeyError: a key stands twice.
        """
        lines: dict[Hashable, int] = {}
        for key_node, _ in node.value if isinstance(node, yaml.MappingNode) else ():
            key = key_node.value
            if not isinstance(key, str) or key == "<<":
                continue
            if key in lines:
                words = f"duplicate key {key}, first in line {lines[key]}; remove one"
                raise _DuplicateKeyError(problem=words, problem_mark=key_node.start_mark)
            lines[key] = key_node.start_mark.line + 1
        return super().construct_mapping(node, deep)


class YamlDumper(yaml.CSafeDumper):
    """Writes every value where it stands: ROS and rosbag2 read no aliases."""

    def ignore_aliases(self, data: Any) -> bool:
        """Return True, always."""
        return True


# 1e-5, 1.0e3 and 1e-05, as Python and JSON write numbers: YAML 1.1 takes them for texts
_NUMBER = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)[eE][-+]?[0-9]+$")
for _side in (YamlLoader, YamlDumper):  # what is written as a text must come back as one
    _side.add_implicit_resolver("tag:yaml.org,2002:float", _NUMBER, [*"+-.0123456789"])
# 017 is 17 and 1:30 a text, as YAML 1.2 and JSON have it: YAML 1.1 reads 15 and 90
_OF_1_1 = re.compile(r"[-+]?(0[0-9_]+|[0-9][0-9_]*(:[0-5]?[0-9])+(\.[0-9_]*)?)$")
for _first, _resolvers in list(YamlLoader.yaml_implicit_resolvers.items()):
    if _first and _first in "+-0123456789":
        YamlLoader.yaml_implicit_resolvers[_first] = [
            ("tag:yaml.org,2002:str", _OF_1_1),
            *_resolvers,
        ]


def yaml_text(values: Any, flow: bool | None = None) -> str:
    """Return plain data as YAML without anchors, keys in their order.

    Args:
        values: dictionaries, lists and scalars.
        flow: True all on one line, None the innermost lists only, False nothing.
    """
    return str(yaml.dump(values, Dumper=YamlDumper, sort_keys=False, default_flow_style=flow))


def flat(values: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested settings as ROS parameters: dotted names; None and empty lists left out.

    A mapping without entries is the text {}: left out, it would come back as its default.
    """
    result: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, dict):
            result |= flat(value, f"{prefix}{key}.") if value else {prefix + key: "{}"}
        elif isinstance(value, list) and any(isinstance(entry, dict | list) for entry in value):
            result[prefix + key] = yaml_text(value, flow=True)
        elif value is not None and value != []:
            result[prefix + key] = value
    return result


def _refusal(error: ValidationError, kind: Any, values: Any, source: str) -> Refusal:
    """Return the first error; a key of nothing is the whole file."""
    first = error.errors()[0]
    place = [str(part) for part in first["loc"]]
    written = _written(first, values)
    key = ".".join(written) or WHOLE
    if first["type"] == "unexpected_keyword_argument":
        known = _known_keys(error, kind, place[:-1])
        hint = did_you_mean(place[-1], known)
        allowed = f"allowed here: {', '.join(known)}" if known else "remove it"
        return Refusal(f"unknown key; {hint}{allowed}", key, source=source)
    others = {_written(one, values) for one in error.errors()} - {_written(first, values)}
    more = f" (and {len(others)} more)" if others else ""
    if first["type"] in _MISSING and not isinstance(first["loc"][-1], int):
        return Refusal(f"is missing{more}", key, source=source)
    if first["type"] == "value_error" and isinstance(first["input"], dict):  # checked as a whole
        placed = not written or isinstance(first["ctx"]["error"], Placed)
        return Refusal(f"{_reason(first)}{more}", "" if placed else key, source=source)
    return Refusal(f"{_reason(first)}{more}", key, first["input"], source)


def _untrusted(error: ValidationError) -> str:
    """Return the class that the first error refuses to run; empty: it is another error."""
    cause = error.errors()[0].get("ctx", {}).get("error")
    refused = cause.__cause__ if isinstance(cause, Exception) else None
    return refused.name if isinstance(refused, Untrusted) else ""


def _quantities(error: ValidationError, values: Any) -> list[tuple[str, ...]]:
    """Return where a number is required, and a number with a unit is given."""
    wrong = [e for e in error.errors() if e["type"] in _NO_NUMBERS and is_quantity(e["input"])]
    return list(dict.fromkeys(_written(one, values) for one in wrong))


_NO_NUMBERS = ("float_type", "float_parsing", "int_type", "int_parsing", "tuple_type", "list_type")
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
        inside = isinstance(part, int) or (isinstance(values, dict) and part in values)
        missing = part == place[-1] and error["type"] in _MISSING
        if (inside and not (missing and isinstance(part, int))) or (missing and not inside):
            path.append(str(part))
        if inside:
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
