"""The observer of small motions in a batch: it predicts with the equations of motion."""

from functools import lru_cache
from typing import NamedTuple, cast

import numpy as np

from flexslew_control.estimators.small_motion_observer import MotionConstants, take_in
from flexslew_control.linear_form import LinearObserver
from flexslew_lab.studies.batch.laws.observers import BatchSignals, ObserverStep, linear
from flexslew_plant.arrays import Indices, Vector, compiled, put
from flexslew_plant.testbeds.compiled import interface
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH
from flexslew_plant.testbeds.compiled.bound import bound
from flexslew_plant.testbeds.kernels import Kernels


class BatchMotion(NamedTuple):
    """What linear_form.SmallMotionForm holds, of the members side by side."""

    beliefs: MotionConstants  # an axis for members in front; one entry: the same in all
    behind: LinearObserver  # by batch_laws.by_member


@lru_cache
def small_motion_observer(
    kernels: Kernels, n: int, before: int, output_states: int
) -> ObserverStep:
    """Return the observer of small motions and what reads its estimate, member after member.

    Its memory holds [q, v] of every member, then rows: the estimates of the tick before, and what
    the one behind keeps.

    Args:
        kernels: the equations that it believes in.
        n: coordinates.
        before: of them before the modes.
        output_states: states of the one behind.
    """
    advance, read_estimate = bound(kernels, n, before).advance, linear(output_states)
    rows = 2 * n * BATCH_WIDTH  # of an estimate

    @compiled
    def observer_step(
        k: int,
        t: float,
        dt: float,
        given: tuple[Indices, BatchMotion],
        signals: BatchSignals,
        z: Vector,
        memory: Vector,
        filled: int,
    ) -> None:
        start_tick, batch_motion = given
        design_models = batch_motion.beliefs
        positions, outputs = design_models.rest.shape[1], design_models.gain.shape[2]
        m, each, unit = outputs // 2, positions + n, 1 if len(design_models.rest) > 1 else 0
        effort, innovation, found = np.empty(m), np.empty(outputs), np.empty(2 * n)
        previous, after = (
            memory[each * BATCH_WIDTH : each * BATCH_WIDTH + rows],
            memory[each * BATCH_WIDTH + rows :],
        )
        put(z[:rows], previous)
        for member in range(filled):
            packed, rest = design_models.packed[member * unit], design_models.rest[member * unit]
            gain, small = design_models.gain[member * unit], design_models.small[member * unit]
            x = memory[member * each : (member + 1) * each]
            if k == 0:
                put(rest, x)
                x[positions:] = 0.0
            else:
                for i in range(m):
                    effort[i] = signals.effort[i * BATCH_WIDTH + member]
                advance(packed, t - dt, effort, dt, 1, before, x)
            interface.reading(kernels, packed, x, innovation[:m], innovation[m:])
            for i in range(outputs):
                innovation[i] = signals.y[i * BATCH_WIDTH + member] - innovation[i]
            take_in(kernels, packed, gain, rest, small, innovation, x, found)
            for i in range(2 * n):
                z[i * BATCH_WIDTH + member] = found[i]
        seen = BatchSignals(z[:rows], previous, signals.effort, signals.demand)
        read_estimate(k, t, dt, (start_tick, batch_motion.behind), seen, z[rows:], after, filled)

    return cast(ObserverStep, observer_step)
