"""Statements of Python functions, carried out by the evaluator."""

import ast
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from flexslew_lab.export.c_code.evaluator import CallFrame, Evaluator, Language, Variable
from flexslew_lab.export.c_code.expressions import items_of, truth, value_of
from flexslew_lab.export.c_code.indexing import item, set_item
from flexslew_lab.export.c_code.operations import TYPES, is_array
from flexslew_lab.export.c_code.program import CLine, CLoop
from flexslew_lab.export.c_code.sources import Closure
from flexslew_lab.export.c_code.values import (
    Array,
    ConcreteRequired,
    Scalar,
    Unsupported,
    is_symbolic,
    rebuilt,
)

_FALLS, _RETURNS, _CONTINUES, _BREAKS = range(4)
_OPERATORS = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.MatMult: "@", ast.Pow: "**",
    ast.FloorDiv: "//", ast.Mod: "%", ast.BitAnd: "&", ast.BitOr: "|",
}  # fmt: skip


@dataclass(frozen=True)
class _Given:
    """The next item of a loop that is written out."""

    target: ast.expr
    value: Any


def run(e: Evaluator, body: Sequence[Any], frame: CallFrame) -> int:
    """Carry out statements; return how they end."""
    for k, node in enumerate(body):
        rest = body[k + 1 :]
        if isinstance(node, _Given):
            assign(e, node.target, node.value, frame)
        elif isinstance(node, ast.If):
            test = truth(e, value_of(e, node.test, frame))
            if isinstance(test, Scalar):
                return _branch(e, test, node, rest, frame)
            flow = run(e, node.body if test else node.orelse, frame)
            if flow != _FALLS:
                return flow
        elif isinstance(node, ast.For):
            end = _loop(e, node, rest, frame)
            if end is not None:
                return end
        elif isinstance(node, ast.While):
            _while(e, node, frame)
        elif isinstance(node, ast.Return):
            value = None if node.value is None else value_of(e, node.value, frame)
            frame.result = e.ops.materialised(value)
            return _RETURNS
        elif isinstance(node, ast.Continue):
            return _CONTINUES
        elif isinstance(node, ast.Break):
            return _BREAKS
        elif isinstance(node, ast.Try):  # C has no exceptions: what fails is not finite there
            flow = run(e, node.body, frame)
            if flow != _FALLS:
                return flow
        else:
            _simple(e, node, frame)
    return _FALLS


def _simple(e: Evaluator, node: ast.stmt, frame: CallFrame) -> None:
    """Carry out a statement without blocks."""
    if isinstance(node, ast.Assign):
        value = value_of(e, node.value, frame)
        several = isinstance(value, tuple) or len(node.targets) > 1
        value = e.ops.materialised(value) if several else value
        for target in node.targets:
            assign(e, target, value, frame)
    elif isinstance(node, ast.AnnAssign):
        if node.value is not None:
            assign(e, node.target, value_of(e, node.value, frame), frame)
    elif isinstance(node, ast.AugAssign):
        _augment(e, node, frame)
    elif isinstance(node, ast.Expr):
        value_of(e, node.value, frame)
    elif isinstance(node, ast.FunctionDef):
        names = {name: _read(value) for name, value in frame.names.items()}
        frame.names[node.name] = Closure(node, names, frame.function)
    elif not isinstance(node, ast.Pass | ast.Assert):
        raise Unsupported(f"the statement `{ast.unparse(node).splitlines()[0][:60]}`")


def _augment(e: Evaluator, node: ast.AugAssign, frame: CallFrame) -> None:
    target, op = node.target, _OPERATORS[type(node.op)]
    by = value_of(e, node.value, frame)
    if isinstance(target, ast.Subscript):
        owner, key = value_of(e, target.value, frame), value_of(e, target.slice, frame)
        key = e.ops.materialised(key)
        set_item(e.ops, owner, key, e.ops.binary(op, item(e.ops, owner, key), by))
        return
    load = ast.copy_location(ast.parse(ast.unparse(target), mode="eval").body, target)
    before = value_of(e, load, frame)
    if isinstance(before, Array):
        e.ops.write(before, e.ops.binary(op, before, by))
    elif isinstance(before, dict):
        assign(e, target, {**before, **by}, frame)
    else:
        assign(e, target, e.ops.binary(op, before, by), frame)


def assign(e: Evaluator, target: ast.expr, value: Any, frame: CallFrame) -> None:
    """Give a target a value."""
    if isinstance(target, ast.Name):
        now = frame.names.get(target.id)
        if isinstance(now, Variable):
            _change(e, now.value, e.ops.materialised(value))
        else:
            frame.names[target.id] = e.ops.materialised(value)
    elif isinstance(target, ast.Tuple | ast.List):
        parts = [e.ops.materialised(part) for part in items_of(e, value)]
        starred = [k for k, one in enumerate(target.elts) if isinstance(one, ast.Starred)]
        if starred:
            first, after = starred[0], len(target.elts) - starred[0] - 1
            end = len(parts) - after
            parts = [*parts[:first], parts[first:end], *parts[end:]]
        if len(parts) != len(target.elts):
            raise Unsupported(f"{len(parts)} values for {len(target.elts)} names")
        for one, part in zip(target.elts, parts, strict=True):
            assign(e, one.value if isinstance(one, ast.Starred) else one, part, frame)
    elif isinstance(target, ast.Attribute):
        e.set(value_of(e, target.value, frame), target.attr, value)
    elif isinstance(target, ast.Subscript):
        owner = value_of(e, target.value, frame)
        set_item(e.ops, owner, value_of(e, target.slice, frame), value)
    else:
        raise Unsupported(f"assignment to {ast.unparse(target)}")


def _change(e: Evaluator, variable: Any, value: Any) -> None:
    """Write the values of a variable's leaves."""
    if isinstance(variable, Array):
        e.ops.write(variable, value)
    elif isinstance(variable, Scalar):
        if variable.kind != "f" and e.ops.kind(value) == "f":
            raise ConcreteRequired("a whole number that becomes another one in a loop")
        text = e.ops.real(value) if variable.kind == "f" else e.ops.text(value)
        e.ops.block.append(CLine(f"{variable.text} = {text};", variable.text, text))
    else:
        if not isinstance(value, tuple) or len(value) != len(variable):
            raise ConcreteRequired("a name that changes its form in a loop")
        for one, part in zip(variable, value, strict=True):
            _change(e, one, part)


def _branch(e: Evaluator, test: Scalar, node: ast.If, rest: Sequence[Any], frame: CallFrame) -> int:
    """Carry out a condition of the program, and what comes after it."""
    leaves = _leaves(node)
    before, ends = dict(frame.names), []

    def block(body: Sequence[Any]) -> int:
        frame.names, frame.result = dict(before), None
        flow = run(e, [*body, *rest] if leaves else body, frame)
        ends.append((frame.names, frame.result))
        return flow

    yes, no, branch = e.branch(test, lambda: block(node.body), lambda: block(node.orelse))
    (names, result), (other_names, other_result) = ends
    frame.names, outside = dict(before), e.ops.block
    if leaves:
        if _BREAKS in (yes, no):
            raise ConcreteRequired("a loop that ends early")
        if (yes == _RETURNS) != (no == _RETURNS) and (result, other_result) != (None, None):
            raise ConcreteRequired("a function that returns from one of two branches")
        frame.result = e.ops.merged(result, other_result, branch, outside)
    for name in {**names, **other_names}:
        a, b = names.get(name), other_names.get(name)
        frame.names.pop(name, None)
        try:
            if name in names and name in other_names:
                frame.names[name] = e.ops.merged(a, b, branch, outside) if a is not b else a
        except Unsupported:
            continue
    outside.append(branch)
    if leaves:
        return yes if yes == no else _CONTINUES
    return run(e, rest, frame)


def _leaves(node: ast.stmt) -> bool:
    """Return whether a statement may end the function or the turn of the loop that it is in."""
    if isinstance(node, ast.Return | ast.Continue | ast.Break):
        return True
    if isinstance(node, ast.For):
        return any(isinstance(inner, ast.Return) for inner in ast.walk(node))
    parts = getattr(node, "body", []), getattr(node, "orelse", [])
    return isinstance(node, ast.If | ast.Try) and any(_leaves(n) for part in parts for n in part)


def _loop(e: Evaluator, node: ast.For, rest: Sequence[Any], frame: CallFrame) -> int | None:
    """Carry out a loop; return how the statements after it end where they are done, too."""
    returns = any(isinstance(inner, ast.Return) for inner in ast.walk(node))
    bounds = _range(e, node.iter, frame)
    if bounds is not None and not returns:
        if is_symbolic(bounds) or len(range(*bounds)) > 1:
            names, block, written = dict(frame.names), e.ops.block, len(e.ops.block)
            branches, loops, place = e.branches, e.loops, list(e.place)
            attributes = e.attributes
            try:
                _rolled(e, node, bounds, frame)
                return None
            except ConcreteRequired:
                if is_symbolic(bounds):
                    raise
                e.attributes, frame.names, e.ops.block = attributes, names, block
                e.branches, e.loops, e.place = branches, loops, place
                del block[written:]
        given: Iterable[Any] = range(*bounds)
    else:
        given = range(*bounds) if bounds else items_of(e, value_of(e, node.iter, frame))
    if returns:
        turns = [part for value in given for part in (_Given(node.target, value), *node.body)]
        return run(e, [*turns, *node.orelse, *rest], frame)
    for value in given:
        assign(e, node.target, value, frame)
        if run(e, node.body, frame) == _BREAKS:
            break
    return None


def _range(e: Evaluator, node: ast.expr, frame: CallFrame) -> tuple[Any, Any, int] | None:
    """Return start, stop and step of a loop over a range; None: it is over something else."""
    if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Name):
        return None
    if node.func.id != "range":
        return None
    given = [value_of(e, argument, frame) for argument in node.args]
    start, stop, step = given[0], given[-1], 1
    if len(given) == 1:
        start = 0
    elif len(given) == 3:
        stop, step = given[1], given[2]
    return e.ops.materialised(start), e.ops.materialised(stop), step


def _rolled(e: Evaluator, node: ast.For, bounds: tuple[Any, Any, int], frame: CallFrame) -> None:
    """Write a loop of the program."""
    start, stop, step = bounds
    if is_symbolic(step) or not isinstance(node.target, ast.Name):
        raise ConcreteRequired("the step of a loop")
    changed = _stored(node.body) - {node.target.id}
    before = _make_variables(e, changed, frame)
    index = e.ops.fresh("i")
    compare, change = ("<", f"{index}++") if step == 1 else (">" if step < 0 else "<", "")
    change = change or f"{index} += {step}"
    head = (
        f"for (int {index} = {e.ops.text(start)}; {index} {compare} {e.ops.text(stop)}; {change})"
    )
    loop, outside = CLoop(head), e.ops.block
    outside.append(loop)
    e.ops.block = loop.body
    kept = dict(frame.names)
    frame.names[node.target.id] = Scalar(index, "i", atom=True)
    e.branches, e.loops = e.branches + 1, e.loops + 1
    if run(e, node.body, frame) not in (_FALLS, _CONTINUES):
        raise ConcreteRequired("a loop that ends early")
    e.branches, e.loops = e.branches - 1, e.loops - 1
    e.ops.block, frame.names = outside, kept
    _end_variables(changed, before, frame)
    frame.names.pop(node.target.id, None)


def _while(e: Evaluator, node: ast.While, frame: CallFrame) -> None:
    """Carry out a loop with a condition."""
    changed = _stored(node.body)
    before = _make_variables(e, changed, frame)
    test = _variable(e, truth(e, value_of(e, node.test, frame))).value
    loop, outside = CLoop(f"while ({test.text})"), e.ops.block
    outside.append(loop)
    e.ops.block, kept = loop.body, dict(frame.names)
    e.branches, e.loops = e.branches + 1, e.loops + 1
    if run(e, node.body, frame) != _FALLS:
        raise ConcreteRequired("a loop that ends early")
    _change(e, test, truth(e, value_of(e, node.test, frame)))
    e.branches, e.loops = e.branches - 1, e.loops - 1
    e.ops.block, frame.names = outside, kept
    _end_variables(changed, before, frame)


def _stored(body: Sequence[ast.stmt]) -> set[str]:
    """Return the names that statements give values."""
    nodes = (inner for part in body for inner in ast.walk(part))
    return {one.id for one in nodes if isinstance(one, ast.Name) and isinstance(one.ctx, ast.Store)}


def _make_variables(e: Evaluator, changed: set[str], frame: CallFrame) -> dict[str, Any]:
    """Make names that a loop changes C variables; return all names before it."""
    before = dict(frame.names)
    for name in sorted(changed & before.keys()):
        if not isinstance(before[name], Variable):
            frame.names[name] = _variable(e, before[name])
    return before


def _end_variables(changed: set[str], before: dict[str, Any], frame: CallFrame) -> None:
    """Make the variables of a loop that is over numbers that stay."""
    for name in changed & before.keys():
        if not isinstance(before[name], Variable):
            frame.names[name] = _read(frame.names[name])


def _variable(e: Evaluator, value: Any) -> Variable:
    """Return a name's value as C variables with that value."""

    def one(leaf: Any, _: str) -> Any:
        if is_array(leaf):
            return e.ops.stored(*e.ops.entries(leaf))
        kind, name = e.ops.kind(leaf), e.ops.fresh("x")
        text = e.ops.text(leaf)
        e.ops.block.append(CLine(f"{TYPES[kind]} {name} = {text};", name, text))
        return Scalar(name, kind)

    try:
        return Variable(rebuilt(value, one))
    except Unsupported as error:
        raise ConcreteRequired(str(error)) from None


def _read(value: Any) -> Any:
    """Return a value with the C variables of a loop that is over as numbers that stay."""
    if not isinstance(value, Variable):
        return value

    def one(leaf: Any, _: str) -> Any:
        return Scalar(leaf.text, leaf.kind, atom=True) if isinstance(leaf, Scalar) else leaf

    return rebuilt(value.value, one)


LANGUAGE = Language(run, value_of, assign)
