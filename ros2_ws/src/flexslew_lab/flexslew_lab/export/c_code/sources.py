"""The syntax trees of Python functions, of their files read once."""

import ast
import inspect
from dataclasses import dataclass
from functools import cache
from types import CodeType, FunctionType
from typing import Any, TypeAlias

from flexslew_lab.export.c_code.values import Unsupported

Definition: TypeAlias = ast.FunctionDef | ast.Lambda


@dataclass(frozen=True, eq=False)
class Closure:
    """A function that was defined while another one was evaluated.

    Args:
        node: its definition.
        names: the local names around it.
        function: the function that it is in.
    """

    node: Definition
    names: dict[str, Any]
    function: Any


@cache
def _definitions(path: str) -> list[Definition]:
    with open(path, encoding="utf-8") as file:
        tree = ast.parse(file.read())
    return [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.Lambda)]


@cache
def definition(code: CodeType) -> Definition:
    """Return the definition of a function.

    Raises:
        Unsupported: if its source is not there, or a line has two of that kind.
    """
    try:
        path = inspect.getsourcefile(code)
        known = _definitions(path) if path else []
    except (OSError, TypeError, SyntaxError):
        known = []
    names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
    found = []
    for node in known:
        lines = [node.lineno]
        if isinstance(node, ast.FunctionDef):
            if node.name != code.co_name:
                continue
            lines += [decorator.lineno for decorator in node.decorator_list]
        elif code.co_name != "<lambda>":
            continue
        arguments = [
            a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
        ]
        if code.co_firstlineno in lines and arguments == list(names):
            found.append(node)
    if len(found) != 1:
        raise Unsupported(f"{code.co_name}, whose source cannot be found")
    return found[0]


def python_function(function: Any) -> FunctionType | None:
    """Return the Python function behind a compiled or wrapped one; None: there is none."""
    function = getattr(function, "py_func", function)
    return function if isinstance(function, FunctionType) else None


def free_names(function: FunctionType) -> dict[str, Any]:
    """Return the names of a function's surroundings, and their values."""
    cells = function.__closure__ or ()
    names = zip(function.__code__.co_freevars, cells, strict=True)
    return {name: cell.cell_contents for name, cell in names}
