"""Sections of a trial file: one YAML section is one frozen dataclass, checked on the way in."""

import difflib
from typing import Annotated, Any, TypeVar, dataclass_transform

import yaml
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from flexslew_plant.errors import BadInput

_T = TypeVar("_T")

Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]
Probability = Annotated[float, Field(ge=0.0, le=1.0)]


@dataclass_transform(frozen_default=True, kw_only_default=True)
def section(cls: type[_T]) -> type[_T]:
    """Return cls as a frozen dataclass that refuses unknown keys and non-finite numbers."""
    config = ConfigDict(extra="forbid", allow_inf_nan=False, validate_default=False)
    return dataclass(frozen=True, kw_only=True, config=config)(cls)  # type: ignore[return-value]


def validated(kind: Any, values: Any, source: str) -> Any:
    """Return values as an instance of the section `kind`.

    Args:
        kind: a section class, or any type that pydantic knows.
        values: what YAML or a ROS parameter gave.
        source: the file (or node) to name in an error.

    Raises:
        BadInput: the first wrong key, with its value and what is allowed.
    """
    try:
        return TypeAdapter(kind).validate_python(values)
    except ValidationError as error:
        raise BadInput(_one_line(error, kind, values, source)) from None


def plain(section_value: Any) -> Any:
    """Return a section as the dictionaries, lists and scalars that YAML holds."""
    return TypeAdapter(type(section_value)).dump_python(section_value, mode="json")


def load_yaml(text: str, source: str) -> Any:
    """Return the content of a YAML text, with the place of a syntax error named.

    Raises:
        BadInput: the text is not YAML.
    """
    try:
        return yaml.load(text, Loader=yaml.CSafeLoader)
    except yaml.YAMLError as error:
        where = getattr(error, "problem_mark", None)
        line = f" line {where.line + 1}, column {where.column + 1}" if where else ""
        raise BadInput(f"{source}:{line} is not YAML: {getattr(error, 'problem', error)}") from None


class _Plain(yaml.CSafeDumper):
    """Writes every value where it stands: ROS and rosbag2 read no aliases."""

    def ignore_aliases(self, data: Any) -> bool:
        """Return True, always."""
        return True


def yaml_text(values: Any, flow: bool | None = None) -> str:
    """Return plain data as YAML without anchors, keys in their order.

    Args:
        values: dictionaries, lists and scalars.
        flow: True all on one line, None the innermost lists only, False nothing.
    """
    return str(yaml.dump(values, Dumper=_Plain, sort_keys=False, default_flow_style=flow))


def flat(values: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested settings as ROS parameters: dotted names; None and empty lists left out."""
    result: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, dict):
            result |= flat(value, f"{prefix}{key}.")
        elif isinstance(value, list) and any(isinstance(entry, dict | list) for entry in value):
            result[prefix + key] = yaml_text(value, flow=True)
        elif value is not None and value != []:
            result[prefix + key] = value
    return result


def _one_line(error: ValidationError, kind: Any, values: Any, source: str) -> str:
    """Say the first error as `file: key: value is not allowed: why`."""
    first = error.errors()[0]
    place = [str(part) for part in first["loc"]]
    key = ".".join(_written(first["loc"], values)) or "(whole file)"
    if first["type"] == "unexpected_keyword_argument":
        known = _known_keys(error, kind, place[:-1])
        close = difflib.get_close_matches(place[-1], known, n=1)
        hint = f"did you mean {close[0]}? " if close else ""
        allowed = f"allowed here: {', '.join(known)}" if known else "remove it"
        return f"{source}: {key}: unknown key; {hint}{allowed}"
    more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    value = repr(first["input"])
    value = value if len(value) <= 60 else value[:57] + "..."
    return f"{source}: {key}: {value} is not allowed: {first['msg']}{more}"


def _written(place: tuple[int | str, ...], values: Any) -> list[str]:
    """Return the path as the file has it: without the tags of unions."""
    path = []
    for part in place:
        inside = isinstance(part, int) or (isinstance(values, dict) and part in values)
        if inside or part == place[-1]:
            path.append(str(part))
        if inside:
            try:
                values = values[part]
            except (LookupError, TypeError):
                values = None
    return path


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
