"""The parameters of a node as one settings section: described, checked, some set at run time."""

from array import array
from collections.abc import Callable, Iterable
from itertools import permutations
from math import ceil, inf, isfinite, nextafter
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter

from flexslew_plant.errors import BadInput
from flexslew_plant.keys.settings_fields import FieldDescription, describe_fields
from flexslew_plant.own_code import ANY_CODE
from flexslew_plant.settings import flat, plain, validated
from flexslew_plant.yaml_data import load_yaml, yaml_text

_ROS = ("use_sim_time", "qos_overrides", "start_type_description")  # parameters of ROS itself
_UNSET = "null"  # as which a dump of parameters writes, and ROS reads, what has no value
_ABOVE_ZERO = nextafter(0.0, inf)  # least value of a field that must be more than 0
_AT_START = "read at the start; restart the node to change it"

Change = Callable[[dict[str, Any]], str]  # takes nested changes; returns why not, or ""


def new_node(name: str) -> Node:
    """Return a node that takes any parameter at its start; `settings_of` validates them.

    Args:
        name: default, which the command line may override.
    """
    node = Node(
        name,
        allow_undeclared_parameters=True,
        automatically_declare_parameters_from_overrides=True,
    )
    for service in node.services:
        if service.srv_type in (SetParameters, SetParametersAtomically):
            service.callback = _with_known_types(service.callback)
    return node


def _with_known_types(answer: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Return a service of rclpy that refuses values of a type that ROS has not: they would end it.

    Args:
        answer: sets parameters, one by one or all together.
    """

    def validate_and_answer(request: Any, reply: Any) -> Any:
        try:
            _typed(request.parameters)
        except BadInput as error:
            result = SetParametersResult(successful=False, reason=str(error))
            if hasattr(reply, "results"):
                reply.results = [result] * len(request.parameters)
            else:
                reply.result = result
            return reply
        return answer(request, reply)

    return validate_and_answer


def _typed(values: Iterable[Any]) -> "list[Parameter[Any]]":
    """Return rcl_interfaces/Parameter as rclpy has them.

    Raises:
        BadInput: a value has a type that ROS has not.
    """
    given = []
    for value in values:
        try:
            given.append(Parameter.from_parameter_msg(value))
        except ValueError:
            words = f"{value.name} has type {value.value.type}, which is none of ParameterType"
            raise BadInput(words, "values") from None
    return given


def parameters_of(node: Node) -> dict[str, Any]:
    """Return what the node was given, nested by the dots of the names."""
    return nested(
        node,
        (p for name, p in node.get_parameters_by_prefix("").items() if not name.startswith(_ROS)),
    )


def nested(node: Node, parameters: Iterable["Parameter[Any]"]) -> dict[str, Any]:
    """Return parameters as plain data, nested by the dots of their names."""
    given: dict[str, Any] = {}
    for parameter in parameters:
        *path, last = parameter.name.split(".")
        place = given
        for part in path:
            place = place.setdefault(part, {})
        value = None if parameter.value == _UNSET else parameter.value
        if isinstance(value, str) and (value.startswith("[") or value == "{}"):
            value = load_yaml(value, f"node {node.get_name()}: {parameter.name}")
        place[last] = value.tolist() if isinstance(value, array) else value
    return given


def requested_text(node: Node, key: str, text: str, values: Iterable[Any]) -> str:
    """Return the YAML of a request: as it was given, or of its typed values.

    Args:
        node: that serves it.
        key: of the text in the request.
        text: YAML; empty where there are typed values.
        values: rcl_interfaces/Parameter, nested by the dots of their names.

    Raises:
        BadInput: both are given, a name stands twice, or a value has a type that ROS has not.
    """
    given = _typed(values)
    if not given:
        return text
    if text:
        raise BadInput(f"give {key} or values, not both", "values")
    names = [parameter.name for parameter in given]
    for name, other in permutations(names, 2):
        if f"{name}.".startswith(f"{other}."):
            raise BadInput(f"{name} stands twice", "values")
    return yaml_text(nested(node, given))


def declared(node: Node, kind: Any, given: dict[str, Any], dynamic: Iterable[str] = ()) -> Any:
    """Return `given` as a section and declare all its keys as parameters.

    Nested sections are dotted names; what ROS cannot hold (a list of sections) is YAML text.

    Args:
        node: node that declares the parameters.
        kind: the section.
        given: values set by the user.
        dynamic: names that may change at run time; the others are read-only.

    Raises:
        BadInput: for an unknown parameter or a value that is not allowed.
    """
    settings = validated(kind, given, f"node {node.get_name()}", ANY_CODE)
    declare(node, settings, dynamic)
    return settings


def settings_of(node: Node, kind: Any, dynamic: Iterable[str] = ()) -> Any:
    """Return all parameters of the node as one section; see declared."""
    return declared(node, kind, parameters_of(node), dynamic)


def declare(node: Node, settings: Any, dynamic: Iterable[str] = ()) -> None:
    """Declare the keys of a section as parameters, with words, range and value."""
    dynamic_names, words, values = set(dynamic), describe_fields(settings), plain(settings)
    unset = {name: None for name in words if _at(values, name) is None}
    for name, value in {**flat(values), **unset}.items():
        descriptor = _descriptor(name, value, words.get(name), name in dynamic_names)
        if node.has_parameter(name):  # given: 2 where a 2.0 is meant has another type
            node.undeclare_parameter(name)
        node.declare_parameter(name, value, descriptor, ignore_override=True)


def handle_changes(node: Node, change: Change) -> None:
    """Pass on what is set in flight; unknown names are refused, read-only ones by ROS itself."""

    def on_set(parameters: list["Parameter[Any]"]) -> SetParametersResult:
        unknown = [p.name for p in parameters if not node.has_parameter(p.name)]
        if unknown:
            known = ", ".join(sorted(node.get_parameters_by_prefix("")))
            words = f"unknown parameter {unknown[0]}; known: {known}"
            return SetParametersResult(successful=False, reason=words)
        user_parameters = [p for p in parameters if not p.name.startswith(_ROS)]
        reason = change(nested(node, user_parameters)) if user_parameters else ""
        return SetParametersResult(successful=not reason, reason=reason)

    node.add_on_set_parameters_callback(on_set)


def _at(values: Any, name: str) -> Any:
    """Return the value at a dotted name; "" where a section on the way is no dictionary."""
    for part in name.split("."):
        values = values.get(part) if isinstance(values, dict) else ""
    return values


def _descriptor(
    name: str, value: Any, field_info: FieldDescription | None, dynamic: bool
) -> ParameterDescriptor:
    """Return a descriptor of its own: rclpy writes the parameter's name into it."""
    descriptor = ParameterDescriptor(name=name, read_only=not dynamic)
    descriptor.dynamic_typing = value is None
    constraints = [] if dynamic else [_AT_START]
    if field_info is not None:
        descriptor.description = field_info.words
        if not isinstance(value, bool):
            _limit(descriptor, value, field_info)
            constraints = [words for words in (_bounds(field_info), *constraints) if words]
    descriptor.additional_constraints = "; ".join(constraints)
    return descriptor


def _limit(descriptor: ParameterDescriptor, value: Any, field_info: FieldDescription) -> None:
    """Give a descriptor the range of a number that is limited at both ends; ROS has no other."""
    low, high = field_info.low, field_info.high
    if not (isfinite(low) and isfinite(high)):
        return
    if isinstance(value, float):
        least = 0.0 if low == _ABOVE_ZERO else low  # zero is refused: _bounds
        limits = FloatingPointRange(from_value=least, to_value=high, step=0.0)
        descriptor.floating_point_range = [limits]
    elif isinstance(value, int):
        descriptor.integer_range = [IntegerRange(from_value=ceil(low), to_value=int(high), step=1)]


def _bounds(field_info: FieldDescription) -> str:
    """Return which numbers are allowed, in words; empty: all."""
    low, high = field_info.low, field_info.high
    least = "more than 0" if low == _ABOVE_ZERO else f"{low:g} or more"
    if isfinite(low) and isfinite(high):
        return f"{least}, at most {high:g}"
    return least if isfinite(low) else f"at most {high:g}" if isfinite(high) else ""
