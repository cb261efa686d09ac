"""How testbeds fly in a batch, of many at once: by which kernel, in how many steps."""

from collections.abc import Hashable, Sequence
from typing import NamedTuple

import numpy as np

from flexslew_plant.errors import FlexslewError
from flexslew_plant.testbeds.compiled.batch_kernel import BatchKernel
from flexslew_plant.testbeds.compiled.scalar_kernel import scalar_kernel
from flexslew_plant.testbeds.compiled.traced_kernel import traced_kernels
from flexslew_plant.testbeds.model import Model


class BatchSteps(NamedTuple):
    """How a testbed flies in a batch."""

    kernel: BatchKernel
    steps: int  # of the kernel per tick


def batch_steps(models: Sequence[Model], periods: Sequence[float]) -> list[BatchSteps | None]:
    """Return how each of many testbeds flies in a batch; None: its equations cannot be compiled.

    Args:
        models: of the testbeds.
        periods: their ticks [s].
    """
    groups = dict[Hashable, list[int]]()
    for k, model in enumerate(models):
        kind = model.kernels, model.sizes, model.packed.size, model.highest_frequency
        groups.setdefault(kind, []).append(k)
    found: list[BatchSteps | None] = [None] * len(models)
    for places in groups.values():
        group_steps = _of_one_kind([models[k] for k in places], [periods[k] for k in places])
        for k, one in zip(places, group_steps, strict=True):
            found[k] = one
    return found


def _of_one_kind(models: Sequence[Model], periods: Sequence[float]) -> Sequence[BatchSteps | None]:
    packed, bound = np.array([model.packed for model in models]), models[0].highest_frequency
    try:
        exact = models[0].kernels.advance is not None
        traced = (
            [None] * len(models) if exact else traced_kernels(models, packed, bound is not None)
        )
        kernels = [
            kernel or scalar_kernel(model) for kernel, model in zip(traced, models, strict=True)
        ]
    except FlexslewError:
        return [None] * len(models)
    fast = np.zeros(len(models)) if bound is None else bound(packed.T) * np.array(periods)
    reach = np.array([kernel.reach for kernel in kernels])
    steps = np.maximum(np.ceil(fast / reach), 1.0).astype(int).tolist()
    return [BatchSteps(*one) for one in zip(kernels, steps, strict=True)]
