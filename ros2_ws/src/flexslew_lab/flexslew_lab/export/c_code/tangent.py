"""Derivatives of the C program along a direction, exact: its statements, differentiated.

Each real number `a` that depends on what is varied gets a second one, `a_d`, its derivative along
the direction (forward mode; Griewank and Walther 2008, section 3.1).
"""

import re
from collections.abc import Callable, Iterator, Set

from flexslew_lab.export.c_code.c_expression import (
    Call,
    Constant,
    Expression,
    Lvalue,
    parse,
)
from flexslew_lab.export.c_code.program import Block, Branch, CLine, CLoop, Node
from flexslew_lab.export.c_code.values import Unsupported

_LINE = re.compile(r"((?:const )?(?:real|int) )?(\w+)((?:->|\[|\.).*?)? (\+?=) (.*);")
_ZERO = "0.0"
_STEPS = ("floor", "ceil", "rint", "isfinite", "isnan")  # constant between two jumps
# derivatives of functions of one number: a for the number
_ONE: dict[str, str] = {
    "sin": "cos({a})",
    "cos": "(-sin({a}))",
    "tan": "(1.0 + tan({a}) * tan({a}))",
    "exp": "exp({a})",
    "expm1": "exp({a})",
    "log": "(1.0 / {a})",
    "log2": "(1.4426950408889634 / {a})",
    "asin": "(1.0 / sqrt(1.0 - {a} * {a}))",
    "acos": "(-1.0 / sqrt(1.0 - {a} * {a}))",
    "atan": "(1.0 / (1.0 + {a} * {a}))",
    "tanh": "(1.0 - tanh({a}) * tanh({a}))",
    "sqrt": "({a} > 0.0 ? 0.5 / sqrt({a}) : 0.0)",
    "fabs": "({a} < 0.0 ? -1.0 : 1.0)",
}
# of two numbers a, b with derivatives p, q
_TWO: dict[str, str] = {
    "atan2": "(({b} * {p} - {a} * {q}) / ({a} * {a} + {b} * {b}))",
    "hypot": "(hypot({a}, {b}) > 0.0 ? ({a} * {p} + {b} * {q}) / hypot({a}, {b}) : 0.0)",
    "copysign": "({p} * copysign(1.0, {a}) * copysign(1.0, {b}))",
}


def tangent(block: Block, varied: Set[str]) -> Block:
    """Return the statements of a function, each with its derivative before it.

    A square root has the derivative zero at zero.

    Args:
        block: the statements.
        varied: names of arguments that have derivatives: `x` has `x_d`, `input` has `input_d`.

    Raises:
        Unsupported: a function has no derivative here.
    """
    parts = [_parts(line) for line in _lines(block)]
    whole = {name for declaration, name, *_ in parts if "int" in declaration}
    active, before = set(varied), -1
    while len(active) != before:  # a loop uses in its next turn what it has written in this one
        before = len(active)
        for _, name, _, _, value in parts:
            if name not in active and name not in whole and _slope(value, active) is not None:
                active.add(name)
    return list(_with_derivatives(block, active))


def _lines(block: Block) -> Iterator[CLine]:
    for node in block:
        if isinstance(node, CLine):
            yield node
        else:
            for inner in [node.body] if isinstance(node, CLoop) else [node.yes, node.no]:
                yield from _lines(inner)


def _parts(line: CLine) -> tuple[str, str, str, str, str]:
    """Return declaration, name, indices and members, the operator and the value of a statement."""
    found = _LINE.fullmatch(line.text)
    assert found is not None, line.text
    declaration, name, rest, operator, value = found.groups()
    return declaration or "", name, rest or "", operator, value


def _with_derivatives(block: Block, active: Set[str]) -> Iterator[Node]:
    for node in block:
        if isinstance(node, CLoop):
            yield CLoop(node.head, list(_with_derivatives(node.body, active)))
        elif isinstance(node, Branch):
            blocks = (list(_with_derivatives(one, active)) for one in (node.yes, node.no))
            yield Branch(node.test, *blocks)
        else:
            declaration, name, rest, operator, value = _parts(node)
            if name in active:
                slope = value if value == "{0}" else _slope(value, active) or _ZERO
                text = f"{declaration}{name}_d{rest} {operator} {slope};"
                yield CLine(text, f"{name}_d", f"{slope} {rest}")
            yield node


def _slope(value: str, active: Set[str]) -> str | None:
    """Return the derivative of an expression; None: it is zero."""
    return None if value == "{0}" else _derivative(parse(value), active)


def _derivative(tree: Expression, active: Set[str]) -> str | None:
    if isinstance(tree, Constant):
        return None
    if isinstance(tree, Lvalue):
        return f"{tree.name}_d{tree.rest}" if tree.name in active else None
    slopes = [_derivative(one, active) for one in tree.terms]
    if all(one is None for one in slopes):
        return None
    texts = [one.text for one in tree.terms]
    if isinstance(tree, Call):
        return _of_call(tree.function, texts, slopes)
    rule = _RULES.get(tree.operator)
    return None if rule is None else rule(texts, slopes)


def _of_call(function: str, texts: list[str], slopes: list[str | None]) -> str | None:
    if function in _STEPS:
        return None
    if function in _ONE:
        return f"({_ONE[function].format(a=texts[0])} * {slopes[0]})"
    a, b = texts
    p, q = (one or _ZERO for one in slopes)
    if function == "pow" and slopes[1] is None:
        return f"({b} * pow({a}, {b} - 1.0) * {p})"
    if function in _TWO:
        return _TWO[function].format(a=a, b=b, p=p, q=q)
    raise Unsupported(f"the derivative of {function}")


def _sum(texts: list[str], slopes: list[str | None]) -> str:
    return f"({' + '.join(one for one in slopes if one is not None)})"


def _difference(texts: list[str], slopes: list[str | None]) -> str:
    if len(texts) == 1 or slopes[0] is None:
        return f"(-{slopes[-1]})"
    return slopes[0] if slopes[1] is None else f"({slopes[0]} - {slopes[1]})"


def _product(texts: list[str], slopes: list[str | None]) -> str:
    (a, b), (p, q) = texts, slopes
    parts = [f"{p} * {b}"] * (p is not None) + [f"{a} * {q}"] * (q is not None)
    return f"({' + '.join(parts)})"


def _quotient(texts: list[str], slopes: list[str | None]) -> str:
    (a, b), (p, q) = texts, slopes
    return f"({p} / {b})" if q is None else f"(({p or _ZERO} - ({a} / {b}) * {q}) / {b})"


def _choice(texts: list[str], slopes: list[str | None]) -> str:
    return f"({texts[0]} ? {slopes[1] or _ZERO} : {slopes[2] or _ZERO})"


# operators whose results are whole numbers have no derivative
_RULES: dict[str, Callable[[list[str], list[str | None]], str]] = {
    "+": _sum,
    "-": _difference,
    "*": _product,
    "/": _quotient,
    "?": _choice,
    "(real)": _sum,
}
