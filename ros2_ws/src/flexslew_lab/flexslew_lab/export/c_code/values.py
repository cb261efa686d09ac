"""What the evaluator computes with: numbers that the C program has, beside Python's own.

A Python object is a constant of the program. A Scalar is a number of which only the C expression is
known, an Array one of C's arrays with a static shape, and a Computed an element-wise expression of
arrays that is written out where it is stored.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from math import prod
from typing import Any, TypeAlias

Shape: TypeAlias = tuple[int, ...]


class Unsupported(Exception):
    """A construct that cannot be written in C; its message names it."""


class ConcreteRequired(Unsupported):
    """A construct that needs a number that is known beforehand, such as the size of an array."""


@dataclass(frozen=True)
class Scalar:
    """A number of the C program.

    Args:
        text: C expression, in parentheses where it is one of several terms.
        kind: f: float, i: int, b: int that is 0 or 1.
        least: lower bound of an int, where one is known.
        atom: whether the text is a name whose value never changes, or a constant.
    """

    text: str
    kind: str = "f"
    least: int | None = None
    atom: bool = False


@dataclass(frozen=True)
class Tick:
    """The tick of the bench plus an offset; `older`: at most that.

    Args:
        offset: offset from the present tick.
        phase: ticks since the first one, at least.
        older: whether it is only known to be no later.
    """

    offset: int
    phase: int
    older: bool = False


@dataclass(frozen=True)
class Array:
    """A part of a C array.

    Args:
        name: of the C array.
        shape: static shape.
        strides: in entries.
        start: where its first entry stands: a number, and a C expression, or empty.
        kind: of the entries, see Scalar.
        known: entries of the C array that are constants of the program, by their places.
    """

    name: str
    shape: Shape
    strides: Shape
    start: tuple[int, str] = (0, "")
    kind: str = "f"
    known: Mapping[int, float] = field(default_factory=dict, compare=False)

    @property
    def size(self) -> int:
        """Number of entries."""
        return prod(self.shape)

    @property
    def ndim(self) -> int:
        """Number of indices."""
        return len(self.shape)

    @property
    def contiguous(self) -> bool:
        """Whether its entries follow each other."""
        return self.strides == row_major(self.shape)

    @property
    def T(self) -> "Array":  # noqa: N802 - as NumPy's
        """The transposed array."""
        return Array(self.name, self.shape[::-1], self.strides[::-1], self.start, self.kind)

    def __len__(self) -> int:
        """Return the size along the first index."""
        return self.shape[0]

    def entry(self, index: tuple[str, ...]) -> str:
        """Return the C expression of an entry, each index an expression."""
        number, terms = self.start[0], [self.start[1]] if self.start[1] else []
        for one, stride, size in zip(index, self.strides, self.shape, strict=True):
            if size == 1 or stride == 0:
                continue
            if one.isdigit():
                number += int(one) * stride
            else:
                terms.append(one if stride == 1 else f"{one} * {stride}")
        if number or not terms:
            terms.append(str(number))
        return f"{self.name}[{' + '.join(terms)}]"


@dataclass(frozen=True, eq=False)
class Computed:
    """An array whose entries are expressions, until it is stored."""

    shape: Shape
    entry: Callable[[tuple[str, ...]], str]
    kind: str = "f"

    @property
    def ndim(self) -> int:
        """Number of indices."""
        return len(self.shape)

    def __len__(self) -> int:
        """Return the size along the first index."""
        return self.shape[0]


class Poison:
    """What an attribute has where its value depends on the branch that was taken."""


POISON = Poison()


def row_major(shape: Shape) -> Shape:
    """Return the strides of an array whose entries follow each other."""
    return tuple(prod(shape[k + 1 :]) for k in range(len(shape)))


def children(value: Any) -> Iterator[Any]:
    """Return the parts of a container."""
    if isinstance(value, tuple | list):
        yield from value
    elif isinstance(value, dict):
        yield from value.values()


def is_symbolic(value: Any) -> bool:
    """Return whether a value, or a part of a container, is one of the C program's."""
    if isinstance(value, Scalar | Tick | Array | Computed | Poison):
        return True
    return any(is_symbolic(part) for part in children(value))


def rebuilt(value: Any, change: Callable[[Any, str], Any], path: str = "") -> Any:
    """Return a container with each leaf replaced.

    Args:
        value: tuples, lists and dictionaries of leaves.
        change: maps a leaf and its path to another one.
        path: of the container.
    """
    if isinstance(value, tuple):
        names = getattr(value, "_fields", range(len(value)))
        parts = [rebuilt(v, change, f"{path}_{n}") for n, v in zip(names, value, strict=True)]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    if isinstance(value, list):
        return [rebuilt(v, change, f"{path}_{n}") for n, v in enumerate(value)]
    if isinstance(value, dict):
        return {k: rebuilt(v, change, f"{path}_{k}") for k, v in value.items()}
    return change(value, path)
