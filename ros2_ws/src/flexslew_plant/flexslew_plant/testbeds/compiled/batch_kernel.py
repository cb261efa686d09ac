"""Many trials side by side: the step that a compiled kernel takes for all of them at once."""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, called

BATCH_WIDTH = 64  # trials side by side

_LINE = 8  # numbers in a line of the cache

# (t, dt, steps, filled, w): replaces the states by those dt after t [s] with the efforts held, in
# so many equal steps, at least in the first `filled` members. w is flat, rows of BATCH_WIDTH:
# states [q, v], efforts, and what `place` puts after them
Advance: TypeAlias = Callable[[float, float, int, int, Vector], None]


class KernelRows(NamedTuple):
    """Where in the flat array rows of BATCH_WIDTH begin."""

    effort: int  # behind the states
    position: int  # of the joints
    rate: int
    mode: int  # modal coordinates
    mode_rate: int
    end: int  # of what every kernel has; its own comes from here on


class BatchKernel(NamedTuple):
    """How a testbed flies in a batch."""

    advance: Advance
    # (filled, w): writes the joints where they are no entries of the state
    read: Callable[[int, Vector], None]
    rows: KernelRows
    size: int  # of its array
    place: Callable[[Matrix], Vector]  # its array at rest, from packed parameters, (P, BATCH_WIDTH)
    reach: float  # largest frequency times step; inf: it takes one step per tick, as the bench


def rows_of(states: int, efforts: int, joints: int, modes: int, reads: bool) -> KernelRows:
    """Return where the rows begin.

    Args:
        states: entries of [q, v].
        efforts: how many.
        joints: how many.
        modes: how many, the last entries of q and of v.
        reads: whether the joints are read rather than the first entries of q and v.
    """
    positions = states // 2 + states % 2  # a quaternion has one entry more than its rate
    offset = states + efforts
    first, rate = (offset, offset + joints) if reads else (0, positions)
    end = offset + 2 * joints if reads else offset
    places = (states, first, rate, positions - modes, states - modes, end)
    return KernelRows(*(BATCH_WIDTH * place for place in places))


@called
def skip(*given: Any) -> None:
    """Do nothing: the part of a tick that a batch does not have."""


@called
def member_rows(w: Vector, first: int, count: int, member: int) -> Vector:
    """Return a view of some rows of the flat array of one member, shape (count,).

    Args:
        w: flat array, of which it is a part.
        first: where the first row begins.
        count: of the rows.
        member: index of the member.
    """
    return w[first + member : first + member + count * BATCH_WIDTH : BATCH_WIDTH]


def flat_zeros(size: int) -> Vector:
    """Return so many zeros that begin a line of the cache: a vector across two takes two turns."""
    buffer = np.zeros(size + _LINE)
    start = -(buffer.ctypes.data // buffer.itemsize) % _LINE
    return buffer[start : start + size]
