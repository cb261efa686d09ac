"""Groups of options: a frozen dataclass as a parameter of a command, a field for each option."""

import inspect
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import wraps
from typing import Any


def expand_options(command: Callable[..., None]) -> Callable[..., None]:
    """Return the command with an option for each field of its groups, in the order of both.

    Typer makes options of parameters. A group is a parameter whose type is a dataclass; its
    options come where it stands among the parameters.
    """
    signature = inspect.signature(command)
    groups: dict[str, type[Any]] = {
        name: parameter.annotation
        for name, parameter in signature.parameters.items()
        if isinstance(parameter.annotation, type) and is_dataclass(parameter.annotation)
    }

    @wraps(command)
    def run(**values: Any) -> None:
        for name, group in groups.items():
            options = {f.name for f in fields(group)} & values.keys()
            values[name] = group(**{option: values.pop(option) for option in options})
        command(**values)

    parameters: list[inspect.Parameter] = []
    for name, parameter in signature.parameters.items():
        group = inspect.signature(groups[name]).parameters if name in groups else {name: parameter}
        parameters += group.values()
    expanded = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in parameters]
    run.__dict__["__signature__"] = signature.replace(parameters=expanded)
    run.__annotations__ = {p.name: p.annotation for p in expanded} | {"return": None}
    return run
