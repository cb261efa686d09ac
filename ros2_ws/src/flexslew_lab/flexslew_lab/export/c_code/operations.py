"""Arithmetic of the evaluator: on constants by Python, on all else as C expressions."""

import operator
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from flexslew_lab.export.c_code.program import Block, Branch, CLine, CLoop, Constants, literal
from flexslew_lab.export.c_code.values import (
    Array,
    Computed,
    ConcreteRequired,
    Scalar,
    Shape,
    Tick,
    Unsupported,
    is_symbolic,
    rebuilt,
    row_major,
)

_UNROLLED = 4  # entries up to which an array is written without a loop
_PYTHON: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv,
    "//": operator.floordiv, "%": operator.mod, "**": operator.pow, "@": operator.matmul,
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
    "==": operator.eq, "!=": operator.ne, "&": operator.and_, "|": operator.or_,
}  # fmt: skip
_COMPARISONS = ("<", "<=", ">", ">=", "==", "!=")
TYPES = {"f": "real", "i": "int", "b": "int"}


def is_array(value: Any) -> bool:
    """Return whether a value has indices."""
    return isinstance(value, Array | Computed) or (isinstance(value, np.ndarray) and value.ndim > 0)


class Operations:
    """Writes the statements of expressions into the present block."""

    def __init__(self) -> None:
        self.block: Block = []
        self.constants = Constants()
        self._count = 0

    def fresh(self, prefix: str = "t") -> str:
        """Return a name that nothing has."""
        self._count += 1
        return f"{prefix}{self._count}"

    def text(self, value: Any) -> str:
        """Return a number as a C expression."""
        if isinstance(value, Scalar):
            if not value.text:
                raise Unsupported("how long ago a tick was as a number")
            return value.text
        if isinstance(value, Tick):
            if value.older:
                raise Unsupported("a tick of the past as a number")
            return f"(memory->tick + {value.offset})" if value.offset else "memory->tick"
        if isinstance(value, Array | Computed) and value.shape == ():
            return self.entries(value)[1](())
        if isinstance(value, np.ndarray) and value.ndim == 0:
            return literal(value.item())
        if isinstance(value, np.generic):
            return literal(value.item())
        if isinstance(value, bool | int | float):
            return literal(value)
        raise Unsupported(f"{type(value).__name__} as a number")

    def kind(self, value: Any) -> str:
        """Return the kind of a number, see Scalar."""
        if isinstance(value, Scalar | Array | Computed):
            return value.kind
        if isinstance(value, Tick):
            return "i"
        if isinstance(value, np.ndarray | np.generic):
            return {"b": "b", "i": "i", "u": "i"}.get(value.dtype.kind, "f")
        return "b" if isinstance(value, bool) else "i" if isinstance(value, int) else "f"

    def real(self, value: Any) -> str:
        """Return a number as a C expression of floating point."""
        kind = self.kind(value)
        if kind == "f":
            return self.text(value)
        if not is_symbolic(value):
            return literal(float(value))
        return f"(real)({self.text(value)})"

    def binary(self, op: str, a: Any, b: Any) -> Any:
        """Return what an operator gives."""
        if not (is_symbolic(a) or is_symbolic(b)):
            return _PYTHON[op](a, b)
        if isinstance(a, tuple | list) and op == "+":
            return a + b
        if op == "@":
            return self.product(a, b)
        if isinstance(a, Tick) or isinstance(b, Tick):
            found = _of_ticks(op, a, b)
            if found is not None:
                return found
        if is_array(a) or is_array(b):
            return self._by_entry(op, a, b)
        return self._scalar(op, a, b)

    def _scalar(self, op: str, a: Any, b: Any) -> Any:
        if isinstance(a, Scalar) and a.least is not None and isinstance(b, int):
            if op in _COMPARISONS and a.least > b:
                return op in (">", ">=", "!=")
            if op in ("<", ">=") and a.least == b:
                return op == ">="
        whole = self.kind(a) in "ib" and self.kind(b) in "ib"
        if op in _COMPARISONS:
            sides = (self.text(a), self.text(b)) if whole else (self.real(a), self.real(b))
            return Scalar(f"({sides[0]} {op} {sides[1]})", "b")
        if op in "&|":
            return Scalar(f"({self.text(a)} {op * 2} {self.text(b)})", "b")
        if op == "**":
            return self._power(a, b)
        if whole and op in ("+", "-", "*", "%", "//"):
            return Scalar(f"({self.text(a)} {op[0]} {self.text(b)})", "i", _least(op, a, b))
        if op in ("%", "//"):
            raise Unsupported(f"{op} of numbers that are not whole")
        return Scalar(f"({self.real(a)} {op} {self.real(b)})")

    def _power(self, a: Any, b: Any) -> Scalar:
        if not is_symbolic(b) and b == 2:
            it = self.temporary(Scalar(self.real(a)))
            return Scalar(f"({it.text} * {it.text})")
        if not is_symbolic(b) and b == 3:
            it = self.temporary(Scalar(self.real(a)))
            return Scalar(f"({it.text} * {it.text} * {it.text})")
        if not is_symbolic(b) and b == 0.5:
            return Scalar(f"sqrt({self.real(a)})")
        return Scalar(f"pow({self.real(a)}, {self.real(b)})")

    def _by_entry(self, op: str, a: Any, b: Any) -> Computed:
        (shape_a, of_a, kind_a), (shape_b, of_b, kind_b) = map(self.entries, (a, b))
        shape = np.broadcast_shapes(shape_a, shape_b)

        def entry(index: tuple[str, ...]) -> str:
            one = Scalar(of_a(_narrow(index, shape_a)), kind_a)
            other = Scalar(of_b(_narrow(index, shape_b)), kind_b)
            return self.text(self._scalar(op, one, other))

        kind = self._scalar(op, Scalar("0", kind_a), Scalar("0", kind_b)).kind
        return Computed(shape, entry, kind)

    def entries(self, value: Any) -> tuple[Shape, Callable[[tuple[str, ...]], str], str]:
        """Return a value's shape, the C expression of its entries by their indices, its kind."""
        if isinstance(value, Array):
            return value.shape, value.entry, value.kind
        if isinstance(value, Computed):
            return value.shape, value.entry, value.kind
        if isinstance(value, np.ndarray) and value.ndim:

            def entry(index: tuple[str, ...]) -> str:
                if all(one.isdigit() for one in index):
                    return literal(value[tuple(map(int, index))])
                return self.table(value).entry(index)

            return value.shape, entry, self.kind(value)
        if isinstance(value, tuple | list):
            return self.entries(self.stacked(value))
        text, kind = self.text(value), self.kind(value)
        return (), lambda index: text, kind

    def table(self, value: Any) -> Array:
        """Return an array of constants as one of the program's."""
        name, kind = self.constants.name(value)
        return Array(name, value.shape, row_major(value.shape), (0, ""), kind)

    def array(self, value: Any) -> Array:
        """Return a value as an array of the program."""
        if isinstance(value, Array):
            return value
        if isinstance(value, np.ndarray):
            return self.table(value)
        return self.stored(*self.entries(value))

    def stacked(self, parts: Sequence[Any]) -> Any:
        """Return a list of numbers or arrays as one array."""
        if not is_symbolic(parts):
            return np.array(parts)
        found = [self.entries(self.materialised(part)) for part in parts]
        shape, kinds = found[0][0], {kind for *_, kind in found}
        out = self.new((len(found), *shape), "f" if "f" in kinds or not kinds else kinds.pop())
        for k, (_, entry, kind) in enumerate(found):
            row = Array(out.name, shape, out.strides[1:], (k * out.strides[0], ""), out.kind)
            self.write(row, Computed(shape, entry, kind))
        return out

    def new(self, shape: Shape, kind: str = "f") -> Array:
        """Return a new array of zeros."""
        out = Array(self.fresh("a"), shape, row_major(shape), (0, ""), kind)
        if out.size:
            text = f"{TYPES[kind]} {out.name}[{out.size}] = {{0}};"
            self.block.append(CLine(text, out.name))
        return out

    def stored(
        self, shape: Shape, entry: Callable[[tuple[str, ...]], str], kind: str = "f"
    ) -> Array:
        """Return a new array with these entries."""
        out = self.new(shape, kind)
        self.write(out, Computed(shape, entry, kind))
        return out

    def write(self, out: Array, value: Any) -> None:
        """Write a value into all entries of an array."""
        shape, entry, kind = self.entries(value)
        if len(shape) > len(out.shape):
            shape, entry = self._without_ones(shape, entry, len(out.shape))
        np.broadcast_shapes(shape, out.shape)
        convert = "(real)" if kind in "ib" and out.kind == "f" else ""
        if not out.size:
            return
        probe = entry(_narrow(tuple("1" * (n > 1) or "0" for n in out.shape), shape))
        if isinstance(value, Computed) and f"{out.name}[" in probe:
            value = self.stored(shape, entry, kind)
            shape, entry, kind = self.entries(value)

        def put(index: tuple[str, ...]) -> None:
            text, target = entry(_narrow(index, shape)), out.entry(index)
            if text != target:
                number = f"{convert}({text})" if convert else text
                self.block.append(
                    CLine(f"{target} = {number};", out.name, f"{text} {target[len(out.name) :]}")
                )

        if out.size <= _UNROLLED:
            for one in np.ndindex(*out.shape):
                put(tuple(map(str, one)))
            return
        self.looped(out.shape, put)

    def _without_ones(self, shape: Shape, entry: Any, ndim: int) -> tuple[Shape, Any]:
        extra = len(shape) - ndim
        if any(size != 1 for size in shape[:extra]):
            raise Unsupported("an array that does not fit")
        return shape[extra:], lambda index: entry(("0",) * extra + index)

    def looped(self, shape: Shape, body: Callable[[tuple[str, ...]], None]) -> None:
        """Write nested loops over all indices of a shape around a body."""
        outside, index = self.block, []
        for size in shape:
            if size == 1:
                index.append("0")
                continue
            name = self.fresh("i")
            loop = CLoop(f"for (int {name} = 0; {name} < {size}; {name}++)")
            self.block.append(loop)
            self.block = loop.body
            index.append(name)
        body(tuple(index))
        self.block = outside

    def temporary(self, value: Scalar) -> Scalar:
        """Return a number as a name of its own, whose value does not change."""
        if value.atom:
            return value
        name = self.fresh()
        text = f"const {TYPES[value.kind]} {name} = {value.text};"
        self.block.append(CLine(text, name, value.text))
        return Scalar(name, value.kind, value.least, atom=True)

    def materialised(self, value: Any) -> Any:
        """Return a value with all of it computed."""

        def one(leaf: Any, _: str) -> Any:
            if isinstance(leaf, Computed):
                return (
                    self.stored(*self.entries(leaf))
                    if leaf.shape
                    else self.temporary(Scalar(leaf.entry(())))
                )
            return self.temporary(leaf) if isinstance(leaf, Scalar) else leaf

        return rebuilt(value, one)

    def product(self, a: Any, b: Any) -> Any:
        """Return the matrix product."""
        a, b = self.array(a), self.array(b)
        inner = a.shape[-1]
        if inner != b.shape[0 if b.ndim == 1 else -2]:
            raise Unsupported(f"a product of shapes {a.shape} and {b.shape}")
        rows, columns = a.shape[:-1], b.shape[1:] if b.ndim > 1 else ()
        if (a.ndim > 2 and b.ndim > 1) or b.ndim > 2:
            raise Unsupported(f"a product of shapes {a.shape} and {b.shape}")
        out = self.new((*rows, *columns))

        def put(index: tuple[str, ...]) -> None:
            left, right = index[: len(rows)], index[len(rows) :]
            total, k = self.fresh("s"), self.fresh("k")
            term = f"{a.entry((*left, k))} * {b.entry((k, *right))}"
            loop = CLoop(f"for (int {k} = 0; {k} < {inner}; {k}++)")
            loop.body.append(CLine(f"{total} = {total} + {term};", total, term))
            target = out.entry(index)
            self.block += [
                CLine(f"real {total} = 0.0;", total),
                loop,
                CLine(f"{target} = {total};", out.name, f"{total} {target[len(out.name) :]}"),
            ]

        if inner and out.size:
            self.looped(out.shape, put)
        return out if out.shape else Scalar(out.entry(()))

    def select(self, test: Scalar, yes: Any, no: Any) -> Any:
        """Return one of two values, by a condition."""
        if isinstance(yes, tuple) and isinstance(no, tuple) and len(yes) == len(no):
            return tuple(self.select(test, a, b) for a, b in zip(yes, no, strict=True))
        if is_array(yes) or is_array(no):
            (shape_a, of_a, _), (shape_b, of_b, _) = map(self.entries, (yes, no))
            shape = np.broadcast_shapes(shape_a, shape_b)
            return Computed(
                shape,
                lambda i: (
                    f"({test.text} ? {of_a(_narrow(i, shape_a))} : {of_b(_narrow(i, shape_b))})"
                ),
            )
        whole = self.kind(yes) in "ib" and self.kind(no) in "ib"
        read = self.text if whole else self.real
        return Scalar(f"({test.text} ? {read(yes)} : {read(no)})", "i" if whole else "f")

    def merged(self, a: Any, b: Any, branch: Branch, before: Block) -> Any:
        """Return a value that is `a` after one block of a branch and `b` after the other.

        Raises:
            Unsupported: they have different forms.
        """
        if a is b or (isinstance(a, Scalar | Tick) and a == b):
            return a
        if isinstance(a, tuple | list | dict) and type(a) is type(b):
            if len(a) != len(b) or (isinstance(a, dict) and set(a) != set(b)):
                raise Unsupported("values of different forms in two branches")
            if isinstance(a, dict):
                return {k: self.merged(a[k], b[k], branch, before) for k in a}
            parts = [self.merged(x, y, branch, before) for x, y in zip(a, b, strict=True)]
            return type(a)(*parts) if hasattr(a, "_fields") else type(a)(parts)
        if not (is_symbolic(a) or is_symbolic(b)):
            same = np.array_equal(a, b) if is_array(a) and is_array(b) else type(a) is type(b)
            if same and (is_array(a) or a == b):
                return a
        if is_array(a) and is_array(b) and a.shape == b.shape:
            if isinstance(a, Array) and isinstance(b, Array) and a == b:
                return a
            here, self.block = self.block, before
            out = self.new(a.shape, self.kind(a))
            for self.block, value in ((branch.yes, a), (branch.no, b)):
                self.write(out, value)
            self.block = here
            return out
        if is_array(a) or is_array(b):
            raise Unsupported("arrays of different shapes in two branches")
        for one in (a, b):
            self.text(one)
        kind = "f" if "f" in (self.kind(a), self.kind(b)) else "i"
        read, name = self.real if kind == "f" else self.text, self.fresh("v")
        for block, value in ((branch.yes, a), (branch.no, b)):
            text = read(value)
            block.append(CLine(f"{name} = {text};", name, text))
        before.append(CLine(f"{TYPES[kind]} {name} = 0;", name))
        return Scalar(name, kind, atom=True)


def _narrow(index: tuple[str, ...], shape: Shape) -> tuple[str, ...]:
    """Return the indices into an array of a shape that is broadcast."""
    own = index[len(index) - len(shape) :] if shape else ()
    return tuple("0" if size == 1 else one for one, size in zip(own, shape, strict=True))


def _least(op: str, a: Any, b: Any) -> int | None:
    low, high = (one.least if isinstance(one, Scalar) else one for one in (a, b))
    if op != "+" or not (isinstance(low, int) and isinstance(high, int)):
        return None
    return low + high


def _of_ticks(op: str, a: Any, b: Any) -> Any:
    """Return sums and comparisons of ticks; None: not known beforehand."""
    if isinstance(a, Tick) and isinstance(b, Tick):
        if a.older or b.older:
            if op in _COMPARISONS and not a.older:
                ahead = a.offset - b.offset  # or more
                if op in (">", ">=", "!=", "==", "<", "<=") and ahead > 0:
                    return op in (">", ">=", "!=")
            if op == "-" and not a.older:
                return Scalar("", "i", a.offset - b.offset)
            raise Unsupported("ticks that are long past")
        return _PYTHON[op](a.offset, b.offset)
    tick, other = (a, b) if isinstance(a, Tick) else (b, a)
    if not isinstance(other, int | np.integer):
        return None
    if op == "+" or (op == "-" and isinstance(a, Tick)):
        return Tick(tick.offset + (other if op == "+" else -other), tick.phase, tick.older)
    if op not in _COMPARISONS or tick.older:
        return None
    if isinstance(b, Tick):
        op = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}.get(op, op)
    least = tick.phase + tick.offset
    if least > other:
        return op in (">", ">=", "!=")
    return op == ">=" if least == other and op in ("<", ">=") else None


def require_concrete(value: Any, what: str) -> Any:
    """Return a value that is known beforehand.

    Raises:
        ConcreteRequired: it is not.
    """
    if is_symbolic(value):
        raise ConcreteRequired(what)
    return value
