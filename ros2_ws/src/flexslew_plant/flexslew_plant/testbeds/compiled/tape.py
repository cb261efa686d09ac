"""Equations written down as one list of operations, by running them on numbers that take notes.

What every member has alike is decided while the list is made: sizes, kinds and zeros of packed
numbers are taken as they are, branches on them are gone, products with zero as well. What depends
on packed numbers alone is computed once per trial, and not in every step.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from flexslew_plant.arrays import Matrix, Vector

Value: TypeAlias = Any  # a Number of the tape, or a constant
_PLAIN = (0.0, 1.0, -1.0)  # packed numbers that are taken as they are
_EVALUATED: dict[str, Callable[..., Any]] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
    "sqrt": np.sqrt,
    "sine": np.sin,
    "cosine": np.cos,
    "abs": np.abs,
    "arctan2": np.arctan2,
    "<": np.less,
    ">=": np.greater_equal,
    "&": np.logical_and,
    "where": np.where,
}


class TraceError(Exception):
    """The equations branch on what differs from member to member."""


@dataclass
class Tape:
    """The operations in their order, none of them twice.

    Args:
        packed: the numbers of one testbed.
    """

    packed: Vector
    nodes: list[tuple[Any, ...]] = field(init=False, default_factory=list)
    parametric: list[bool] = field(init=False, default_factory=list)
    fixed: set[int] = field(init=False, default_factory=set)  # packed numbers that were looked at
    _index_of: dict[tuple[Any, ...], int] = field(init=False, default_factory=dict)

    def input(self, name: str, index: int) -> "Number":
        """Return an entry of what changes from step to step."""
        return self._node(("input", name, index), False)

    def parameters(self) -> Any:
        """Return the packed numbers, shape (P,)."""
        found = np.empty(self.packed.size, dtype=object)
        for k, value in enumerate(self.packed.tolist()):
            if value in _PLAIN:
                found[k] = value
            else:
                node = self._node(("packed", k), True)
                found[k] = PackedNumber(self, node.index, k, value)
        return found

    def operation(self, name: str, *given: Value) -> Value:
        """Return the result of an operation on numbers of this tape and constants."""
        if not any(isinstance(value, Number) for value in given):
            return float(_EVALUATED[name](*given))
        simple = _simplify(name, given)
        if simple is not None:
            return simple
        parts = tuple(v.index if isinstance(v, Number) else ("constant", float(v)) for v in given)
        parametric = all(self.parametric[v.index] for v in given if isinstance(v, Number))
        if name == "/" and given[0] != 1.0:  # several divisions by one number need one division
            return self.operation("*", given[0], self.operation("/", 1.0, given[1]))
        return self._node((name, *parts), parametric)

    def evaluated(self, packed: Matrix, wanted: list[int]) -> Matrix:
        """Return nodes that depend on packed numbers alone, shape (wanted, members).

        Args:
            packed: of every member, shape (P, members).
            wanted: their places on the tape.
        """
        found: dict[int, Any] = {}

        def value(part: Any) -> Any:
            return part[1] if isinstance(part, tuple) else found[part]

        for k, (name, *parts) in enumerate(self.nodes):
            if not self.parametric[k]:
                continue
            if name == "packed":
                found[k] = packed[parts[0]]
            else:
                found[k] = _EVALUATED[name](*map(value, parts))
        return np.array([found[k] for k in wanted]).reshape(len(wanted), packed.shape[1])

    def _node(self, node: tuple[Any, ...], parametric: bool) -> "Number":
        if node not in self._index_of:
            self._index_of[node] = len(self.nodes)
            self.nodes.append(node)
            self.parametric.append(parametric)
        return Number(self, self._index_of[node])


def _simplify(name: str, given: tuple[Value, ...]) -> Value:
    """Return what an operation gives without being carried out; None: it must be."""
    a, b = given[0], given[-1]
    left, right = (None if isinstance(v, Number) else v for v in (a, b))
    if name == "*":
        if 0.0 in (left, right):
            return 0.0
        if left == 1.0:
            return b
        if right == 1.0:
            return a
    if name == "+" and left == 0.0:
        return b
    if name in "+-" and right == 0.0:
        return a
    if name == "/" and (left == 0.0 or right == 1.0):
        return a
    return None


def _noted(name: str, swapped: bool = False) -> Callable[["Number", Value], Value]:
    """Return the operator of a number and another value; swapped: the other one stands first."""

    def noted(one: "Number", other: Value) -> Value:
        return one.tape.operation(name, *((other, one) if swapped else (one, other)))

    return noted


class Number:
    """A result on a tape."""

    __slots__ = ("index", "tape")

    def __init__(self, tape: Tape, index: int) -> None:
        self.tape, self.index = tape, index

    __add__, __radd__ = _noted("+"), _noted("+", swapped=True)
    __sub__, __rsub__ = _noted("-"), _noted("-", swapped=True)
    __mul__, __rmul__ = _noted("*"), _noted("*", swapped=True)
    __truediv__, __rtruediv__ = _noted("/"), _noted("/", swapped=True)
    __lt__, __gt__ = _noted("<"), _noted("<", swapped=True)
    __ge__, __le__ = _noted(">="), _noted(">=", swapped=True)
    __and__ = _noted("&")

    def __neg__(self) -> Value:
        """Note the negative."""
        return self.tape.operation("-", 0.0, self)

    def __abs__(self) -> Value:
        """Note the absolute value."""
        return self.tape.operation("abs", self)

    def __pow__(self, power: float) -> Value:
        """Note a square or a root.

        Raises:
            Untraceable: another power.
        """
        if power == 2:
            return self.tape.operation("*", self, self)
        if power == 0.5:
            return self.tape.operation("sqrt", self)
        raise TraceError(f"a power of {power}")

    def __eq__(self, other: object) -> bool:
        """Return False for any other value: no member is taken to be idle."""
        return self is other

    __hash__ = None  # type: ignore[assignment]

    def __bool__(self) -> bool:
        """Refuse to branch.

        Raises:
            Untraceable: always.
        """
        raise TraceError("a branch on what differs from member to member")


class PackedNumber(Number):
    """A packed number: reading its value makes it a constant, the same in all members."""

    __slots__ = ("at", "value")

    def __init__(self, tape: Tape, index: int, at: int, value: float) -> None:
        super().__init__(tape, index)
        self.at, self.value = at, value

    def _seen(self) -> float:
        self.tape.fixed.add(self.at)
        return self.value

    def __int__(self) -> int:
        """Return it as a size or a place."""
        return int(self._seen())

    def __eq__(self, other: object) -> bool:
        """Compare its value."""
        return self._seen() == other

    __hash__ = None

    def __lt__(self, other: Value) -> Any:
        """Compare its value with a constant."""
        return super().__lt__(other) if isinstance(other, Number) else self._seen() < other

    def __gt__(self, other: Value) -> Any:
        """Compare its value with a constant."""
        return super().__gt__(other) if isinstance(other, Number) else self._seen() > other
