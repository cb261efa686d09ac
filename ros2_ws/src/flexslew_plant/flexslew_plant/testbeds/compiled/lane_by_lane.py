"""Any testbed in lanes: one after the other by the integrator of the bench.

No vector instructions, but nothing of Python between two ticks either.
"""

from functools import lru_cache
from typing import cast

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, compiled
from flexslew_plant.testbeds.compiled import dynamics
from flexslew_plant.testbeds.compiled.lanes import LANES, Advance, LaneKernel
from flexslew_plant.testbeds.kernels import Kernels
from flexslew_plant.testbeds.model import Model


def lane_by_lane(model: Model) -> LaneKernel | None:
    """Return how a testbed flies in lanes; None where its joints are not its first coordinates."""
    beginning = model.leading is None and model.kernels.kinematics is None
    if not beginning or model.efforts != model.joints or model.outside is not None:
        return None
    return _kernel(model.kernels, model.coordinates, model.joints, model.packed.size)


@lru_cache
def _kernel(kernels: Kernels, n: int, m: int, numbers: int) -> LaneKernel:
    """Return the kernel of testbeds with these equations.

    Args:
        kernels: the equations.
        n: coordinates.
        m: joints.
        numbers: how many are packed.
    """
    constants = (2 * n + m) * LANES

    @compiled
    def advance(t: float, dt: float, steps: int, w: Vector) -> None:
        p, x, effort = np.empty(numbers), np.empty(2 * n), np.empty(m)
        for lane in range(LANES):
            for i in range(2 * n):
                x[i] = w[i * LANES + lane]
            for i in range(m):
                effort[i] = w[(2 * n + i) * LANES + lane]
            for i in range(numbers):
                p[i] = w[constants + i * LANES + lane]
            dynamics.take_steps(kernels, p, t, effort, dt / steps, steps, n, m, x)
            for i in range(2 * n):
                w[i * LANES + lane] = x[i]

    def place(packed: Matrix) -> Vector:
        w = np.zeros(constants + numbers * LANES)
        w[constants:] = packed.ravel()
        return w

    size = constants + numbers * LANES
    return LaneKernel(cast(Advance, advance), size, place, _one_step)


def _one_step(packed: Vector, dt: float) -> int:
    """Return how many steps a tick takes on the bench."""
    return 1
