"""Any testbed in a batch: one after the other by the integrator of the bench.

No vector instructions, but nothing of Python between two ticks either: for equations that branch
on what differs from member to member, as on the time of a prescribed turn.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, compiled, put
from flexslew_plant.testbeds.compiled.batch_kernel import (
    BATCH_WIDTH,
    BatchKernel,
    member_rows,
    rows_of,
    skip,
)
from flexslew_plant.testbeds.compiled.bound import bound
from flexslew_plant.testbeds.kernels import Kernels
from flexslew_plant.testbeds.model import Model


def scalar_kernel(model: Model) -> BatchKernel:
    """Return how a testbed flies in a batch."""
    sizes = model.coordinates, model.before_modes, model.efforts, model.joints, model.modes
    return _kernel(model.kernels, *sizes, model.packed.size)


@lru_cache
def _kernel(
    kernels: Kernels, n: int, m: int, efforts: int, joints: int, modes: int, numbers: int
) -> BatchKernel:
    """Return the kernel of testbeds with these equations.

    Args:
        kernels: the equations.
        n: coordinates.
        m: of them before the modes.
        efforts: how many.
        joints: how many.
        modes: how many.
        numbers: how many are packed.
    """
    read_joints, take = kernels.compiled.get("reading"), bound(kernels, n, m).advance
    states = 2 * n + kernels.extra_positions
    rows = rows_of(states, efforts, joints, modes, read_joints is not None)
    effort_row, position, rate, constants = rows.effort, rows.position, rows.rate, rows.end

    @compiled
    def advance(t: float, dt: float, steps: int, filled: int, w: Vector) -> None:
        p, x, effort = np.empty(numbers), np.empty(states), np.empty(efforts)
        for member in range(filled):
            put(member_rows(w, 0, states, member), x)
            put(member_rows(w, effort_row, efforts, member), effort)
            put(member_rows(w, constants, numbers, member), p)
            take(p, t, effort, dt, steps, m, x)
            put(x, member_rows(w, 0, states, member))

    read: Callable[[int, Vector], None] = skip
    if read_joints is not None:

        @compiled
        def read(filled: int, w: Vector) -> None:
            p, x = np.empty(numbers), np.empty(states)
            at, joint_rate = np.empty(joints), np.empty(joints)
            for member in range(filled):
                put(member_rows(w, 0, states, member), x)
                put(member_rows(w, constants, numbers, member), p)
                read_joints(p, x, at, joint_rate)
                put(at, member_rows(w, position, joints, member))
                put(joint_rate, member_rows(w, rate, joints, member))

    def place(packed: Matrix) -> Vector:
        w = np.zeros(constants + numbers * BATCH_WIDTH)
        w[constants:] = packed.ravel()
        return w

    return BatchKernel(advance, read, rows, constants + numbers * BATCH_WIDTH, place, np.inf)
