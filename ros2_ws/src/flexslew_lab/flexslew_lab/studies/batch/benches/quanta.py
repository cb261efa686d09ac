"""Quantised readings and efforts, and which batches are too near to an edge.

Members differ from the bench in the last digits. Where a value is nearer to the edge between two
quanta than a guard well above that, a member does not decide on which side the bench is: it is in
doubt, and its trial is flown again by the bench.
"""

from collections.abc import Callable
from typing import cast

import numpy as np

from flexslew_lab.studies.batch.groups.rows import Rows, Sizes
from flexslew_plant.arrays import Vector, called, vectorised
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH

# of a reading, or of one where it is smaller, and of the limit of an effort; members differ from
# the bench by 1e-13 of them at most
GUARD = 2e-12


def quantising(rows: Rows, sizes: Sizes) -> Callable[[Vector], None]:
    """Return what makes readings multiples of their quanta; see Sensors.

    Args:
        rows: of the group.
        sizes: of the group.
    """
    reading, quantum, flag_row, count = rows.reading, rows.quantum, rows.doubt, sizes.outputs
    quantised = sizes.quantised

    @vectorised
    def quantise(w: Vector) -> None:
        if not quantised:  # known to the compiler
            return
        for i in range(count):
            for member in range(BATCH_WIDTH):
                at = reading + i * BATCH_WIDTH + member
                step, value = w[quantum + i * BATCH_WIDTH + member], w[at]
                parts = value / (step if step > 0.0 else 1.0)
                whole = np.round(parts)
                far = abs(abs(parts - whole) - 0.5) * step
                near = step > 0.0 and far < GUARD * max(1.0, abs(value))
                w[flag_row + member] = 1.0 if near else w[flag_row + member]
                w[at] = step * whole if step > 0.0 else value

    return cast(Callable[[Vector], None], quantise)


@called
def near_edge(effort: float, limit: float, step: float) -> bool:
    """Return whether the effort is in doubt between two multiples."""
    parts = effort / step
    return bool(abs(abs(parts - np.round(parts)) - 0.5) * step < GUARD * limit)
