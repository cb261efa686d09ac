"""Sections of a trial file: one YAML section is one frozen dataclass, checked on the way in."""

from collections.abc import Iterator
from typing import Annotated, Any, TypeAlias, TypeVar, dataclass_transform

from pydantic import BeforeValidator, ConfigDict, Field, InstanceOf, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass, is_pydantic_dataclass
from pydantic.errors import PydanticUndefinedAnnotation, PydanticUserError
from pydantic.json_schema import SkipJsonSchema

from flexslew_plant.errors import BadInput
from flexslew_plant.keys.refused_keys import quantities, refusal_of, untrusted
from flexslew_plant.keys.units import convert_quantities
from flexslew_plant.own_code import NO_CODE, Trust, Untrusted
from flexslew_plant.yaml_data import yaml_text

_T = TypeVar("_T")
_Place = tuple[Any, ...]  # keys and places in lists, from the top on
_ADAPTERS: dict[Any, TypeAdapter[Any]] = {}
_CONTAINERS = (dict, list, tuple)
_SCALARS = frozenset((float, int, str, type(None)))

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


def validated(kind: Any, values: Any, source: str, trust: Trust = NO_CODE) -> Any:
    """Return values as an instance of the section `kind`; `2 min` is 120 where a key is in [s].

    Args:
        kind: a section class, or any other type that pydantic supports.
        values: the data from YAML or a ROS parameter.
        source: the file (or node) to name in an error.
        trust: the user's own classes that may be loaded; pydantic hands it to validators.

    Raises:
        BadInput: the first wrong key, with its value and what is allowed; the class is none that
            can be checked.
        Untrusted: it names code that is not trusted.
    """
    try:
        try:
            result = _adapter(kind).validate_python(values, context=trust)
        except ValidationError as error:
            places = quantities(error, values)
            if not places:
                raise
            values = convert_quantities(kind, values, places, source)
            result = _adapter(kind).validate_python(values, context=trust)
    except (PydanticUserError, PydanticUndefinedAnnotation) as error:
        name, why = getattr(kind, "__name__", kind), " ".join(str(error).split())
        words = f"{name} cannot be read from keys; decorate it with @section ({why:.200})"
        raise BadInput(words, source) from None
    except ValidationError as error:
        refusal, name = refusal_of(error, kind, values, source), untrusted(error)
        raise (Untrusted(refusal, name) if name else BadInput(refusal)) from None
    for place, value in _booleans((values,)):  # which pydantic takes for 1 and 0
        found = _at((_adapter(kind).dump_python(result, warnings=False),), place)
        if isinstance(found, int | float) and not isinstance(found, bool):
            raise BadInput("give a number", source, ".".join(map(str, place[1:])), value)
    return result


def _booleans(values: Any, place: _Place = ()) -> Iterator[tuple[_Place, bool]]:
    """Find the booleans in nested settings, and where they stand."""
    named = isinstance(values, dict)
    if _SCALARS.issuperset(map(type, values.values() if named else values)):  # most of them do
        return
    for key, part in values.items() if named else enumerate(values):
        if part is True or part is False:
            yield (*place, key), part
        elif isinstance(part, _CONTAINERS):  # few are: a call for each takes long
            yield from _booleans(part, (*place, key))


def _at(values: Any, place: _Place) -> Any:
    """Return what stands at a place; None: there is none such."""
    for key in place:
        try:
            values = values[key]
        except (LookupError, TypeError):
            return None
    return values


def is_section(value: Any) -> bool:
    """Return whether a value is an instance of a section."""
    return is_pydantic_dataclass(type(value))


def plain(section_value: Any) -> Any:
    """Return a section as the dictionaries, lists and scalars that YAML holds."""
    return _adapter(type(section_value)).dump_python(section_value, mode="json")


def _adapter(kind: Any) -> TypeAdapter[Any]:
    """Return what checks a type; it is made once, unless the type has no hash."""
    try:
        known = _ADAPTERS.get(kind)
    except TypeError:
        return TypeAdapter(kind)
    if known is None:
        known = _ADAPTERS[kind] = TypeAdapter(kind)
    return known


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
