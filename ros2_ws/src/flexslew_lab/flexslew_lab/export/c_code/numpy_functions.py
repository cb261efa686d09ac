"""What NumPy's, math's and Python's own functions are in the C program."""

import builtins
import math
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from flexslew_lab.export.c_code import linear_algebra
from flexslew_lab.export.c_code.evaluator import Evaluator, Replacement
from flexslew_lab.export.c_code.expressions import items_of, truth
from flexslew_lab.export.c_code.indexing import item, reshaped
from flexslew_lab.export.c_code.operations import is_array, require_concrete
from flexslew_lab.export.c_code.program import CLine
from flexslew_lab.export.c_code.values import (
    Array,
    Computed,
    Scalar,
    Unsupported,
    is_symbolic,
)
from flexslew_plant import arrays
from flexslew_plant.testbeds.compiled import interface
from flexslew_plant.testbeds.kernels import Kernels


def _made(value: float) -> Replacement:
    def make(e: Evaluator, shape: Any, *_: Any, dtype: Any = None, **__: Any) -> Any:
        sizes = require_concrete(shape, "the shape of an array")
        sizes = (sizes,) if isinstance(sizes, int | np.integer) else tuple(map(int, sizes))
        out = e.ops.new(sizes)
        if value:
            e.ops.write(out, value)
        return out

    return make


def _eye(e: Evaluator, *sizes: Any, **named: Any) -> Any:
    return e.ops.stored(*e.ops.entries(np.eye(*require_concrete(sizes, "a shape"))))


def _by_entry(function: str, numpy: Any) -> Replacement:
    """Return a function of numbers for arrays, too."""

    def apply(e: Evaluator, *arguments: Any, **named: Any) -> Any:
        if not is_symbolic(arguments):
            return numpy(*arguments, **named)
        if any(is_array(one) for one in arguments):
            read = [e.ops.entries(e.ops.materialised(one)) for one in arguments]
            shape = np.broadcast_shapes(*(one[0] for one in read))

            def entry(index: tuple[str, ...]) -> str:
                own = [index[len(index) - len(s) :] if s else () for s, *_ in read]
                parts = [r[1](i) for r, i in zip(read, own, strict=True)]
                return f"{function}({', '.join(parts)})"

            return Computed(shape, entry)
        texts = [e.ops.real(one) for one in arguments]
        kind = "b" if function in ("isfinite", "isnan") else "f"
        return Scalar(f"{function}({', '.join(texts)})", kind)

    return apply


def _extreme(sign: str, numpy: Any, python: Any) -> Replacement:
    """Return max or min: of arguments as Python, of arrays as NumPy."""

    def pick(e: Evaluator, a: Any, b: Any) -> Any:
        if not is_symbolic((a, b)):
            return b if (b > a if sign == ">" else b < a) else a
        if not any(is_array(one) for one in (a, b)):
            known = [one for one in (a, b) if not is_symbolic(one)]
            a, b = e.ops.materialised(a), e.ops.materialised(b)
            test = e.ops.binary(sign, b, a)
            if not isinstance(test, Scalar):
                return b if test else a
            found = e.ops.select(test, b, a)
            least = known[0] if sign == ">" and known and found.kind == "i" else None
            return Scalar(found.text, found.kind, least)
        (shape_a, of_a, _), (shape_b, of_b, _) = (
            e.ops.entries(e.ops.materialised(one)) for one in (a, b)
        )
        shape = np.broadcast_shapes(shape_a, shape_b)

        def entry(index: tuple[str, ...]) -> str:
            x, y = of_a(index if shape_a else ()), of_b(index if shape_b else ())
            return f"({x} {sign} {y} || {x} != {x} ? {x} : {y})"

        return Computed(shape, entry)

    def extreme(e: Evaluator, *arguments: Any, default: Any = None, **named: Any) -> Any:
        if not is_symbolic(arguments):
            if len(arguments) == 2 and any(is_array(one) for one in arguments):
                return numpy(*arguments)
            return python(*arguments, **({} if default is None else {"default": default}))
        parts = items_of(e, arguments[0]) if len(arguments) == 1 else list(arguments)
        found = parts[0]
        for part in parts[1:]:
            found = pick(e, found, part)
        return found

    return extreme


def _array(e: Evaluator, value: Any, dtype: Any = None, **_: Any) -> Any:
    if not (is_symbolic(value) or isinstance(value, np.ndarray)):
        return np.array(value, dtype=dtype)
    return e.ops.stored(*e.ops.entries(value))


def _same(e: Evaluator, value: Any, *_: Any, **__: Any) -> Any:
    if isinstance(value, tuple | list):
        return e.ops.stacked(value)
    return e.ops.materialised(value)


def _concatenate(e: Evaluator, parts: Any, axis: int = 0, **_: Any) -> Any:
    parts = [e.ops.array(e.ops.materialised(part)) for part in parts]
    shape = list(parts[0].shape)
    shape[axis] = sum(part.shape[axis] for part in parts)
    out, at = e.ops.new(tuple(shape)), 0
    for part in parts:
        place = [slice(None)] * len(shape)
        place[axis] = slice(at, at + part.shape[axis])
        e.ops.write(item(e.ops, out, tuple(place)), part)
        at += part.shape[axis]
    return out


def _stack(axis: int) -> Replacement:
    def stack(e: Evaluator, parts: Any) -> Any:
        parts = [e.ops.array(e.ops.materialised(part)) for part in parts]
        parts = [item(e.ops, p, (None, ...)) if p.ndim == 1 and axis == 0 else p for p in parts]
        return _concatenate(e, parts, 0 if parts[0].ndim == 1 else axis)

    return stack


def _where(e: Evaluator, test: Any, yes: Any, no: Any) -> Any:
    given = [e.ops.materialised(one) for one in (test, yes, no)]
    read = [e.ops.entries(one) for one in given]
    shape = np.broadcast_shapes(*(one[0] for one in read))

    def entry(index: tuple[str, ...]) -> str:
        own = [index[len(index) - len(s) :] if s else () for s, *_ in read]
        c, a, b = (r[1](i) for r, i in zip(read, own, strict=True))
        return a if c == "1" else b if c == "0" else f"({c} ? {a} : {b})"

    return Computed(shape, entry)


def _sum(e: Evaluator, values: Any, start: Any = 0, **_: Any) -> Any:
    total = start
    for value in items_of(e, values):
        total = e.ops.binary("+", total, value)
    return e.ops.materialised(total)


def _any(is_all: bool) -> Replacement:
    def connect(e: Evaluator, values: Any, **_: Any) -> Any:
        if not is_symbolic(values):
            return (np.all if is_all else np.any)(values)
        if is_array(values):
            array = e.ops.array(e.ops.materialised(values))
            values = items_of(e, reshaped(e.ops, array, (-1,)))
        tests = [truth(e, value) for value in items_of(e, values)]
        texts = [one.text for one in tests if isinstance(one, Scalar)]
        if (not is_all) in [one for one in tests if not isinstance(one, Scalar)]:
            return not is_all
        return Scalar(f"({(' && ' if is_all else ' || ').join(texts)})", "b") if texts else is_all

    return connect


def _dot(e: Evaluator, a: Any, b: Any, out: Any = None) -> Any:
    found = e.ops.binary("@", a, b)
    if out is None:
        return found
    e.ops.write(out, found)
    return out


def _number(kind: type) -> Replacement:
    def number(e: Evaluator, value: Any = 0) -> Any:
        if not is_symbolic(value):
            return kind(value)
        if kind is bool:
            return truth(e, value)
        if kind is float:
            return Scalar(e.ops.real(value))
        return value if e.ops.kind(value) == "i" else Scalar(f"(int)({e.ops.text(value)})", "i")

    return number


def _abs(e: Evaluator, value: Any) -> Any:
    if isinstance(value, Scalar) and value.kind == "i":
        value = e.ops.temporary(value)
        return Scalar(f"({value.text} < 0 ? -{value.text} : {value.text})", "i")
    return _by_entry("fabs", np.abs)(e, value)


def _to_integer(function: str) -> Replacement:
    return lambda e, value: Scalar(f"(int){function}({e.ops.real(value)})", "i")


def _clip(e: Evaluator, value: Any, low: Any, high: Any, **_: Any) -> Any:
    larger = e.call(np.maximum, [value, low])
    return e.ops.materialised(e.call(np.minimum, [e.ops.materialised(larger), high]))


def _sign(e: Evaluator, value: Any) -> Any:
    if is_array(value):
        shape, entry, _ = e.ops.entries(e.ops.materialised(value))
        return Computed(shape, lambda i: f"(real)(({entry(i)} > 0.0) - ({entry(i)} < 0.0))")
    it = e.ops.temporary(Scalar(e.ops.real(value))).text
    return Scalar(f"(real)(({it} > 0.0) - ({it} < 0.0))")


def _least_squares(e: Evaluator, a: Any, b: Any, **_: Any) -> tuple[Any, None, None, None]:
    inverse = _pseudo_inverse(e, a, np.finfo(float).eps * max(a.shape))
    return e.ops.materialised(e.ops.binary("@", inverse, b)), None, None, None


def _pseudo_inverse(e: Evaluator, a: Any, cutoff: float = 1e-15) -> Any:
    if not is_symbolic(a):
        return np.linalg.pinv(a, cutoff)
    return e.call(linear_algebra.pseudo_inverse, [e.ops.array(e.ops.materialised(a)), cutoff])


def _norm(e: Evaluator, value: Any, *_: Any, **__: Any) -> Any:
    return Scalar(f"sqrt({e.ops.text(e.ops.binary('@', value, value))})")


def _outer(e: Evaluator, a: Any, b: Any) -> Any:
    return e.ops.binary("*", item(e.ops, e.ops.array(a), (slice(None), None)), b)


def _cross(e: Evaluator, a: Any, b: Any) -> Any:
    following, last = np.array([1, 2, 0]), np.array([2, 0, 1])
    a, b = e.ops.array(e.ops.materialised(a)), e.ops.array(e.ops.materialised(b))
    one, other = (
        e.ops.binary("*", item(e.ops, a, first), item(e.ops, b, then))
        for first, then in ((following, last), (last, following))
    )
    return e.ops.binary("-", one, other)


def _split(e: Evaluator, value: Any, parts: int) -> list[Any]:
    size = len(value) // parts
    return [item(e.ops, value, slice(k * size, (k + 1) * size)) for k in range(parts)]


def _solve(e: Evaluator, a: Any, b: Any) -> Any:
    rows = linear_algebra.solve_vector if b.ndim == 1 else linear_algebra.solve_rows
    return e.call(rows, [e.ops.array(a), e.ops.array(b)])


def _inverse(e: Evaluator, a: Any) -> Any:
    return e.call(linear_algebra.inverse, [e.ops.array(e.ops.materialised(a))])


def _like(e: Evaluator, value: Any, **_: Any) -> Any:
    return e.ops.new(value.shape)


def _zip(e: Evaluator, *values: Any, strict: bool = False) -> list[Any]:
    return list(zip(*(items_of(e, value) for value in values), strict=strict))


def _kernel(resolve: Any) -> Replacement:
    """Return what a function of `interface` is for a testbed's equations."""

    def call(e: Evaluator, kernels: Kernels, *arguments: Any) -> Any:
        class Kind:
            pass

        kind = Kind()
        kind.kernels = kernels  # type: ignore[attr-defined]
        return e.call(resolve(kind), [kernels, *arguments])

    return call


def _matrix_loop(e: Evaluator, a: Array) -> Scalar:
    total = e.ops.fresh("s")
    e.ops.block.append(CLine(f"real {total} = 0.0;", total))

    def add(index: tuple[str, ...]) -> None:
        e.ops.block.append(CLine(f"{total} += {a.entry(index)};", total, a.entry(index)))

    e.ops.looped(a.shape, add)
    return Scalar(total, atom=True)


def _array_sum(e: Evaluator, value: Any, *_: Any, axis: int | None = None, **__: Any) -> Any:
    if not is_symbolic(value):
        return np.sum(value, axis=axis)
    array = e.ops.array(e.ops.materialised(value))
    if axis is None:
        return _matrix_loop(e, array)
    if axis in (0, -array.ndim):
        return _sum(e, array)
    raise Unsupported("a sum along another axis than the first")


_RESOLVED = {
    interface.terms: interface._terms,
    interface.residual_jacobian: interface._residual_jacobian,
    interface.potential: interface._potential,
    interface.actuation: interface._actuation,
    interface.position_rates: interface._position_rates,
    interface.reading: interface._reading,
    interface.square: interface._square,
    interface.extra: interface._extra,
}
_ENTRIES: dict[str, tuple[Callable[..., Any], ...]] = {
    "sqrt": (np.sqrt, math.sqrt), "sin": (np.sin, math.sin), "cos": (np.cos, math.cos),
    "tan": (np.tan, math.tan), "atan2": (np.arctan2, math.atan2), "exp": (np.exp, math.exp),
    "log": (np.log, math.log), "log2": (np.log2, math.log2), "asin": (np.arcsin, math.asin),
    "acos": (np.arccos, math.acos), "atan": (np.arctan, math.atan), "tanh": (np.tanh, math.tanh),
    "copysign": (np.copysign, math.copysign), "isfinite": (np.isfinite, math.isfinite),
    "hypot": (np.hypot, math.hypot), "pow": (np.power, math.pow), "fabs": (np.abs, math.fabs),
    "isnan": (np.isnan, math.isnan), "rint": (np.round, np.rint), "expm1": (np.expm1, math.expm1),
}  # fmt: skip
REPLACEMENTS: dict[Any, Replacement] = {
    **{each: _by_entry(name, each) for name, pair in _ENTRIES.items() for each in pair},
    **{each: _kernel(resolve) for each, resolve in _RESOLVED.items()},
    np.zeros: _made(0.0), np.empty: _made(0.0), np.ones: _made(1.0), np.eye: _eye,
    np.zeros_like: _like, np.empty_like: _like, np.array: _array, np.asarray: _same,
    np.ascontiguousarray: _same, np.concatenate: _concatenate, np.vstack: _stack(0),
    np.hstack: _stack(-1), np.where: _where, np.dot: _dot, np.linalg.norm: _norm,
    np.maximum: _extreme(">", np.maximum, max), np.minimum: _extreme("<", np.minimum, min),
    builtins.max: _extreme(">", np.maximum, max), builtins.min: _extreme("<", np.minimum, min),
    builtins.sum: _sum, np.sum: _array_sum, builtins.abs: _abs, np.any: _any(False),
    np.all: _any(True), builtins.any: _any(False), builtins.all: _any(True),
    builtins.float: _number(float), builtins.int: _number(int), builtins.bool: _number(bool),
    math.floor: _to_integer("floor"), math.ceil: _to_integer("ceil"),
    np.outer: _outer, np.cross: _cross,
    np.split: _split, np.linalg.solve: _solve, np.linalg.inv: _inverse, builtins.zip: _zip,
    builtins.list: lambda e, value=(): items_of(e, value),
    builtins.tuple: lambda e, value=(): tuple(items_of(e, value)),
    deque: lambda e, value=(), **_: items_of(e, value),
    builtins.reversed: lambda e, value: items_of(e, value)[::-1],
    builtins.enumerate: lambda e, value, first=0: list(enumerate(items_of(e, value), first)),
    builtins.len: lambda e, value: len(value),
    np.copy: lambda e, value: e.ops.stored(*e.ops.entries(value)),
    np.linalg.pinv: _pseudo_inverse, np.linalg.lstsq: _least_squares, np.clip: _clip,
    np.sign: _sign,
    np.linalg.det: lambda e, a: e.call(
        linear_algebra.determinant, [e.ops.array(e.ops.materialised(a))]
    ),
    np.square: lambda e, value: e.ops.binary("**", value, 2),
    arrays.read_only: _same, arrays.read_only_view: _same,
    arrays.keep_all: lambda e, values: None,
}  # fmt: skip
METHODS: dict[str, Replacement] = {
    "copy": lambda e, value: e.ops.stored(*e.ops.entries(value)),
    "astype": _same,
    "reshape": lambda e, value, *shape, **_: reshaped(
        e.ops, e.ops.materialised(value), shape[0] if isinstance(shape[0], tuple) else shape
    ),
    "ravel": lambda e, value: reshaped(e.ops, e.ops.materialised(value), (-1,)),
    "any": _any(False), "all": _any(True), "sum": _array_sum, "dot": _dot,
    "tolist": lambda e, value: items_of(e, value),
    "max": lambda e, value, **_: _extreme(">", np.maximum, max)(e, value),
    "min": lambda e, value, **_: _extreme("<", np.minimum, min)(e, value),
}  # fmt: skip
