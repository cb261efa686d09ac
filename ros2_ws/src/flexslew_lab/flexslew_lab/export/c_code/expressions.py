"""Expressions of Python functions, carried out by the evaluator."""

import ast
import builtins
from collections.abc import Callable
from typing import Any

import numpy as np

from flexslew_lab.export.c_code.evaluator import Evaluator, Variable
from flexslew_lab.export.c_code.indexing import item
from flexslew_lab.export.c_code.operations import is_array, require_concrete
from flexslew_lab.export.c_code.sources import Closure
from flexslew_lab.export.c_code.values import (
    Array,
    Computed,
    ConcreteRequired,
    Scalar,
    Tick,
    Unsupported,
    is_symbolic,
)

_BINARY = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.MatMult: "@", ast.Pow: "**",
    ast.FloorDiv: "//", ast.Mod: "%", ast.BitAnd: "&", ast.BitOr: "|",
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
}  # fmt: skip


def value_of(e: Evaluator, node: ast.expr, frame: Any) -> Any:
    """Return the value of an expression."""
    found = _KINDS.get(type(node))
    if found is None:
        raise Unsupported(f"the expression `{ast.unparse(node)[:60]}`")
    return found(e, node, frame)


def truth(e: Evaluator, value: Any) -> bool | Scalar:
    """Return whether a value counts as true, or the condition of the program."""
    if isinstance(value, Array | Computed):
        if value.shape not in ((), (1,)):
            raise Unsupported("an array as a condition")
        return Scalar(f"({e.ops.entries(value)[1](('0',) * len(value.shape))} != 0.0)", "b")
    if isinstance(value, Scalar):
        return value if value.kind == "b" else Scalar(f"({value.text} != 0)", "b")
    if isinstance(value, Tick):
        return Scalar(f"({e.ops.text(value)} != 0)", "b")
    return bool(value)


def items_of(e: Evaluator, value: Any) -> list[Any]:
    """Return the items of what a loop or an assignment goes through."""
    if isinstance(value, Array | Computed):
        array = e.ops.array(value)
        return [e.ops.materialised(item(e.ops, array, k)) for k in range(len(array))]
    if isinstance(value, Scalar):
        raise ConcreteRequired("the items of a number")
    return list(value)


def _name(e: Evaluator, node: Any, frame: Any) -> Any:
    for names in (frame.names, frame.surroundings, frame.globals):
        if node.id in names:
            found = names[node.id]
            return found.value if isinstance(found, Variable) else found
    if hasattr(builtins, node.id):
        return getattr(builtins, node.id)
    raise Unsupported(f"{node.id}, which has no value or one that depends on a branch")


def _binary(e: Evaluator, node: Any, frame: Any) -> Any:
    left, right = value_of(e, node.left, frame), value_of(e, node.right, frame)
    return e.ops.binary(_BINARY[type(node.op)], left, right)


def _unary(e: Evaluator, node: Any, frame: Any) -> Any:
    value = value_of(e, node.operand, frame)
    if isinstance(node.op, ast.Not):
        test = truth(e, value)
        return Scalar(f"(!{test.text})", "b") if isinstance(test, Scalar) else not test
    if not is_symbolic(value):
        return -value if isinstance(node.op, ast.USub) else ~value
    if isinstance(node.op, ast.USub):
        if is_array(value):
            shape, entry, kind = e.ops.entries(value)
            return Computed(shape, lambda index: f"(-{entry(index)})", kind)
        return Scalar(f"(-{e.ops.text(value)})", e.ops.kind(value))
    raise Unsupported(ast.unparse(node))


def _connective(e: Evaluator, node: Any, frame: Any) -> Any:
    is_and, tests = isinstance(node.op, ast.And), list[str]()
    value: Any = is_and
    for part in node.values:
        value = value_of(e, part, frame)
        test = truth(e, value)
        if isinstance(test, Scalar):
            tests.append(test.text)
        elif test != is_and:
            return value if not tests else test
    if not tests:
        return value
    return Scalar(f"({(' && ' if is_and else ' || ').join(tests)})", "b")


def _compare(e: Evaluator, node: Any, frame: Any) -> Any:
    left, tests = value_of(e, node.left, frame), list[Any]()
    for op, comparator in zip(node.ops, node.comparators, strict=True):
        right = value_of(e, comparator, frame)
        if isinstance(op, ast.Is | ast.IsNot):
            same = left is right
            tests.append(same if isinstance(op, ast.Is) else not same)
        elif isinstance(op, ast.In | ast.NotIn):
            found = require_concrete(left, "a member") in right
            tests.append(found if isinstance(op, ast.In) else not found)
        else:
            tests.append(e.ops.binary(_BINARY[type(op)], left, right))
        left = right
    if len(tests) == 1:
        return tests[0]
    if any(test is False for test in tests):
        return False
    texts = [test.text for test in tests if isinstance(test, Scalar)]
    return Scalar(f"({' && '.join(texts)})", "b") if texts else True


def _choice(e: Evaluator, node: Any, frame: Any) -> Any:
    test = truth(e, value_of(e, node.test, frame))
    if isinstance(test, Scalar):
        test = e.ops.temporary(test)
        yes, no = value_of(e, node.body, frame), value_of(e, node.orelse, frame)
        return e.ops.select(test, yes, no)
    return value_of(e, node.body if test else node.orelse, frame)


def _call(e: Evaluator, node: Any, frame: Any) -> Any:
    function = value_of(e, node.func, frame)
    if function is isinstance:
        value, kinds = (value_of(e, argument, frame) for argument in node.args)
        return isinstance(np.zeros(0) if isinstance(value, Array | Computed) else value, kinds)
    if function is getattr:
        owner, name, *default = (value_of(e, argument, frame) for argument in node.args)
        return _attribute(e, owner, name, default)
    arguments = list[Any]()
    for argument in node.args:
        if isinstance(argument, ast.Starred):
            arguments += items_of(e, value_of(e, argument.value, frame))
        else:
            arguments.append(value_of(e, argument, frame))
    named = dict[str, Any]()
    for keyword in node.keywords:
        value = value_of(e, keyword.value, frame)
        named.update(value if keyword.arg is None else {keyword.arg: value})
    return e.call(function, arguments, named)


def _attribute(e: Evaluator, owner: Any, name: str, default: list[Any]) -> Any:
    try:
        return e.get(owner, name)
    except AttributeError:
        if default:
            return default[0]
        raise


def _subscript(e: Evaluator, node: Any, frame: Any) -> Any:
    owner = value_of(e, node.value, frame)
    return item(e.ops, owner, value_of(e, node.slice, frame))


def _slice(e: Evaluator, node: Any, frame: Any) -> slice:
    parts = (node.lower, node.upper, node.step)
    return slice(*(None if part is None else value_of(e, part, frame) for part in parts))


def _sequence(make: Callable[[list[Any]], Any]) -> Any:
    def value(e: Evaluator, node: Any, frame: Any) -> Any:
        parts = list[Any]()
        for part in node.elts:
            if isinstance(part, ast.Starred):
                parts += items_of(e, value_of(e, part.value, frame))
            else:
                parts.append(value_of(e, part, frame))
        return make(parts)

    return value


def _dictionary(e: Evaluator, node: Any, frame: Any) -> dict[Any, Any]:
    found = dict[Any, Any]()
    for key, part in zip(node.keys, node.values, strict=True):
        value = e.ops.materialised(value_of(e, part, frame))
        found.update(value if key is None else {value_of(e, key, frame): value})
    return found


def _comprehension(e: Evaluator, node: Any, frame: Any) -> Any:
    found = list[Any]()

    def turn(generators: list[ast.comprehension]) -> None:
        if not generators:
            parts = (node.key, node.value) if isinstance(node, ast.DictComp) else (node.elt,)
            found.append([e.ops.materialised(value_of(e, part, frame)) for part in parts])
            return
        for value in items_of(e, value_of(e, generators[0].iter, frame)):
            e.language.assign(e, generators[0].target, value, frame)
            tests = [truth(e, value_of(e, test, frame)) for test in generators[0].ifs]
            if all(require_concrete(test, "a condition of a list") for test in tests):
                turn(generators[1:])

    names = dict(frame.names)
    turn(node.generators)
    frame.names = names
    if isinstance(node, ast.DictComp):
        return dict(found)
    return [one for (one,) in found]


def _text(e: Evaluator, node: Any, frame: Any) -> str:
    parts = [value_of(e, part.value, frame) if isinstance(part, ast.FormattedValue) else part.value
             for part in node.values]  # fmt: skip
    return "".join(map(str, require_concrete(parts, "a text")))


def _lambda(e: Evaluator, node: Any, frame: Any) -> Closure:
    return Closure(node, {**frame.surroundings, **frame.names}, frame.function)


_KINDS: dict[type, Callable[[Evaluator, Any, Any], Any]] = {
    ast.Constant: lambda e, node, frame: node.value,
    ast.Name: _name,
    ast.Attribute: lambda e, node, frame: e.get(value_of(e, node.value, frame), node.attr),
    ast.BinOp: _binary,
    ast.UnaryOp: _unary,
    ast.BoolOp: _connective,
    ast.Compare: _compare,
    ast.IfExp: _choice,
    ast.Call: _call,
    ast.Subscript: _subscript,
    ast.Slice: _slice,
    ast.Tuple: _sequence(tuple),
    ast.List: _sequence(list),
    ast.Dict: _dictionary,
    ast.ListComp: _comprehension,
    ast.GeneratorExp: _comprehension,
    ast.DictComp: _comprehension,
    ast.JoinedStr: _text,
    ast.Lambda: _lambda,
}
