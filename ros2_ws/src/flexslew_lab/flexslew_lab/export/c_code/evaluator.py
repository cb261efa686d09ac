"""Python functions carried out on the numbers of a C program, which so writes itself.

What is known beforehand is computed by Python; what depends on inputs or memory is written as C.
Loops over ranges become loops, or are written out where their body needs the number; conditions
become branches, after which values that differ are merged.
"""

import ast
import inspect
from collections import deque
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from types import MethodType
from typing import Any, NamedTuple

import numpy as np

from flexslew_lab.export.c_code.operations import Operations
from flexslew_lab.export.c_code.program import Branch
from flexslew_lab.export.c_code.sources import (
    Closure,
    definition,
    free_names,
    python_function,
)
from flexslew_lab.export.c_code.values import (
    POISON,
    Array,
    Computed,
    ConcreteRequired,
    Poison,
    Scalar,
    Shape,
    Unsupported,
    children,
    is_symbolic,
    row_major,
)

Replacement = Callable[..., Any]  # (evaluator, *arguments)
_OWN = "flexslew_"  # packages whose functions are written out
_DEPTH = 4  # of objects in which attributes that change are looked for


class Method(NamedTuple):
    """A method of a value of the C program."""

    name: str
    owner: Any


@dataclass
class CallFrame:
    """The names of a call, and its result."""

    globals: dict[str, Any]
    surroundings: dict[str, Any]
    function: Any
    names: dict[str, Any] = field(default_factory=dict)
    result: Any = None


@dataclass(frozen=True)
class Variable:
    """A local name that a loop of the program changes: numbers and arrays that C writes again."""

    value: Any


class Language(NamedTuple):
    """How statements and expressions are carried out; see statements.LANGUAGE."""

    run: Callable[["Evaluator", Sequence[Any], CallFrame], int]
    value_of: Callable[["Evaluator", ast.expr, CallFrame], Any]
    assign: Callable[["Evaluator", ast.expr, Any, CallFrame], None]


class Evaluator:
    """Carries functions out.

    Args:
        language: statements and expressions.
        replacements: functions by identity, that are not carried out as they stand.
        methods: methods of arrays, by name.

    Attributes:
        attributes: those that objects have got since the start, by object and name.
        starts: those that are memory of the program from its start on, with their values then
            and those of their entries that never change.
        parameters: those that are parameters of the program.
    """

    def __init__(
        self,
        language: Language,
        replacements: dict[Any, Replacement],
        methods: dict[str, Replacement],
    ) -> None:
        self.language = language
        self.ops = Operations()
        self.replacements, self.methods = replacements, methods
        self.attributes: dict[tuple[int, str], Any] = {}
        self.objects: dict[int, Any] = {}  # keeps what `attributes` means alive
        self.starts: dict[tuple[int, str], tuple[Any, Mapping[int, float]]] = {}
        self.parameters: dict[tuple[int, str], Array | Scalar] = {}
        self.branches = 0  # in how many branches and loops of the program the present place is
        self.loops = 0
        self.place: list[str] = []  # names of the functions that are carried out
        self._stateful: dict[int, bool] = {}

    def keep(self, owner: Any, name: str, known: Mapping[int, float] | None = None) -> None:
        """Make an attribute, an array, memory of the program from its start on.

        Args:
            owner: the object.
            name: of the attribute.
            known: entries that are never changed, by their places.
        """
        self.objects[id(owner)] = owner
        self.starts[id(owner), name] = getattr(owner, name), known or {}

    def read_parameter(self, owner: Any, name: str, shape: Shape) -> None:
        """Make an attribute, of any shape, a parameter of the program with the same name."""
        self.objects[id(owner)] = owner
        parameter = Array(f"memory->parameters.{name}", shape, row_major(shape))
        number = Scalar(f"{parameter.name}[0]", atom=True)
        self.parameters[id(owner), name] = parameter if shape else number

    def get(self, owner: Any, name: str) -> Any:
        """Return an attribute."""
        if isinstance(owner, Array | Computed):
            if name in ("shape", "size", "ndim", "T"):
                array = owner if isinstance(owner, Array) else self.ops.array(owner)
                return getattr(array, name)
            return Method(name, owner)
        if isinstance(owner, np.ndarray) and name in self.methods:
            return Method(name, owner)
        if isinstance(owner, Scalar):
            raise Unsupported(f"attribute {name} of a number")
        key = id(owner), name
        if key in self.parameters or key in self.attributes:
            found = self.parameters.get(key, self.attributes.get(key))
            if isinstance(found, Poison):
                raise Unsupported(f"{type(owner).__name__}.{name}, set in one of two branches")
            return found
        if isinstance(owner, list | deque) and name in ("append", "popleft", "pop"):
            return Method(name, owner)
        kind = inspect.getattr_static(type(owner), name, None)
        if isinstance(kind, property) and kind.fget and self._interprets(owner):
            return self.call(kind.fget, [owner])
        if isinstance(kind, cached_property) and self.is_stateful(owner):
            return self.call(kind.func, [owner])
        value = getattr(owner, name)
        if isinstance(value, deque):
            value = self.attributes[id(owner), name] = list(value)
            self.objects[id(owner)] = owner
        return value

    def _interprets(self, owner: Any) -> bool:
        own = type(owner).__module__.startswith(_OWN)
        return own and (is_symbolic(owner) or self.is_stateful(owner))

    def set(self, owner: Any, name: str, value: Any) -> None:
        """Set an attribute."""
        if self.loops:
            raise ConcreteRequired(f"attribute {name} set in a loop")
        if (id(owner), name) not in self.attributes:
            self._stateful.clear()
        self.objects[id(owner)] = owner
        value = list(value) if isinstance(value, deque) else value
        self.attributes[id(owner), name] = self.ops.materialised(value)

    def is_stateful(self, value: Any, depth: int = 0) -> bool:
        """Return whether an object, or one that it holds, has attributes that change."""
        if id(value) in self.objects:
            return True
        if depth > _DEPTH:
            return False
        if isinstance(value, tuple | list | dict):
            return any(self.is_stateful(part, depth + 1) for part in children(value))
        if not type(value).__module__.startswith(_OWN):
            return False
        if id(value) not in self._stateful:
            self._stateful[id(value)] = False
            parts = vars(value).values() if hasattr(value, "__dict__") else ()
            self._stateful[id(value)] = any(self.is_stateful(part, depth + 1) for part in parts)
        return self._stateful[id(value)]

    def call(
        self, function: Any, arguments: Sequence[Any], named: dict[str, Any] | None = None
    ) -> Any:
        """Return what a function gives."""
        named = named or {}
        if isinstance(function, Method):
            return self._method(function, arguments, named)
        if isinstance(function, Hashable) and not type(function).__module__.startswith(_OWN):
            replacement = self.replacements.get(function)
            if replacement is not None:
                return replacement(self, *arguments, **named)
        if isinstance(function, partial):
            arguments = [*function.args, *arguments]
            return self.call(function.func, arguments, {**function.keywords, **named})
        if isinstance(function, Closure):
            return self._carry_out(function.node, function, arguments, named)
        owner = getattr(function, "__self__", None)
        depends = self._needs(owner, arguments, named) or self.is_stateful(function)
        if not (depends or isinstance(owner, list)):
            return function(*arguments, **named)
        return self._carried_out(function, owner, arguments, named)

    def _carried_out(
        self, function: Any, owner: Any, arguments: Sequence[Any], named: dict[str, Any]
    ) -> Any:
        """Return what a function gives that depends on the C program's numbers."""
        is_method = isinstance(function, MethodType) and python_function(function.__func__)
        if is_method and (not isinstance(owner, tuple) or function.__module__.startswith(_OWN)):
            return self.call(function.__func__, [owner, *arguments], named)
        found = python_function(function)
        if found is None and type(function).__module__.startswith(_OWN):
            return self.call(type(function).__call__, [function, *arguments], named)
        if found is not None and found.__module__.startswith(_OWN):
            return self._carry_out(definition(found.__code__), found, arguments, named)
        is_record = isinstance(function, type) and issubclass(function, tuple)
        is_container = isinstance(owner, dict | tuple | list)
        is_copy = getattr(function, "__name__", "") in ("_replace", "_make")
        if is_record or is_container or is_copy:
            arguments = [self.ops.materialised(one) for one in arguments]
            return function(*arguments, **{k: self.ops.materialised(v) for k, v in named.items()})
        where = f" of {found.__module__}, which is Python" if found is not None else ""
        raise Unsupported(f"{getattr(function, '__qualname__', function)}{where}")

    def _needs(self, owner: Any, arguments: Sequence[Any], named: dict[str, Any]) -> bool:
        """Return whether a call depends on the C program's numbers."""
        given = [owner, *arguments, *named.values()]
        return any(is_symbolic(one) or isinstance(one, Closure) for one in given) or any(
            self.is_stateful(one) for one in given
        )

    def _method(self, method: Method, arguments: Sequence[Any], named: dict[str, Any]) -> Any:
        if isinstance(method.owner, list):
            if self.branches:
                raise Unsupported(f"a list that changes in a branch ({method.name})")
            parts = [self.ops.materialised(one) for one in arguments]
            if method.name == "append":
                return method.owner.append(*parts)
            return method.owner.pop(0 if method.name == "popleft" else -1)
        is_copy = method.name == "copy"  # it will be written into
        if isinstance(method.owner, np.ndarray) and not (is_copy or is_symbolic(arguments)):
            return getattr(method.owner, method.name)(*arguments, **named)
        if method.name not in self.methods:
            raise Unsupported(f"method {method.name} of an array")
        return self.methods[method.name](self, method.owner, *arguments, **named)

    def _carry_out(
        self, node: Any, function: Any, arguments: Sequence[Any], named: dict[str, Any]
    ) -> Any:
        arguments = [self.ops.materialised(one) for one in arguments]
        named = {key: self.ops.materialised(value) for key, value in named.items()}
        root, surroundings = function, dict[str, Any]()
        while isinstance(root, Closure):
            surroundings = {**root.names, **surroundings}
            root = root.function
        surroundings = {**free_names(root), **surroundings}
        frame = CallFrame(root.__globals__, surroundings, function)
        frame.names.update(self._bound(node, function, arguments, named, frame))
        name = getattr(node, "name", "a lambda")
        self.place.append(name)
        if isinstance(node, ast.Lambda):
            result = self.ops.materialised(self.language.value_of(self, node.body, frame))
        else:
            self.language.run(self, node.body, frame)
            result = frame.result
        self.place.pop()
        return result

    def _bound(
        self, node: Any, function: Any, arguments: Sequence[Any], named: Any, frame: Any
    ) -> dict[str, Any]:
        """Return the arguments of a call by name."""
        if not isinstance(function, Closure):
            bound = inspect.signature(function).bind(*arguments, **named)
            bound.apply_defaults()
            return dict(bound.arguments)
        names = [argument.arg for argument in (*node.args.posonlyargs, *node.args.args)]
        defaults = node.args.defaults
        found = {
            name: self.language.value_of(self, default, frame)
            for name, default in zip(names[len(names) - len(defaults) :], defaults, strict=True)
        }
        return {**found, **dict(zip(names, arguments, strict=False)), **named}

    def branch(
        self, test: Scalar, yes: Callable[[], Any], no: Callable[[], Any]
    ) -> tuple[Any, Any, Branch]:
        """Write a branch, and merge the attributes that its blocks set.

        Returns:
            what `yes` and `no` give, and the branch, of which values are merged at its place.
        """
        test, outside, before = self.ops.temporary(test), self.ops.block, self.attributes
        node, results, after = Branch(test.text), [], []
        self.branches += 1
        for block, action in ((node.yes, yes), (node.no, no)):
            self.ops.block, self.attributes = block, dict(before)
            results.append(action())
            after.append(self.attributes)
        self.branches -= 1
        self.ops.block = outside
        self.attributes = self._merged_attributes(before, after[0], after[1], node)
        return results[0], results[1], node

    def _merged_attributes(self, before: Any, one: Any, other: Any, node: Branch) -> Any:
        merged = {}
        for key in {**one, **other}:
            owner, name = self.objects[key[0]], key[1]
            default = before.get(key, getattr(owner, name, POISON))
            try:
                a, b = one.get(key, default), other.get(key, default)
                merged[key] = self.ops.merged(a, b, node, self.ops.block)
            except Unsupported:
                merged[key] = POISON
        return merged
