"""Readings of all members, by the step of the bench, and which are too near to an edge.

Members differ from the bench in the last digits. Where a value is nearer to the edge between two
quanta than a guard well above that, a member does not decide on which side the bench is: it is in
doubt, and its trial is flown again by the bench.
"""

from collections.abc import Callable
from typing import cast

from flexslew_lab.studies.batch.groups.rows import Rows, Sizes
from flexslew_plant.arrays import Matrix, Vector, vectorised
from flexslew_plant.hardware.sensor_step import read_sensor
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH, KernelRows

# of a reading, or of one where it is smaller, and of the limit of an effort; members differ from
# the bench by 1e-13 of them at most
GUARD = 2e-12


def tip_deflection(
    of_kernel: KernelRows, rows: Rows, sizes: Sizes
) -> Callable[[int, int, Vector], None]:
    """Return what writes the deflection of a tip, a sum over modes, to a row of the flat array.

    It takes (tip, row, w).
    """
    modes, tip, mode = sizes.modes, rows.tip, of_kernel.mode

    @vectorised
    def deflect(i: int, row: int, w: Vector) -> None:
        first = tip + i * modes * BATCH_WIDTH
        for member in range(BATCH_WIDTH):
            w[row + member] = w[first + member] * w[mode + member] if modes else 0.0
        for j in range(1, modes):
            share = first + j * BATCH_WIDTH
            for member in range(BATCH_WIDTH):
                w[row + member] += w[share + member] * w[mode + j * BATCH_WIDTH + member]

    return cast(Callable[[int, int, Vector], None], deflect)


def sensor_readings(
    of_kernel: KernelRows, rows: Rows, sizes: Sizes
) -> Callable[[int, Matrix, Vector], None]:
    """Return what writes the readings of a tick: joints, rates, the first of the tips.

    It takes (k, noise of every tick, w); noise without rows: there is none. Where there is none, -0
    is added, which the compiler leaves out.
    """
    m, modes, count, quantised = sizes.joints, sizes.modes, sizes.outputs, sizes.quantised
    reading, bias, quantum, flag_row = rows.reading, rows.bias, rows.quantum, rows.doubt
    _, position, rate, _, mode_rate, _ = of_kernel
    tip_rate, previous, kept = rows.tip_rate, rows.previous, count * sizes.needs_previous
    deflect = tip_deflection(of_kernel, rows, sizes)

    @vectorised
    def add_errors(i: int, exact: int, k: int, noise: Matrix, w: Vector) -> None:
        noisy, row = noise.shape[0] > 0, i * BATCH_WIDTH
        for member in range(BATCH_WIDTH):
            flag, drawn = flag_row + member, noise[k, row + member] if noisy else -0.0
            step = w[quantum + row + member] if quantised else 0.0
            value, margin = read_sensor(w[exact + member], w[bias + row + member], drawn, step)
            if quantised:  # known to the compiler
                w[flag] = 1.0 if margin < GUARD * max(1.0, abs(value)) else w[flag]
            w[reading + row + member] = value

    @vectorised
    def read(k: int, noise: Matrix, w: Vector) -> None:
        for i in range(kept * BATCH_WIDTH):
            w[previous + i] = w[reading + i]
        for i in range(m):
            add_errors(i, position + i * BATCH_WIDTH, k, noise, w)
            add_errors(m + i, rate + i * BATCH_WIDTH, k, noise, w)
        for i in range(count - 2 * m):
            to = reading + (2 * m + i) * BATCH_WIDTH
            deflect(i, to, w)
            for j in range(modes):
                share = tip_rate + (i * modes + j) * BATCH_WIDTH
                for member in range(BATCH_WIDTH):
                    w[to + member] += w[share + member] * w[mode_rate + j * BATCH_WIDTH + member]
            add_errors(2 * m + i, to, k, noise, w)

    return cast(Callable[[int, Matrix, Vector], None], read)
