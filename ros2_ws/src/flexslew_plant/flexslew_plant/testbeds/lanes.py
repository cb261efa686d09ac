"""Many trials side by side: the step that a compiled kernel takes for all of them at once."""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple, Protocol, TypeAlias, cast, runtime_checkable

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, compiled
from flexslew_plant.testbeds import dynamics
from flexslew_plant.testbeds.contract import Testbed
from flexslew_plant.testbeds.kernels import Kernels

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
    """Return how a testbed flies in lanes; None where joints and efforts are not the same.

    A testbed that does not say so itself is flown lane after lane, by the bench's own step.
    """
    if isinstance(testbed, Laned):
        return testbed.lanes()
    model = testbed.model()
    own = model.kernels.actuation is not None or model.kernels.extra_positions > 0
    if own or model.efforts != model.joints:
        return None
    advance = one_by_one(model.kernels, model.coordinates, model.joints, model.packed.size)
    return LaneKernel(advance, 1, _flat, _one_step)


@lru_cache
def one_by_one(kernels: Kernels, n: int, m: int, parameters: int) -> Advance:
    """Return the bench's step for every lane in turn; its bits are those of the bench.

    Args:
        kernels: the equations.
        n: coordinates.
        m: joints.
        parameters: packed ones.
    """
    step = dynamics.bound(kernels, n, m).advance

    @compiled
    def advance(
        c: Vector, t: float, effort: Vector, dt: float, steps: int, x: Vector, work: Vector
    ) -> None:
        p, u, state = np.empty(parameters), np.empty(m), np.empty(2 * n)
        for k in range(LANES):
            for i in range(parameters):
                p[i] = c[i * LANES + k]
            for i in range(m):
                u[i] = effort[i * LANES + k]
            for i in range(2 * n):
                state[i] = x[i * LANES + k]
            step(p, t, u, dt, steps, state)
            for i in range(2 * n):
                x[i * LANES + k] = state[i]

    return cast(Advance, advance)


def _flat(packed: Matrix) -> Vector:
    return np.ascontiguousarray(packed).ravel()


def _one_step(packed: Vector, dt: float) -> int:
    return 1
