"""Many trials side by side: the step that a compiled kernel takes for all of them at once."""

from collections.abc import Callable
from typing import NamedTuple, Protocol, TypeAlias, runtime_checkable

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.contract import Testbed

LANES = 64  # trials side by side: states and slopes just fit into the first cache

# (c, t, effort, dt, steps, x, work): replaces the states x by those dt after t [s] with the efforts
# held, in so many equal steps. Flat arrays of rows of LANES: c from `constants`, efforts, states
# [q, v] in and out, and `scratch` times as many entries as there are states
Advance: TypeAlias = Callable[[Vector, float, Vector, float, int, Vector, Vector], None]


class LaneKernel(NamedTuple):
    """How a testbed flies in lanes."""

    advance: Advance
    scratch: int
    constants: Callable[[Matrix], Vector]  # from packed parameters, shape (P, LANES)
    steps: Callable[[Vector, float], int]  # that a tick needs, from packed parameters and the tick


@runtime_checkable
class Laned(Protocol):
    """A testbed whose equations are written for vector instructions."""

    def lanes(self) -> LaneKernel:
        """Return how it flies in lanes."""


def lane_kernel(testbed: Testbed) -> LaneKernel | None:
    """Return how a testbed flies in lanes; None where it does not say so."""
    return testbed.lanes() if isinstance(testbed, Laned) else None
