"""The parameters of a node as one settings section."""

from array import array
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

from flexslew_plant.settings import flat, load_yaml, plain, validated


def new_node(name: str) -> Node:
    """Return a node that takes any parameter; `settings_of` says which are right.

    Args:
        name: unless the command line says another one.
    """
    return Node(
        name,
        allow_undeclared_parameters=True,
        automatically_declare_parameters_from_overrides=True,
    )


def parameters_of(node: Node) -> dict[str, Any]:
    """Return what the node was given, nested by the dots of the names."""
    given: dict[str, Any] = {}
    for name, parameter in node.get_parameters_by_prefix("").items():
        if name == "use_sim_time" or name.startswith(("qos_overrides", "start_type_description")):
            continue
        *path, last = name.split(".")
        place = given
        for part in path:
            place = place.setdefault(part, {})
        value = parameter.value
        if isinstance(value, str) and value.startswith("["):
            value = load_yaml(value, f"node {node.get_name()}: {name}")
        place[last] = value.tolist() if isinstance(value, array) else value
    return given


def declared(node: Node, kind: Any, given: dict[str, Any]) -> Any:
    """Return `given` as a section and declare the parameters that were left out.

    Nested sections are dotted names; what ROS cannot hold (a list of sections) is YAML text.

    Raises:
        BadInput: an unknown parameter or a value that is not allowed.
    """
    settings = validated(kind, given, f"node {node.get_name()}")
    for name, value in flat(plain(settings)).items():
        if not node.has_parameter(name):
            # rclpy writes the parameter's name into the descriptor, so each needs its own
            node.declare_parameter(name, value, ParameterDescriptor(read_only=True))
    return settings


def settings_of(node: Node, kind: Any) -> Any:
    """Return all parameters of the node as one section; see declared."""
    return declared(node, kind, parameters_of(node))
