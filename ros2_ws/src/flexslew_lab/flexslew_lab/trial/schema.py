"""The JSON schema of a trial file, by which an editor completes and checks it while it is typed."""

from collections.abc import Iterable
from typing import Any, Literal

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import core_schema

from flexslew_control.controllers import CONTROLLERS, CommonSettings
from flexslew_lab.trial.trial import Trial
from flexslew_plant.keys.settings_fields import describe_section
from flexslew_plant.keys.units import names_of, units_in

DIALECT = "https://json-schema.org/draft/2020-12/schema"
_PLACE = "#/$defs/{model}"
_PRODUCT = r"[^\d\s.]\S*[ /*^(·-].*"  # of units, as `deg/sqrt(h)`; the bench checks its kind
_NUMBER = r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?"


def trial_schema() -> dict[str, Any]:
    """Return the JSON schema of a trial file, every key with its meaning, bounds and default.

    Testbeds, plans and controllers of the user's own are let through: only the bench, which may
    load their code, can check their keys.
    """
    kinds: list[tuple[Any, Literal["validation"], TypeAdapter[Any]]] = [
        (kind, "validation", TypeAdapter(kind))
        for kind in (Trial, CommonSettings, *(entry.settings for entry in CONTROLLERS.values()))
    ]
    places, whole = TypeAdapter.json_schemas(
        kinds, schema_generator=_SchemaGenerator, ref_template=_PLACE
    )
    definitions = whole["$defs"]
    del definitions["Trust"]  # of no key
    trial = definitions.pop(places[Trial, "validation"]["$ref"].rpartition("/")[2])
    common = definitions.pop(places[CommonSettings, "validation"]["$ref"].rpartition("/")[2])
    laws = {}
    for name, entry in CONTROLLERS.items():
        place = places[entry.settings, "validation"]["$ref"]
        definition = definitions[place.rpartition("/")[2]]
        definition["properties"] |= common["properties"] | {"law": {"type": "string"}, "file": {}}
        laws[name] = {"$ref": place}
    trial["properties"]["controllers"] |= {
        "properties": {
            name: {"anyOf": [{"if": {"required": ["law"]}, "then": {}, "else": law}, _NULL]}
            for name, law in laws.items()
        },
        "additionalProperties": {
            "anyOf": [
                {"type": "object", "allOf": list(_options_of_tag("law", laws.items()))},
                _NULL,
            ]
        },
    }
    schema = _allow_user_types({"$schema": DIALECT, **trial, "$defs": definitions}, definitions)
    assert isinstance(schema, dict)
    return schema


_NULL = {"type": "null"}


class _SchemaGenerator(GenerateJsonSchema):
    """Adds to every key of a section what it means, and the quantities that it takes as text."""

    def dataclass_schema(self, schema: core_schema.DataclassSchema) -> dict[str, Any]:
        found: dict[str, Any] = super().dataclass_schema(schema)
        for key, description in describe_section(schema["cls"]).items():
            node = found.get("properties", {}).get(key)
            if node is None:
                continue
            units = units_in(description.words)
            names = [name for unit in units for name in names_of(unit)]
            node = _with_quantities(node, [*names, _PRODUCT]) if units else node
            found["properties"][key] = {**node, "description": description.description}
        return found


def _with_quantities(node: Any, units: list[str]) -> Any:
    """Return a schema that takes `57 deg` wherever it takes a number."""
    if isinstance(node, list):
        return [_with_quantities(one, units) for one in node]
    if not isinstance(node, dict):
        return node
    if node.get("type") == "number":
        metadata = {key: node[key] for key in ("default", "title") if key in node}
        number = {key: value for key, value in node.items() if key not in metadata}
        text = {"type": "string", "pattern": rf"^\s*{_NUMBER}\s*({'|'.join(units)})\s*$"}
        return {**metadata, "anyOf": [number, text]}
    inner = ("anyOf", "oneOf", "items", "prefixItems", "additionalProperties")
    return {k: _with_quantities(v, units) if k in inner else v for k, v in node.items()}


def _allow_user_types(node: Any, definitions: dict[str, Any]) -> Any:
    """Return a schema with unions that also take classes of the user's own, chosen by their key."""
    if isinstance(node, list):
        return [_allow_user_types(one, definitions) for one in node]
    if not isinstance(node, dict):
        return node
    node = {key: _allow_user_types(value, definitions) for key, value in node.items()}
    options = node.pop("oneOf", None)
    if options is None:
        return node
    if {} not in options:
        return node | {"anyOf": options}
    known = [one for one in options if one]
    kinds = [definitions[one["$ref"].rpartition("/")[2]]["properties"] for one in known]
    tag = next(key for key, value in kinds[0].items() if "const" in value)
    alternatives = _options_of_tag(
        tag, zip((kind[tag]["const"] for kind in kinds), known, strict=True)
    )
    names = [kind[tag]["const"] for kind in kinds]
    definition = {"type": "string", "pattern": ":"}
    return node | {
        "type": "object",
        "required": [tag],
        "properties": {tag: {"anyOf": [{"enum": names}, definition]}},
        "allOf": list(alternatives),
    }


def _options_of_tag(tag: str, options: Iterable[tuple[str, Any]]) -> Iterable[dict[str, Any]]:
    """Yield for each option that it holds where the tag names it."""
    for name, option in options:
        named = {"properties": {tag: {"const": name}}, "required": [tag]}
        yield {"if": named, "then": option}
