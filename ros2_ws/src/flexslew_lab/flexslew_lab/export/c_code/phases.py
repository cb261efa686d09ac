"""What a step keeps in memory, found by carrying it out until its memory has one form.

The first tick differs from the second one, and that from all others: an estimator begins, a queue
of late readings fills. Each such tick is a phase with code of its own; the last one is for ever.
What changes from tick to tick is memory of the program, all else stays a constant of its code.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flexslew_lab.export.c_code.evaluator import Evaluator
from flexslew_lab.export.c_code.operations import is_array
from flexslew_lab.export.c_code.program import Block, CLine
from flexslew_lab.export.c_code.values import (
    POISON,
    Array,
    Poison,
    Scalar,
    Shape,
    Tick,
    Unsupported,
    is_symbolic,
    rebuilt,
    row_major,
)

_MOST = 64  # phases


@dataclass(frozen=True)
class MemoryMember:
    """A member of the memory."""

    name: str
    shape: Shape
    kind: str  # see Scalar
    known: Mapping[int, float] = field(default_factory=dict, compare=False)  # see Array


def _array(member: MemoryMember) -> Array:
    """Return a member as an array of the program."""
    shape = member.shape
    place = f"memory->{member.name}", shape, row_major(shape), (0, "")
    return Array(*place, member.kind, member.known)


class Phases:
    """The code of each phase of a step, and its memory.

    Args:
        make: returns an evaluator at the start, and the step, which it carries out.

    Attributes:
        blocks: statements by phase.
        members: of the memory, by name.
        starts: statements that write what the memory holds at the start.
    """

    def __init__(self, make: Callable[[], tuple[Evaluator, Callable[[int], None]]]) -> None:
        self._make = make
        self._varying: set[str] = set()  # constants of one phase that are others in the next
        self._older: dict[str, int] = {}  # ticks of the past, and from which phase on
        while not self._trace():
            pass

    def _trace(self) -> bool:
        """Trace the phases; return whether what is known to vary was enough."""
        e, step = self._make()
        self.evaluator, self.members = e, dict[str, MemoryMember]()
        self.blocks, self.starts = list[Block](), list[Any]()
        state = self._started(e)
        for phase in range(_MOST):
            block: Block = []
            e.ops.block, e.attributes = block, self._loaded(e, state, phase)
            before = self._leaves(e, e.attributes)
            step(phase)
            state = self._committed(e)
            self.blocks.append(block)
            after = self._leaves(e, self._loaded(e, state, phase + 1))
            changed = {path for path in before | after if not _same(before, after, path)}
            if not changed:
                return True
            if phase >= 2 and all(_widens(before.get(p), after.get(p)) for p in changed):
                for path in changed:
                    if isinstance(after[path], Tick):
                        self._older[path] = phase
                    else:
                        self._varying.add(path)
                return False
        raise Unsupported(f"a memory whose form still changes after {_MOST} ticks")

    def _started(self, e: Evaluator) -> dict[tuple[int, str], Any]:
        """Write the starts of the memory; return the state that consists of them."""
        e.ops.block, state = self.starts, dict[tuple[int, str], Any]()
        for key, (value, known) in e.starts.items():
            member = MemoryMember(self._path(e, key), value.shape, "f", known)
            self.members[member.name] = state[key] = member
            e.ops.write(_array(member), value)
        return state

    def function(self, write: Callable[[Evaluator], None]) -> Block:
        """Return the statements of a function that reads the memory as it is at the start.

        Args:
            write: carries it out.
        """
        e, block = self.evaluator, list[Any]()
        state = {key: self.members[self._path(e, key)] for key in e.starts}
        e.ops.block, e.attributes = block, self._loaded(e, state, 0)
        write(e)
        return block

    def _path(self, e: Evaluator, key: tuple[int, str]) -> str:
        kind = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", type(e.objects[key[0]]).__name__).lower()
        same = [k for k in e.objects if type(e.objects[k]) is type(e.objects[key[0]])]
        number = f"_{same.index(key[0]) + 1}" if same.index(key[0]) else ""
        return f"{kind}{number}_{key[1].strip('_')}"

    def _leaves(self, e: Evaluator, state: dict[tuple[int, str], Any]) -> dict[str, Any]:
        found = dict[str, Any]()
        for key, value in state.items():
            rebuilt(value, lambda leaf, path: found.setdefault(path, leaf), self._path(e, key))
        return found

    def _loaded(
        self, e: Evaluator, state: dict[tuple[int, str], Any], phase: int
    ) -> dict[tuple[int, str], Any]:
        """Return the state at the start of a phase."""

        def one(leaf: Any, path: str) -> Any:
            if isinstance(leaf, Tick):
                if path in self._older and phase >= self._older[path]:
                    return Tick(-self._older[path], phase, older=True)
                return Tick(leaf.offset - (not leaf.older), phase, leaf.older)
            if not isinstance(leaf, MemoryMember):
                return leaf
            if leaf.shape:
                return _array(leaf)
            return Scalar(f"memory->{leaf.name}", leaf.kind, atom=True)

        return {key: rebuilt(value, one, self._path(e, key)) for key, value in state.items()}

    def _committed(self, e: Evaluator) -> dict[tuple[int, str], Any]:
        """Write what changed into the memory; return the state with the members in its place."""
        ops, writes = e.ops, list[tuple[MemoryMember, Any]]()

        def one(leaf: Any, path: str) -> Any:
            varies = path in self._varying and isinstance(leaf, bool | int | float | np.ndarray)
            if isinstance(leaf, Tick | Poison) or not (varies or is_symbolic(leaf)):
                return leaf
            member = self._member(path, tuple(leaf.shape) if is_array(leaf) else (), ops.kind(leaf))
            name = f"memory->{member.name}"
            if is_array(leaf):
                if isinstance(leaf, Array) and leaf.name == name and leaf.start == (0, ""):
                    return member
                if isinstance(leaf, Array) and leaf.name.startswith("memory->"):
                    leaf = ops.stored(*ops.entries(leaf))
            elif isinstance(leaf, Scalar) and leaf.text == name:
                return member
            elif isinstance(leaf, Scalar) and "memory->" in leaf.text:
                leaf = ops.temporary(Scalar(leaf.text, leaf.kind))
            writes.append((member, leaf))
            return member

        state = {key: rebuilt(v, one, self._path(e, key)) for key, v in e.attributes.items()}
        for member, leaf in writes:
            name = f"memory->{member.name}"
            if member.shape:
                ops.write(_array(member), leaf)
            else:
                text = ops.real(leaf) if member.kind == "f" else ops.text(leaf)
                ops.block.append(CLine(f"{name} = {text};", name, text))
        return state

    def _member(self, path: str, shape: Shape, kind: str) -> MemoryMember:
        member = MemoryMember(path, shape, "f" if 0 in shape else kind)
        found = self.members.setdefault(path, member)
        if found == member:
            member = found
        else:
            name = "_".join((path, kind, *map(str, shape)))
            member = MemoryMember(name, shape, kind)
            self.members[name] = member
        return member


def _same(before: dict[str, Any], after: dict[str, Any], path: str) -> bool:
    if path not in before or path not in after:
        return False
    a, b = before[path], after[path]
    if isinstance(a, Tick) and isinstance(b, Tick):
        return (a.offset, a.older) == (b.offset, b.older)
    if isinstance(a, Array) and isinstance(b, Array):
        return (a.name, a.shape) == (b.name, b.shape)
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b)
    if a is b or (a is POISON and b is POISON):
        return True
    return type(a) is type(b) and not isinstance(a, np.ndarray) and bool(a == b)


def _widens(before: Any, after: Any) -> bool:
    """Return whether a leaf keeps its kind and changes its value."""
    if isinstance(before, Tick) and isinstance(after, Tick):
        return not after.older
    kinds = bool | int | float | np.ndarray
    return isinstance(before, kinds) and type(before) is type(after)
