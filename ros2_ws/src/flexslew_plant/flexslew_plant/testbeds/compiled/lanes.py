"""Many trials side by side: the step that a compiled kernel takes for all of them at once."""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple, Protocol, TypeAlias, cast, runtime_checkable

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.contract import Testbed

LANES = 64  # trials side by side: states and slopes just fit into the first cache

_LINE = 8  # numbers in a line of the cache

# (t, dt, steps, w): replaces the states by those dt after t [s] with the efforts held, in so many
# equal steps. w is flat, rows of LANES: states [q, v], efforts, and what `place` puts after them
Advance: TypeAlias = Callable[[float, float, int, Vector], None]


class LaneKernel(NamedTuple):
    """How a testbed flies in lanes."""

    advance: Advance
    size: int  # of its array
    place: Callable[[Matrix], Vector]  # its array at rest, from packed parameters, (P, LANES)
    steps: Callable[[Vector, float], int]  # that a tick needs, from packed parameters and the tick


@runtime_checkable
class Laned(Protocol):
    """A testbed whose equations are written for vector instructions."""

    def lanes(self) -> LaneKernel:
        """Return how it flies in lanes."""


def lane_kernel(testbed: Testbed) -> LaneKernel | None:
    """Return how a testbed flies by vector instructions; None where it does not say so."""
    return cast(Laned, testbed).lanes() if _laned(type(testbed)) else None


@lru_cache
def _laned(kind: type) -> bool:
    return issubclass(kind, Laned)


def flat_zeros(size: int) -> Vector:
    """Return so many zeros that begin a line of the cache: a vector across two takes two turns."""
    room = np.zeros(size + _LINE)
    start = -(room.ctypes.data // room.itemsize) % _LINE
    return room[start : start + size]
