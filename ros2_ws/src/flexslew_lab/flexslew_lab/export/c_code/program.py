"""The statements of the C program: written down in order, and without those that nobody reads."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

_NAMES = re.compile(r"(?:(?:memory|input|output)->)?[A-Za-z_]\w*")


@dataclass(frozen=True)
class CLine:
    """A statement.

    Args:
        text: C code.
        target: name of what it declares or writes.
        value: C code that it reads.
    """

    text: str
    target: str
    value: str = ""


@dataclass
class CLoop:
    """A bounded loop."""

    head: str
    body: "Block" = field(default_factory=list)


@dataclass
class Branch:
    """A condition with two blocks."""

    test: str
    yes: "Block" = field(default_factory=list)
    no: "Block" = field(default_factory=list)


Node: TypeAlias = CLine | CLoop | Branch
Block: TypeAlias = list[Node]


def literal(value: float | int | bool) -> str:
    """Return a number as C has it."""
    if isinstance(value, bool | np.bool_):
        return str(int(value))
    if isinstance(value, int | np.integer):
        return str(int(value)) if value >= 0 else f"({int(value)})"
    number = float(value)
    if np.isnan(number):
        return "NAN"
    if np.isinf(number):
        return "INFINITY" if number > 0 else "(-INFINITY)"
    text = repr(number)
    text = text if any(c in text for c in ".e") else text + ".0"
    return f"({text})" if text.startswith("-") else text


class Constants:
    """Tables of the program: every array of numbers once."""

    def __init__(self) -> None:
        self._names: dict[tuple[str, bytes], str] = {}
        self.arrays: dict[str, NDArray[np.float64]] = {}

    def name(self, values: NDArray[np.float64]) -> tuple[str, str]:
        """Return the name of a table, and the kind of its entries; see values.Scalar."""
        kind = {"b": "b", "i": "i", "u": "i"}.get(values.dtype.kind, "f")
        numbers = np.ascontiguousarray(values)
        key = kind, numbers.tobytes()
        if key not in self._names:
            self._names[key] = f"table_{len(self._names)}"
            self.arrays[self._names[key]] = numbers
        return self._names[key], kind


def live_names(blocks: list[Block], outputs: set[str]) -> set[str]:
    """Return the names that the outputs depend on, over all blocks and through the memory."""
    live, before = set(outputs), -1
    while len(live) != before:
        before = len(live)
        for block in blocks:
            _mark(block, live)
    return live


def _mark(block: Block, live: set[str]) -> bool:
    """Add what living statements read; return whether there are any."""
    found = False
    for node in reversed(block):
        if isinstance(node, CLine):
            if node.target in live:
                live.update(_NAMES.findall(node.value))
                found = True
            continue
        inner = [node.body] if isinstance(node, CLoop) else [node.yes, node.no]
        if any([_mark(one, live) for one in inner]):
            live.update(_NAMES.findall(node.head if isinstance(node, CLoop) else node.test))
            found = True
    return found


def printed(block: Block, live: set[str], indent: int = 1) -> Iterator[str]:
    """Return the lines of the living statements."""
    pad = "    " * indent
    for node in block:
        if isinstance(node, CLine):
            if node.target in live:
                yield pad + node.text
        elif isinstance(node, CLoop):
            body = list(printed(node.body, live, indent + 1))
            if body:
                yield from (f"{pad}{node.head} {{", *body, f"{pad}}}")
        else:
            yes, no = (list(printed(one, live, indent + 1)) for one in (node.yes, node.no))
            if yes:
                yield from (f"{pad}if ({node.test}) {{", *yes)
                yield from ((f"{pad}}} else {{", *no) if no else ())
                yield pad + "}"
            elif no:
                yield from (f"{pad}if (!({node.test})) {{", *no, f"{pad}}}")
